//! `demo`: photos, reconstruction and weather on the built-in street, without input or download.
//!
//! The pictures of the README, `docs/weathers.jpg`, show the scene that
//! `demo --sampled --only scene` writes.

mod capture;
mod film;
mod photos;
pub(crate) mod street;

use super::reconstruct::CHECKPOINT;
use crate::choices::{ENCODERS, one_of};
use crate::output::{make_folder, write_sheet, write_video};
use crate::overwrite::OverwriteArgs;
use crate::progress::{self, Reporter};
use crate::scene::{OpenScene, RunArgs};
use anyhow::{Context, Result, bail};
use capture::CaptureArgs;
use clap::{Args, ValueEnum};
use film::FogFilm;
use photos::{LIGHTS, PhotoSession, PhotoSet, PlaceChoice, ROUTES, TRUTHS};
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::formats::{ReadOptions, read_scene, write_scene};
use weather_magician::view::spec;
use weather_magician::{
    Camera, FrameRequest, Metadata, Picture, PictureSize, Scene, Weather, picture_tags, video,
};
use wm_image::color::Dither;
use wm_street::dataset::{CameraRoute, DatasetOptions, GroundTruth};
use wm_street::{Lighting, Street, Viewpoint};
use wm_weather::ParamValue;

/// Frame rate of the film.
const FPS: u32 = 24;
/// Sides of photos as a share of the film's.
const PHOTO_SIDE_SHARE: f64 = 0.5;
/// Shortest and longest film.
const FILM_LENGTHS_S: (f64, f64) = (0.1, 600.0);
/// The scene's name in the tags of output files.
const SCENE: &str = "built-in street";
/// Position on the walk of the camera of a reconstructed street's sheet, 0-1.
const SHEET_AT: f64 = 0.1;
/// The weathers of the sheet: presets, with changes that suit a street of 150 m.
const SHEET: [(&str, Option<&str>); 6] = [
    ("clear", None),
    ("fog", Some("fog.mor=120")),
    ("haze", None),
    ("smog", Some("smog.mor=300")),
    ("heavy-rain", None),
    ("snow", None),
];

/// The remedy for outputs that exist, beside `--overwrite`.
const OTHER: &str = "give another folder with --out";

/// Options of `demo`.
#[derive(Args, Debug)]
pub(crate) struct DemoArgs {
    /// Folder to write street.ply, sheet.png and fog.mp4 into, and photos/ unless --sampled is
    /// given
    #[arg(short, long, value_name = "FOLDER", default_value = "weather-magician-demo")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Size of the film, and of each picture of the sheet, px [default: 960x640; of --photos,
    /// 600x400]
    #[arg(long, value_name = "WxH", value_parser = spec::parse_size)]
    size: Option<(u32, u32)>,
    /// Take no photos: sample the scene from the street's own surfaces, which is quicker and
    /// sharper than reconstructing it
    #[arg(long)]
    sampled: bool,
    /// Only take the photos, with exact depth, normals and sky, into this folder (a COLMAP data
    /// set)
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["sampled", "only", "steps"], help_heading = "Photos")]
    photos: Option<PathBuf>,
    /// Place of --photos: street or park
    #[arg(
        long,
        value_name = "PLACE",
        default_value = "street",
        requires = "photos",
        help_heading = "Photos"
    )]
    place: PlaceChoice,
    /// Light of --photos or --sampled: sunny, or overcast (the truth for relit pictures)
    #[arg(long, value_name = "LIGHT", value_parser = one_of(LIGHTS), default_value = "sunny", help_heading = "Photos")]
    light: Lighting,
    /// Number of photos [default: 40; of --capture, 24 to 30]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(3..=100_000), help_heading = "Photos")]
    count: Option<u32>,
    /// Route of the camera: walk (through the place) or orbit (around it, from above), exact and in
    /// metres
    #[arg(long, value_name = "ROUTE", value_parser = one_of(ROUTES), default_value = "walk", requires = "photos", help_heading = "Photos")]
    route: CameraRoute,
    /// Exact depth, normals and sky of the photos: write or omit
    #[arg(
        long,
        value_name = "CHOICE",
        value_parser = one_of(TRUTHS),
        default_value = "write",
        requires = "photos",
        help_heading = "Photos"
    )]
    truth: GroundTruth,
    /// Number of training steps
    #[arg(long, value_name = "N", default_value_t = 2000, conflicts_with = "sampled", value_parser = clap::value_parser!(u32).range(1..=100_000), help_heading = "Photos")]
    steps: u32,
    /// Length of the film, seconds
    #[arg(long, value_name = "S", default_value_t = 8.0)]
    seconds: f64,
    /// Sampling density of --sampled: 2 makes about four times as many splats as 1
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, requires = "sampled")]
    detail: f64,
    /// Write only these outputs: scene, sheet, film, or several
    #[arg(long, value_name = "LIST", value_delimiter = ',', hide_possible_values = true)]
    only: Vec<DemoOutput>,
    /// Encoder of the film
    #[arg(long, value_parser = one_of(ENCODERS), default_value = "builtin")]
    encoder: video::VideoEncoder,
    #[command(flatten)]
    capture: CaptureArgs,
    #[command(flatten)]
    run: RunArgs,
}

/// An output of the demo.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DemoOutput {
    /// `street.ply`.
    Scene,
    /// `sheet.png`.
    Sheet,
    /// `fog.mp4`.
    Film,
}

impl DemoArgs {
    /// Returns the viewpoint of the sheet, chosen where the scene is good.
    fn view(&self) -> Viewpoint {
        if self.sampled { Street::views()[0] } else { Street::dolly(SHEET_AT) }
    }

    fn size(&self) -> (u32, u32) {
        self.size.unwrap_or((960, 640))
    }

    /// Returns the photos of the reconstruction, no larger than the film needs.
    fn session(&self) -> PhotoSession {
        let side = |of: u32| (f64::from(of) * PHOTO_SIDE_SHARE).round().max(16.0) as u32;
        let (width, height) = self.size();
        let size = (side(width), side(height));
        let usual = DatasetOptions::default();
        let options = DatasetOptions { count: self.count(), size, truth: GroundTruth::Omit, ..usual };
        PhotoSession { place: PlaceChoice::Street, light: Lighting::Sunny, set: PhotoSet::Exact(options) }
    }

    fn count(&self) -> u32 {
        self.count.unwrap_or(40)
    }

    fn wants(&self, part: DemoOutput) -> bool {
        self.only.is_empty() || self.only.contains(&part)
    }

    /// Returns the film's video settings, without tags.
    fn video(&self) -> Result<video::VideoSettings> {
        let rate = video::FrameRate::new(FPS, 1).context("no such frame rate")?;
        let settings = video::VideoSettings::new(PictureSize::new(self.size().0, self.size().1), rate);
        Ok(video::VideoSettings { encoder: self.encoder, ..settings })
    }

    fn check(&self) -> Result<()> {
        if self.light != Lighting::Sunny && self.photos.is_none() && !self.sampled {
            bail!("--light: needs --photos or --sampled");
        }
        if !(FILM_LENGTHS_S.0..=FILM_LENGTHS_S.1).contains(&self.seconds) {
            bail!("--seconds {}: must be {} to {}", self.seconds, FILM_LENGTHS_S.0, FILM_LENGTHS_S.1);
        }
        if !(0.1..=4.0).contains(&self.detail) {
            bail!("--detail {}: must be 0.1 to 4", self.detail);
        }
        Ok(())
    }
}

/// Runs the command.
pub(crate) fn run(args: &DemoArgs) -> Result<()> {
    args.check()?;
    let started = Instant::now();
    if let Some(folder) = &args.photos {
        return take_photos(args, folder);
    }
    let path = args.out.join("street.ply");
    if args.wants(DemoOutput::Scene) || !args.sampled {
        args.overwrite.check(&path, &[], OTHER)?;
    }
    if !args.sampled {
        args.overwrite.check(&photos::run_folder(&path).join(CHECKPOINT), &[], OTHER)?;
    }
    make_folder(&args.out)?;
    let film = args.out.join("fog.mp4");
    if args.wants(DemoOutput::Film) {
        // An unsuitable size or folder is reported before the work starts.
        drop(video::create_video(&film, args.video()?)?);
    }
    let scene = if args.sampled { sampled(args, &path)? } else { reconstructed(args, &path)? };
    if args.wants(DemoOutput::Sheet) || args.wants(DemoOutput::Film) {
        draw(args, scene, &film)?;
    }
    println!("done in {:.0} s", started.elapsed().as_secs_f64());
    if path.is_file() {
        let (scene, camera) = (quoted(&path), camera_text(&args.view()));
        println!("try, for example:");
        println!("  weather-magician render {scene} --weather dense-fog --camera {camera}");
        println!(
            "  weather-magician render {scene} --weather smog --camera {camera} --path dolly --distance 25"
        );
        println!("  weather-magician render --help");
    }
    Ok(())
}

/// Runs `demo --photos`.
fn take_photos(args: &DemoArgs, folder: &Path) -> Result<()> {
    let size = args.size.unwrap_or((600, 400));
    let (place, light, route, truth) = (args.place, args.light, args.route, args.truth);
    let exact = || DatasetOptions { route, count: args.count(), size, truth, ..DatasetOptions::default() };
    let capture = args.capture.settings(args.count, size, truth).map(PhotoSet::Capture);
    let session = PhotoSession { place, light, set: capture.unwrap_or_else(|| PhotoSet::Exact(exact())) };
    let started = Instant::now();
    session.shoot(folder, &args.run)?;
    let seconds = started.elapsed().as_secs_f64();
    println!("{}: {} photos, {}x{}, in {seconds:.0} s", folder.display(), session.count(), size.0, size.1);
    println!("try, for example:");
    // A capture tells its scale by GPS, or not at all.
    let scale = if matches!(session.set, PhotoSet::Exact(_)) { " --metres-per-unit 1" } else { "" };
    println!("  weather-magician reconstruct {} --preset quick{scale}", quoted(folder));
    Ok(())
}

/// Reconstructs the scene from photos of the street; always writes it.
fn reconstructed(args: &DemoArgs, path: &Path) -> Result<Scene> {
    let (folder, session) = (args.out.join("photos"), args.session());
    let started = Instant::now();
    session.shoot(&folder, &args.run)?;
    let (seconds, (width, height)) = (started.elapsed().as_secs_f64(), session.size());
    println!("{}: {} photos, {width}x{height}, in {seconds:.0} s", folder.display(), session.count());
    photos::reconstruct(&folder, path, args.steps, &args.run)?;
    Ok(read_scene(path, &ReadOptions::default())?)
}

/// Samples the scene from the street's surfaces.
fn sampled(args: &DemoArgs, path: &Path) -> Result<Scene> {
    let scene = street::scene(args.detail, args.light, args.run.threads)?;
    if args.wants(DemoOutput::Scene) {
        write_scene(path, &scene)?;
        println!("{}: {} splats, {}", path.display(), scene.splats.len(), megabytes(path));
    }
    Ok(scene)
}

/// Renders the sheet and the film.
fn draw(args: &DemoArgs, scene: Scene, film: &Path) -> Result<()> {
    let mut studio = OpenScene::of(scene, &Metadata::default(), &args.run)?;
    if args.wants(DemoOutput::Sheet) {
        // Photos start at the beginning of the walk, and cover less near its ends.
        let view = args.view();
        draw_sheet(&mut studio, &view.camera(args.size())?, &args.out.join("sheet.png"))?;
    }
    if args.wants(DemoOutput::Film) {
        shoot(&mut studio, args, film)?;
    }
    Ok(())
}

/// Returns the error of stopped work on a file.
fn not_written(path: &Path) -> String {
    format!("{} is not written", path.display())
}

/// Renders one view in every weather of [`SHEET`].
fn draw_sheet(studio: &mut OpenScene, camera: &Camera, path: &Path) -> Result<()> {
    let mut pictures = Vec::new();
    progress::for_each(SHEET.into_iter(), "pictures", &not_written(path), |(name, change), _| {
        let mut weather = Weather::find(name)?;
        change.map_or(Ok(()), |change| weather.set_text(change))?;
        let picture = studio.renderer.render(&mut studio.place, &FrameRequest::new(&weather, camera, 0.0))?;
        pictures.push((picture.frame.rgb, label(&weather)));
        Ok(())
    })?;
    let (site, backend) = (studio.place.site(), studio.renderer.backend());
    let mut tags = picture_tags(SCENE, site, backend, &Weather::clear(), 0.0, camera);
    if let Some((_, text)) = tags.iter_mut().find(|(key, _)| key == "weather") {
        *text = pictures.iter().map(|(_, label)| label.as_str()).collect::<Vec<_>>().join("; ");
    }
    let size = PictureSize::new(camera.width, camera.height);
    let whole = write_sheet(path, &pictures, size, 3, Dither::Ordered, &tags)?;
    let names = SHEET.map(|(name, _)| name).join(", ");
    println!("{}: {names}, {}x{}, {}", path.display(), whole.width, whole.height, megabytes(path));
    Ok(())
}

/// Renders the walk in changing fog.
fn shoot(studio: &mut OpenScene, args: &DemoArgs, path: &Path) -> Result<()> {
    let film = FogFilm { seconds: args.seconds };
    let weather = film.weather()?;
    let mut settings = args.video()?;
    let rate = settings.frame_rate;
    let (site, backend) = (studio.place.site(), studio.renderer.backend());
    settings.tags = picture_tags(SCENE, site, backend, &weather, 0.0, &film.view(0.0).camera(args.size())?);
    let started = Instant::now();
    let frames: Vec<u32> = (0..rate.frames_within(args.seconds)).collect();
    let mut render = |index: u32, picture: &mut Picture| {
        let time = rate.seconds(u64::from(index));
        let request = FrameRequest::new(&weather, film.view(time).camera(args.size())?, time);
        let OpenScene { renderer, place } = &mut *studio;
        renderer.render_into(place, &request, picture, &mut Reporter::default())?;
        Ok(())
    };
    let report = write_video(path, settings, &frames, &mut render, |_| not_written(path))?;
    println!(
        "{}: {}, {}x{}, {:.1} s, {:.1} MB, {:.1} frames a second ({})",
        path.display(),
        weather.name,
        args.size().0,
        args.size().1,
        report.seconds,
        report.bytes as f64 * 1e-6,
        frames.len() as f64 / started.elapsed().as_secs_f64(),
        studio.renderer.describe()
    );
    Ok(())
}

/// Returns name and visibility of a weather for the sheet: `fog, MOR 150 m`.
fn label(weather: &Weather) -> String {
    let instant = weather.at(0.0);
    let first = |param: &str| {
        instant.effects().find_map(|(effect, values)| match values[effect.param(param)?] {
            ParamValue::Number(number) => Some(number),
            _ => None,
        })
    };
    if let Some(rate) = first("rate") {
        return format!("{}, {rate} mm/h", weather.name);
    }
    match first("mor") {
        Some(mor) if mor >= 1000.0 => format!("{}, MOR {} km", weather.name, mor / 1000.0),
        Some(mor) => format!("{}, MOR {mor} m", weather.name),
        None => weather.name.clone(),
    }
}

/// Formats a view as a value of `--camera`.
fn camera_text(view: &Viewpoint) -> String {
    let [eye, target] = [view.eye, view.target].map(|p| format!("{},{},{}", p.x, p.y, p.z));
    format!("{eye}:{target}")
}

/// Quotes a path for a shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    if text.contains(char::is_whitespace) { format!("\"{text}\"") } else { text }
}

/// Formats the size of a file.
fn megabytes(path: &Path) -> String {
    std::fs::metadata(path)
        .map_or_else(|_| "written".into(), |about| format!("{:.1} MB", about.len() as f64 * 1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_give_name_and_visibility() {
        let label_of = |(name, change): (&str, Option<&str>)| {
            let mut weather = Weather::find(name).unwrap();
            change.iter().for_each(|change| weather.set_text(change).unwrap());
            label(&weather)
        };
        assert_eq!(
            SHEET.map(label_of),
            [
                "clear",
                "fog, MOR 120 m",
                "haze, MOR 2 km",
                "smog, MOR 300 m",
                "heavy-rain, 25 mm/h",
                "snow, 1.5 mm/h",
            ]
        );
    }

    #[test]
    fn what_is_printed_can_be_typed() {
        let view = Street::views()[0];
        let spec: spec::CameraSpec = camera_text(&view).parse().unwrap();
        assert_eq!(spec, spec::CameraSpec::LookAt { eye: view.eye, target: view.target });
        assert_eq!(quoted(Path::new("a/b.ply")), "a/b.ply");
        assert_eq!(quoted(Path::new("my demo/b.ply")), "\"my demo/b.ply\"");
    }
}
