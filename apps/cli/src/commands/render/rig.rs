//! Rigs: the pictures and sweeps of all sensors along one path, a folder each.

use super::args::RenderArgs;
use super::camera::{DEFAULT_SECONDS, motion};
use super::manifest;
use super::output_args::check_labels;
use crate::choices::first_given;
use crate::interrupt;
use crate::names::stem_of;
use crate::output::make_folder;
use crate::progress::{self, Reporter};
use crate::scene::OpenScene;
use anyhow::{Context, Result, bail};
use indicatif::ProgressBar;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::output::{LayerFile, PictureStyle, layers_of};
use weather_magician::rig::{Rig, RigSensor};
use weather_magician::sensor::{SensorData, SensorInstant};
use weather_magician::{Camera, CameraMotion, Error, Weather, picture_tags};
use wm_image::png::DepthScale;

/// The file that describes the sensors and their files.
const MANIFEST: &str = "rig.json";
/// The error of a rig that was stopped.
const INCOMPLETE: &str = "the rig is not complete; the same command continues with the others";
/// Maximum number of pictures and sweeps of a run.
const MAX_FILES: usize = 1_000_000;

/// The place, the weather and the path of a rig.
struct RigJob<'a> {
    args: &'a RenderArgs,
    loaded: OpenScene,
    weather: &'a Weather,
    base: CameraMotion,
    folder: PathBuf,
    start: f64,
    seconds: f64,
    bar: ProgressBar,
}

/// Runs `render --rig`.
pub(crate) fn run(args: &RenderArgs, weather: &Weather, file: &Path) -> Result<()> {
    let rig = Rig::read(file)?;
    let folder = check(args, weather, &rig)?;
    args.levels.refuse_for("--rig")?;
    let mut loaded =
        OpenScene::with_sky(&args.scene, &args.run, args.camera.viewpoint.views.as_ref(), args.sky)?;
    let base = motion(&args.camera.spec(&args.output), &args.camera.viewpoint.options(), &mut loaded)?;
    let duration = if base.duration() > 0.0 { base.duration() } else { DEFAULT_SECONDS };
    let (start, seconds) = (args.output.time(), args.output.seconds.unwrap_or(duration));
    let base = base.driven(start.max(0.0) + seconds, loaded.place.site().metres_per_unit)?;
    args.output.set_drawing(&mut loaded.place);
    let count: usize =
        rig.sensors.iter().map(|sensor| sensor.times(start, seconds).take(MAX_FILES + 1).count()).sum();
    if count > MAX_FILES {
        bail!("{}: more than {MAX_FILES} pictures and sweeps; give --seconds", file.display());
    }
    check_labels(layers_of(&args.output.also), &loaded.place, &args.scene.scene)?;
    let weather = &loaded.place.weather_of_shot(weather, &base.camera(start));
    let mut job = RigJob { args, loaded, weather, base, folder, start, seconds, bar: ProgressBar::hidden() };
    manifest::keep(&job.folder, MANIFEST, &job.manifest(&rig)?, "files of another run")?;
    // Lidars and radars need the splats, so they are not freed.
    job.loaded.renderer.prepare(&mut job.loaded.place, weather, &mut Reporter::default())?;
    job.loaded.warn();
    job.bar = progress::bar(count as u64, "pictures and sweeps");
    for (number, sensor) in rig.sensors.iter().enumerate() {
        let started = Instant::now();
        let (written, kept) = job.sensor(sensor, number)?;
        job.bar.suspend(|| {
            println!(
                "{}: {written} written, {kept} kept, {:.1} s",
                job.folder.join(&sensor.name).display(),
                started.elapsed().as_secs_f64()
            );
        });
    }
    job.bar.finish_and_clear();
    job.loaded.warn();
    Ok(())
}

/// Checks the options that do not depend on the scene; returns the folder.
fn check(args: &RenderArgs, weather: &Weather, rig: &Rig) -> Result<PathBuf> {
    let (viewpoint, output) = (&args.camera.viewpoint, &args.output);
    let refused = first_given([
        (args.camera.lens.is_some(), "--lens"),
        (viewpoint.size.is_some(), "--size"),
        (viewpoint.fov.is_some(), "--fov"),
        (args.device.given().is_some(), args.device.given().unwrap_or_default()),
        (args.pairs.is_asked_for()?, "--pairs"),
        (output.stages, "--stages"),
        (output.layers, "--layers"),
        (output.asks_for_frames(), "--frames and --frame-step"),
        (output.bitrate.is_some(), "--bitrate"),
        (args.camera.save_path.is_some(), "--save-path"),
    ]);
    if let Some(option) = refused {
        bail!("--rig: each sensor has its own settings in the rig's file; leave out {option}");
    }
    args.camera.check()?;
    output.check_times()?;
    for sensor in &rig.sensors {
        let named = || format!("sensor \"{}\"", sensor.name);
        sensor.device.check(weather, layers_of(&output.also)).with_context(named)?;
    }
    let name = format!("{}-{}-rig", stem_of(&args.scene.scene), weather.name);
    output.folder(name, "a rig has a folder per sensor")
}

impl RigJob<'_> {
    /// Returns a function that names the file of a picture or sweep of a sensor by its number.
    fn files_of(&self, sensor: &RigSensor) -> impl Fn(u32) -> PathBuf + use<> {
        let extension =
            sensor.device.extension().unwrap_or_else(|| self.args.output.frame_format.extension());
        let folder = self.folder.join(&sensor.name);
        move |index| folder.join(format!("{index:06}.{extension}"))
    }

    /// Makes what a sensor sees; returns the numbers of files that were written and that were
    /// there.
    fn sensor(&mut self, sensor: &RigSensor, number: usize) -> Result<(usize, usize)> {
        make_folder(&self.folder.join(&sensor.name))?;
        let format = self.args.output.frame_format;
        // The colour is written first and the other pictures after it: a frame is complete if the
        // last one exists.
        let last = self.args.output.also.last().filter(|_| sensor.device.camera().is_some());
        let file = self.files_of(sensor);
        let is_there = |index: u32| {
            let file = file(index);
            let other = |also: &LayerFile| PictureStyle::path_of(*also, format, &file).exists();
            file.exists() && last.is_none_or(other)
        };
        let all: Vec<(u32, f64)> = sensor.times(self.start, self.seconds).collect();
        let missing: Vec<(u32, f64)> = all.iter().copied().filter(|(index, _)| !is_there(*index)).collect();
        let kept = all.len() - missing.len();
        self.bar.inc(kept as u64);
        let motion = sensor.motion(&self.base, self.loaded.place.site().metres_per_unit);
        let mut run = sensor.device.begin(motion.clone(), number as u32);
        let layers = layers_of(&self.args.output.also);
        let mut reading = SensorData::default();
        for rest in missing.chunk_by(|(index, _), (next, _)| index + 1 == *next) {
            let mut at = 0;
            while let Some((index, time)) = rest.get(at).copied() {
                interrupt::check(INCOMPLETE)?;
                let instant = SensorInstant {
                    weather: self.weather,
                    start: self.start + sensor.phase,
                    time,
                    index,
                    rate: sensor.rate,
                    ahead: (rest.len() - at) as u32,
                    seed: 0,
                    layers,
                };
                let style = match sensor.device.camera() {
                    Some(_) => self.style(sensor, &motion.camera(time), time),
                    None => PictureStyle::default(),
                };
                let Self { loaded: OpenScene { renderer, place }, bar, .. } = self;
                let mut save = |reading: &mut SensorData| {
                    reading.save(&file(rest[at].0), &style)?;
                    bar.inc(1);
                    at += 1;
                    Ok(())
                };
                let progress = &mut Reporter::default();
                match run.read_ahead(renderer, place, &instant, &mut reading, &mut save, progress) {
                    Ok(0) | Err(Error::Stopped) => return Err(interrupt::stopped(INCOMPLETE)),
                    made => made?,
                };
            }
        }
        Ok((missing.len(), kept))
    }

    /// The files of a picture, and what is written into them.
    fn style(&self, sensor: &RigSensor, pose: &Camera, time: f64) -> PictureStyle {
        let OpenScene { renderer, place } = &self.loaded;
        let (scene, site) = (self.args.scene.scene.display().to_string(), place.site());
        let mut tags = picture_tags(&scene, site, renderer.backend(), self.weather, time, pose);
        tags.push(("sensor".into(), sensor.name.clone()));
        PictureStyle {
            also: self.args.output.also.clone(),
            dither: self.args.output.dither,
            depth_scale: DepthScale::reaching(site.far),
            tags,
            ..PictureStyle::default()
        }
    }

    /// Returns what the files are, and everything that they depend on except the scene's bytes.
    fn manifest(&self, rig: &Rig) -> Result<Json> {
        let OpenScene { renderer, place } = &self.loaded;
        let sensors: Vec<Json> = rig.sensors.iter().map(|sensor| self.sensor_manifest(sensor)).collect();
        Ok(json!({
            "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
            "scene": manifest::scene_facts(&self.args.scene.scene, place.site())?,
            "weather": format!("{:?}", self.weather),
            "start": self.start,
            "seconds": self.seconds,
            "drawing": manifest::drawing_facts(place, layers_of(&self.args.output.also)),
            "also": format!("{:?}", self.args.output.also),
            "dither": format!("{:?}", self.args.output.dither),
            "simd": renderer.backend().path().to_string(),
            "device": renderer.backend().arithmetic(),
            "units": {
                "time": "s",
                "world_from_sensor": "rows of a 4x4 matrix, m; the world's axes, and the sensor's: x forward, y left, z up",
                "points": "m, axes of the sensor at the start of the sweep",
                "intrinsics": "px, the centre of the first pixel at 0.5, 0.5",
            },
            "sensors": sensors,
        }))
    }

    fn sensor_manifest(&self, sensor: &RigSensor) -> Json {
        let metres = self.loaded.place.site().metres_per_unit;
        let (motion, file) = (sensor.motion(&self.base, metres), self.files_of(sensor));
        let frames: Vec<Json> = sensor
            .times(self.start, self.seconds)
            .map(|(index, time)| {
                let pose = motion.sensor_pose(time);
                let rows = pose.world_from_sensor.transpose();
                let at = pose.origin * metres;
                let row = |k: usize| {
                    let turned = rows.col(k);
                    [turned.x, turned.y, turned.z, at[k]]
                };
                let file = file(index);
                let name = file.strip_prefix(&self.folder).unwrap_or(&file).display().to_string();
                let last = [0.0, 0.0, 0.0, 1.0];
                json!({ "file": name.replace('\\', "/"), "time": time, "world_from_sensor": [row(0), row(1), row(2), last] })
            })
            .collect();
        let mut about =
            json!({ "name": sensor.name, "rate": sensor.rate, "phase": sensor.phase, "frames": frames });
        about["kind"] = sensor.device.kind().into();
        for (name, value) in sensor.device.facts() {
            about[name] = value;
        }
        about
    }
}
