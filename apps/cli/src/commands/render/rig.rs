//! Rigs: the pictures and sweeps of all sensors along one path, a folder each.

use super::camera::{DEFAULT_SECONDS, motion};
use super::{RenderArgs, check_labels, manifest};
use crate::choices::first_given;
use crate::interrupt::{self, Interrupted};
use crate::names::stem_of;
use crate::progress::{self, Reporter};
use crate::scene::OpenScene;
use anyhow::{Context, Result, bail};
use indicatif::ProgressBar;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::camera_model::SensorCamera;
use weather_magician::lidar::{LidarSweep, ScanOptions};
use weather_magician::output::{LayerFile, PictureStyle, layers_of};
use weather_magician::radar::{RadarScanOptions, RadarSweep};
use weather_magician::rig::{Rig, RigDevice, RigSensor};
use weather_magician::{
    Camera, CameraMotion, Error, FrameRequest, LensView, NextFrame, Picture, Weather, picture_tags,
};
use wm_image::png::DepthScale;

/// The file that describes the sensors and their files.
const MANIFEST: &str = "rig.json";
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
        match &sensor.device {
            RigDevice::Camera { model, .. } => {
                let named = || format!("sensor \"{}\"", sensor.name);
                layers_of(&output.also).check(model, weather).context("--also").with_context(named)?;
                model.check(weather).with_context(named)?;
            }
            device if weather.fidelity == wm_weather::Fidelity::Paper => {
                let kind = if matches!(device, RigDevice::Lidar { .. }) { "lidar" } else { "radar" };
                bail!("sensor \"{}\": a {kind} needs --set fidelity=physical", sensor.name);
            }
            _ => {}
        }
    }
    let name = format!("{}-{}-rig", stem_of(&args.scene.scene), weather.name);
    output.folder(name, "a rig has a folder a sensor")
}

impl RigJob<'_> {
    /// The file of a picture or sweep.
    fn file(&self, sensor: &RigSensor, index: u32) -> PathBuf {
        let extension = match &sensor.device {
            RigDevice::Camera { .. } => self.args.output.frame_format.extension(),
            RigDevice::Lidar { format, .. } => format.extension(),
            RigDevice::Radar { format, .. } => format.extension(),
        };
        self.folder.join(&sensor.name).join(format!("{index:06}.{extension}"))
    }

    /// Makes what a sensor sees; returns the numbers of files that were written and that were
    /// there.
    fn sensor(&mut self, sensor: &RigSensor, number: usize) -> Result<(usize, usize)> {
        let folder = self.folder.join(&sensor.name);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        let format = self.args.output.frame_format;
        // The colour is written first and the other pictures after it: a frame is complete if the
        // last one exists.
        let last = self.args.output.also.last().filter(|_| matches!(sensor.device, RigDevice::Camera { .. }));
        let is_there = |index: u32| {
            let file = self.file(sensor, index);
            let other = |also: &LayerFile| PictureStyle::path_of(*also, format, &file).exists();
            file.exists() && last.is_none_or(other)
        };
        let all: Vec<(u32, f64)> = sensor.times(self.start, self.seconds).collect();
        let missing: Vec<(u32, f64)> = all.iter().copied().filter(|(index, _)| !is_there(*index)).collect();
        let kept = all.len() - missing.len();
        self.bar.inc(kept as u64);
        let motion = sensor.motion(&self.base, self.loaded.place.site().metres_per_unit);
        match &sensor.device {
            RigDevice::Camera { model, .. } => {
                let mut camera = SensorCamera::new((**model).clone(), motion);
                camera.number = number as u32;
                self.pictures(sensor, &camera, &missing)?;
            }
            RigDevice::Lidar { .. } | RigDevice::Radar { .. } => {
                self.sweeps(sensor, &motion, &missing, number)?;
            }
        }
        Ok((missing.len(), kept))
    }

    fn pictures(&mut self, sensor: &RigSensor, camera: &SensorCamera, missing: &[(u32, f64)]) -> Result<()> {
        let layers = layers_of(&self.args.output.also);
        let scene = self.args.scene.scene.display().to_string();
        let mut picture = Picture::default();
        for (index, time) in missing {
            stop_if_asked()?;
            let OpenScene { renderer, place } = &mut self.loaded;
            let after = *time + 1.0 / sensor.rate;
            let next = camera.motion().at(after, place.site().metres_per_unit);
            let request = FrameRequest {
                index: *index,
                layers,
                next: Some(NextFrame { time: after, camera: next }),
                ..FrameRequest::new(self.weather, camera, *time)
            };
            renderer.render_into(place, &request, &mut picture, &mut Reporter::default())?;
            let pose = camera.motion().camera(*time);
            let mut tags = picture_tags(&scene, place.site(), renderer.backend(), self.weather, *time, &pose);
            tags.push(("sensor".into(), sensor.name.clone()));
            let style = PictureStyle {
                also: self.args.output.also.clone(),
                dither: self.args.output.dither,
                depth_scale: DepthScale::reaching(place.site().far),
                tags,
                ..PictureStyle::default()
            };
            style.write(&picture, &self.file(sensor, *index))?;
            self.bar.inc(1);
        }
        Ok(())
    }

    fn sweeps(
        &mut self,
        sensor: &RigSensor,
        motion: &CameraMotion,
        missing: &[(u32, f64)],
        number: usize,
    ) -> Result<()> {
        // Sweeps one after the other are made in one go.
        for run in missing.chunk_by(|(a, _), (b, _)| a + 1 == *b) {
            stop_if_asked()?;
            let (time, first, sweeps) = (self.start + sensor.phase, run[0].0, run.len() as u32);
            let files: Vec<PathBuf> = run.iter().map(|(index, _)| self.file(sensor, *index)).collect();
            let mut files = files.iter();
            let bar = &self.bar;
            let mut saved = |save: &dyn Fn(&Path) -> weather_magician::Result<()>| {
                files.next().map_or(Ok(()), |file| save(file))?;
                bar.inc(1);
                if interrupt::asked() { Err(Error::Stopped) } else { Ok(()) }
            };
            let OpenScene { renderer, place } = &mut self.loaded;
            let progress = &mut Reporter::default();
            let made = match &sensor.device {
                RigDevice::Camera { .. } => return Ok(()),
                RigDevice::Lidar { model, sub_rays, returns, .. } => {
                    let options = ScanOptions {
                        time,
                        first,
                        sweeps,
                        sensor: number as u8,
                        sub_rays: *sub_rays,
                        returns: *returns,
                        ..ScanOptions::default()
                    };
                    let mut take = |sweep: LidarSweep| saved(&|file| Ok(sweep.save(file)?));
                    renderer.scan(place, self.weather, model, motion, &options, &mut take, progress)
                }
                RigDevice::Radar { model, .. } => {
                    let sensor = number as u8;
                    let options =
                        RadarScanOptions { time, first, sweeps, sensor, ..RadarScanOptions::default() };
                    let mut take = |sweep: RadarSweep| saved(&|file| Ok(sweep.save(file)?));
                    renderer.scan_radar(place, self.weather, model, motion, &options, &mut take, progress)
                }
            };
            if matches!(made, Err(Error::Stopped)) || made? < sweeps {
                return Err(stopped());
            }
        }
        Ok(())
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
            "drawing": super::drawing_facts(place, layers_of(&self.args.output.also)),
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
        let motion = sensor.motion(&self.base, metres);
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
                let file = self.file(sensor, index);
                let name = file.strip_prefix(&self.folder).unwrap_or(&file).display().to_string();
                let last = [0.0, 0.0, 0.0, 1.0];
                json!({ "file": name.replace('\\', "/"), "time": time, "world_from_sensor": [row(0), row(1), row(2), last] })
            })
            .collect();
        let mut about =
            json!({ "name": sensor.name, "rate": sensor.rate, "phase": sensor.phase, "frames": frames });
        match &sensor.device {
            RigDevice::Camera { intrinsics, model } => {
                let Camera { width, height, fx, fy, cx, cy, .. } = **intrinsics;
                about["kind"] = "camera".into();
                about["intrinsics"] =
                    json!({ "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy });
                about["lens"] =
                    model.lens.as_ref().map(LensView::lens).map(|lens| format!("{lens:?}")).into();
                about["shutter"] = json!({
                    "exposure_time": model.shutter.exposure,
                    "readout": model.shutter.readout,
                    "readout_from": format!("{:?}", model.shutter.first).to_lowercase(),
                });
                about["exposure"] = format!("{:?}", model.exposure).into();
                about["noise"] = model.noise.map(|noise| format!("{noise:?}")).into();
            }
            RigDevice::Lidar { model, sub_rays, returns, .. } => {
                about["kind"] = "lidar".into();
                about["model"] = model.name.clone().into();
                about["sub_rays"] = sub_rays.count().into();
                about["returns"] = format!("{returns:?}").to_lowercase().into();
            }
            RigDevice::Radar { model, .. } => {
                about["kind"] = "radar".into();
                about["model"] = model.name.clone().into();
            }
        }
        about
    }
}

/// Returns an error if the user asked to stop.
fn stop_if_asked() -> Result<()> {
    if interrupt::asked() { Err(stopped()) } else { Ok(()) }
}

fn stopped() -> anyhow::Error {
    Interrupted("the rig is not complete; the same command continues with the others".into()).into()
}
