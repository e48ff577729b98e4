//! `scan`: sweeps of a lidar or a radar through a scene under a weather.

use super::render::camera::{DEFAULT_SECONDS, check_camera, motion};
use crate::choices::{Choice, first_given, one_of};
use crate::level_args::LevelArgs;
use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::progress::Reporter;
use crate::scene::{OpenScene, OwnSkyArgs, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Result, anyhow, bail};
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use weather_magician::MotionSpec;
use weather_magician::lidar::{
    EchoClass, LidarModel, LidarSweep, PRESETS, PointFormat, PointFrame, ReturnMode, ScanOptions, SubRays,
    SweepView, about,
};
use weather_magician::radar::{
    RADAR_PRESETS, RadarClass, RadarModel, RadarScanOptions, RadarSweep, RadarView,
};
use weather_magician::view::ViewOptions;
use weather_magician::view::moves::PathSpec;
use weather_magician::view::spec::CameraSpec;
use wm_base::files::check_writable;
use wm_image::MediaError;

/// Options of `scan`.
#[derive(Args, Debug)]
#[command(after_long_help = help())]
pub(crate) struct ScanArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    sky: OwnSkyArgs,
    #[command(flatten)]
    levels: LevelArgs,
    #[command(flatten)]
    weather: WeatherArgs,
    #[command(flatten)]
    lidar: LidarArgs,
    #[command(flatten)]
    place: SensorPlaceArgs,
    #[command(flatten)]
    output: PointArgs,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    run: RunArgs,
}

/// The lidar of a scan that names no sensor.
const DEFAULT_LIDAR: &str = "os1-64";

/// The lidar and its pulses, or the radar.
#[derive(Args, Debug)]
struct LidarArgs {
    /// The lidar: a name from the list below (--help), or a TOML file [default: os1-64]
    #[arg(short, long, value_name = "NAME|FILE", help_heading = "Lidar")]
    lidar: Option<String>,
    /// Rays of a pulse: 1, or 7 over its divergence [default: 7]
    #[arg(long, value_name = "N", value_parser = one_of(SUB_RAYS), help_heading = "Lidar")]
    sub_rays: Option<SubRays>,
    /// Returns of a pulse that become points [default: strongest]
    #[arg(long, value_parser = one_of(RETURNS), help_heading = "Lidar")]
    returns: Option<ReturnMode>,
    /// Extinction over backscatter of fog, haze and smog, sr [default: 18 of fog, 50 of haze and
    /// smog]
    #[arg(long, value_name = "SR", allow_negative_numbers = true, help_heading = "Lidar")]
    lidar_ratio: Option<f64>,
    /// Scan with a radar instead (plausible, not validated): a name from the list below (--help),
    /// or a TOML file
    #[arg(long, value_name = "NAME|FILE", help_heading = "Radar")]
    radar: Option<String>,
    /// Seed of the noise of ranges and of detection
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Sensor")]
    seed: u64,
}

/// The place of the sensor over time.
#[derive(Args, Debug)]
#[command(next_help_heading = "Sensor")]
struct SensorPlaceArgs {
    /// Place of the sensor, which stands upright: EYE:TARGET as X,Y,Z:X,Y,Z, a photo's name or
    /// number, or a JSON file of keyframes [default: a view chosen automatically]
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    at: Option<CameraSpec>,
    /// COLMAP model with the photos' cameras that --at may name
    #[arg(long, value_name = "FOLDER")]
    views: Option<PathBuf>,
    /// Move the sensor: orbit, dolly, capture (along the photos), or a JSON file of keyframes
    #[arg(short, long, value_name = "PATH")]
    path: Option<PathSpec>,
    /// Duration of an orbit, a dolly or a capture, seconds [default: 5]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Forward speed of a sensor without a path, m/s
    #[arg(long, value_name = "M/S", allow_negative_numbers = true)]
    speed: Option<f64>,
}

/// The points and where they go.
#[derive(Args, Debug)]
#[command(next_help_heading = "Output")]
struct PointArgs {
    /// Output: points as .ply, .pcd, .npy, .las or KITTI's .bin, of a radar as .ply, .pcd or .npy;
    /// several sweeps get numbers [default: a .ply named after scene and weather, in this folder]
    #[arg(short, long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Pictures of each sweep, as PNG beside the points: range, intensity, above; of a radar above
    /// (by velocity), rcs
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    picture: Vec<String>,
    /// Axes of the points: compensated are those of the sensor at the start of the sweep, raw those
    /// at each pulse, world those of the scene in metres
    #[arg(long, value_parser = one_of(FRAMES), default_value = "compensated")]
    frame: PointFrame,
    /// Time of the start, of the weather and along the path, seconds
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    time: f64,
    /// Number of sweeps, one after the other
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sweeps: u32,
}

/// Rays of a pulse.
const SUB_RAYS: &[Choice<SubRays>] =
    &[("1", "One, in the middle", SubRays::One), ("7", "Seven over the divergence", SubRays::Seven)];
/// Returns of a pulse.
const RETURNS: &[Choice<ReturnMode>] = &[
    ("strongest", "The strongest", ReturnMode::Strongest),
    ("first", "The first", ReturnMode::First),
    ("last", "The last", ReturnMode::Last),
    ("dual", "The strongest and the last, once if they are the same", ReturnMode::Dual),
    ("all", "All that are detected", ReturnMode::All),
];
/// Axes of the points.
const FRAMES: &[Choice<PointFrame>] = &[
    ("compensated", "Those of the sensor at the start of the sweep", PointFrame::Compensated),
    ("raw", "Those of the sensor at each pulse", PointFrame::Raw),
    ("world", "Those of the scene, in metres", PointFrame::World),
];

impl From<&ScanArgs> for RadarScanOptions {
    fn from(args: &ScanArgs) -> Self {
        Self { time: args.output.time, seed: args.lidar.seed, frame: args.output.frame, ..Self::default() }
    }
}

impl From<&ScanArgs> for ScanOptions {
    fn from(args: &ScanArgs) -> Self {
        Self {
            time: args.output.time,
            seed: args.lidar.seed,
            sub_rays: args.lidar.sub_rays.unwrap_or_default(),
            returns: args.lidar.returns.unwrap_or_default(),
            frame: args.output.frame,
            lidar_ratio: args.lidar.lidar_ratio,
            ..Self::default()
        }
    }
}

/// The lidars and the radars, and the weathers and their parameters.
fn help() -> String {
    let mut text = String::from("Lidars:\n");
    for (name, preset) in PRESETS {
        let _ = writeln!(text, "  {name:<18}{}", about(preset));
    }
    text += "\nRadars:\n";
    for (name, preset) in RADAR_PRESETS {
        let _ = writeln!(text, "  {name:<18}{}", about(preset));
    }
    text + "\n" + &wm_weather::reference_page::help()
}

impl ScanArgs {
    /// Checks the options that do not depend on the scene.
    fn check(&self) -> Result<()> {
        let numbers =
            [("time", Some(self.output.time)), ("speed", self.place.speed), ("seconds", self.place.seconds)];
        for (name, value) in numbers {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                bail!("--{name} {value}: must be a number");
            }
        }
        if let Some(seconds) = self.place.seconds.filter(|seconds| *seconds <= 0.0) {
            bail!("--seconds {seconds}: must be above 0");
        }
        if self.place.speed.is_some() && self.place.path.is_some() {
            bail!("--speed: cannot be used with --path, which sets the speed");
        }
        if self.place.speed.is_some_and(|speed| speed.abs() > 1000.0) {
            bail!("--speed: must be from -1000 to 1000 m/s");
        }
        if let Some(ratio) = self.lidar.lidar_ratio.filter(|ratio| !(1.0..=1000.0).contains(ratio)) {
            bail!("--lidar-ratio {ratio}: must be from 1 to 1000 sr");
        }
        if self.lidar.radar.is_some() {
            let refused = first_given([
                (self.lidar.lidar.is_some(), "--lidar"),
                (self.lidar.sub_rays.is_some(), "--sub-rays"),
                (self.lidar.returns.is_some(), "--returns"),
                (self.lidar.lidar_ratio.is_some(), "--lidar-ratio"),
            ]);
            if let Some(option) = refused {
                bail!("{option}: is not for a radar; leave it or --radar out");
            }
        }
        Ok(())
    }
}

/// The names of the files of sweeps.
struct SweepNames<'a> {
    /// The name of the points of a single sweep.
    out: &'a Path,
    /// Number of sweeps; with more than one the names have numbers.
    sweeps: u32,
}

impl SweepNames<'_> {
    /// Returns the file of the points of sweep `index`.
    fn points(&self, index: u32) -> PathBuf {
        self.file(index, "", &self.out.extension().unwrap_or_default().to_string_lossy())
    }

    /// Returns the file of a picture of sweep `index`.
    fn picture(&self, index: u32, view: &str) -> PathBuf {
        self.file(index, &format!("-{view}"), "png")
    }

    fn file(&self, index: u32, what: &str, extension: &str) -> PathBuf {
        let stem = self.out.file_stem().unwrap_or_default().to_string_lossy();
        let number = if self.sweeps > 1 { format!("-{index:05}") } else { String::new() };
        self.out.with_file_name(format!("{stem}{number}{what}.{extension}"))
    }
}

/// The sensor of a scan, with the pictures of its sweeps.
enum Scanner {
    Lidar(LidarModel, Vec<SweepView>),
    Radar(RadarModel, Vec<RadarView>),
}

impl Scanner {
    fn of(args: &ScanArgs) -> Result<Self> {
        fn views<T: std::str::FromStr<Err = String>>(names: &[String]) -> Result<Vec<T>> {
            names.iter().map(|name| name.parse().map_err(|fault| anyhow!("--picture: {fault}"))).collect()
        }
        let names = &args.output.picture;
        match &args.lidar.radar {
            Some(radar) => Ok(Self::Radar(RadarModel::find(radar)?, views(names)?)),
            None => {
                let name = args.lidar.lidar.as_deref().unwrap_or(DEFAULT_LIDAR);
                Ok(Self::Lidar(LidarModel::find(name)?, views(names)?))
            }
        }
    }

    /// The names of its pictures.
    fn views(&self) -> Vec<&'static str> {
        match self {
            Self::Lidar(_, views) => views.iter().map(|view| view.name()).collect(),
            Self::Radar(_, views) => views.iter().map(|view| view.name()).collect(),
        }
    }

    fn check_format(&self, out: &Path) -> Result<()> {
        match self {
            Self::Lidar(..) => drop(PointFormat::of(out)?),
            Self::Radar(..) => drop(PointFormat::of_detections(out)?),
        }
        Ok(())
    }
}

/// Writes the files of sweeps one after the other.
struct SweepFiles<'a> {
    files: SweepNames<'a>,
    index: u32,
    began: Instant,
}

impl SweepFiles<'_> {
    /// Saves the next sweep by `points`, and the picture of each name by `picture`, and says so.
    fn save<'n>(
        &mut self,
        line: &str,
        points: impl FnOnce(&Path) -> weather_magician::Result<()>,
        names: impl Iterator<Item = &'n str>,
        picture: impl Fn(usize, &Path) -> Result<(), MediaError>,
    ) -> weather_magician::Result<()> {
        let file = self.files.points(self.index);
        let seconds = self.began.elapsed().as_secs_f64();
        points(&file)?;
        println!("{}: {line}, {:.0} ms", file.display(), 1e3 * seconds);
        for (view, name) in names.enumerate() {
            let file = self.files.picture(self.index, name);
            picture(view, &file)?;
            println!("{}", file.display());
        }
        self.index += 1;
        self.began = Instant::now();
        Ok(())
    }
}

/// Runs the command.
pub(crate) fn run(args: &ScanArgs) -> Result<()> {
    // Cheap checks come before the scene is read.
    args.check()?;
    let (weather, mut inputs) = args.weather.read_with_files()?;
    let scanner = Scanner::of(args)?;
    let named = || {
        let weather = if weather.name == "clear" { String::new() } else { format!("-{}", weather.name) };
        let kind = if args.lidar.radar.is_some() { "radar" } else { "scan" };
        format!("{}{weather}-{kind}.ply", stem_of(&args.scene.scene)).into()
    };
    let out: PathBuf = args.output.out.clone().unwrap_or_else(named);
    scanner.check_format(&out)?;
    inputs.push(args.scene.scene.clone());
    inputs.extend([&args.lidar.lidar, &args.lidar.radar].into_iter().flatten().map(PathBuf::from));
    if let Some(PathSpec::File(file)) = &args.place.path {
        inputs.push(file.clone());
    }
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    let files = SweepNames { out: &out, sweeps: args.output.sweeps };
    check_writable(&files.points(0))?;
    let views = scanner.views();
    for index in 0..args.output.sweeps {
        args.overwrite.check_report(&files.points(index), &inputs)?;
        for view in &views {
            args.overwrite.check_report(&files.picture(index, view), &inputs)?;
        }
    }
    check_camera(args.place.at.as_ref())?;
    let mut loaded =
        OpenScene::in_levels(&args.scene, &args.run, args.place.views.as_ref(), args.sky, args.levels)?;
    let spec = MotionSpec {
        camera: args.place.at.clone(),
        path: args.place.path.clone(),
        speed: args.place.speed,
        seconds: args.place.seconds.unwrap_or(DEFAULT_SECONDS),
        ..MotionSpec::default()
    };
    let motion = motion(&spec, &ViewOptions::default(), &mut loaded)?;
    let OpenScene { renderer, place } = &mut loaded;
    let mut files = SweepFiles { files, index: 0, began: Instant::now() };
    let (sweeps, progress) = (args.output.sweeps, &mut Reporter::default());
    let made = match &scanner {
        Scanner::Lidar(lidar, views) => {
            let mut take = |sweep: LidarSweep| {
                let picture = |view: usize, file: &Path| views[view].draw(&sweep).save(file);
                let names = views.iter().map(|view| view.name());
                files.save(&line(&sweep), |file| Ok(sweep.save(file)?), names, picture)
            };
            let options = ScanOptions::from(args);
            renderer.scan(place, &weather, lidar, &motion, &options, sweeps, &mut take, progress)?
        }
        Scanner::Radar(radar, views) => {
            let mut take = |sweep: RadarSweep| {
                let picture = |view: usize, file: &Path| views[view].draw(&sweep).save(file);
                let names = views.iter().map(|view| view.name());
                files.save(&radar_line(&sweep), |file| Ok(sweep.save(file)?), names, picture)
            };
            let options = RadarScanOptions::from(args);
            renderer.scan_radar(place, &weather, radar, &motion, &options, sweeps, &mut take, progress)?
        }
    };
    loaded.warn();
    if made < sweeps {
        bail!(weather_magician::Error::Stopped);
    }
    Ok(())
}

/// A sweep in one line.
fn line(sweep: &LidarSweep) -> String {
    let text = format!("{}, {} points of {} pulses", sweep.name, sweep.points.len(), sweep.pulses);
    text + &counts(EchoClass::ALL.map(|class| (class.name(), sweep.count(class))))
}

/// A radar's sweep in one line.
fn radar_line(sweep: &RadarSweep) -> String {
    let [ranges, azimuths, velocities] = sweep.cells;
    let cells = format!("{ranges} x {azimuths} x {velocities} cells");
    let text = format!("{}, {} detections in {cells}", sweep.name, sweep.detections.len());
    text + &counts(RadarClass::ALL.map(|class| (class.name(), sweep.count(class))))
}

/// Lists the numbers of those classes of which there are any.
fn counts<const N: usize>(classes: [(&str, usize); N]) -> String {
    let found = classes.into_iter().filter(|(_, count)| *count > 0);
    found.map(|(class, count)| format!(", {count} {class}")).collect()
}
