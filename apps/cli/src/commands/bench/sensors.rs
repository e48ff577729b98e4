//! Sensors of a scene: lidar sweeps, and pictures through a fisheye against those of a pinhole.

use super::args::BenchArgs;
use super::measure::{Clock, INCOMPLETE, Rounds, Timing, WARM_UP};
use crate::interrupt;
use crate::progress::{self, Reporter};
use crate::scene::OpenScene;
use anyhow::Result;
use indicatif::ProgressBar;
use serde::Serialize;
use weather_magician::camera_model::{CameraModel, SensorCamera};
use weather_magician::lidar::{LidarModel, ScanOptions, SubRays};
use weather_magician::{Camera, CameraMotion, FrameRequest, LensModel, LensView, Picture, Weather};

/// The lidar: 64 rows of 1800 pulses.
const LIDAR: &str = "wavelength = 905\ndivergence = 3.0\npulse = 5\nrange = [0.5, 120]\nreference_range = 120\n\
                     range_noise = 0.02\n[rows]\nrate = 10\nbetween = [-25, 15]\ncount = 64\ncolumns = 1800\n";
const PICTURE_SIDE_PX: u32 = 1024;
/// Rain of the cases with it.
const RAIN: &str = "rain.rate=25";

/// Sensors of one scene.
#[derive(Serialize)]
pub(crate) struct SensorReport {
    scene: String,
    splats: usize,
    renderer: String,
    cases: Vec<SensorCase>,
}

/// One sensor; milliseconds, medians.
#[derive(Serialize)]
struct SensorCase {
    name: &'static str,
    wall_ms: f64,
    best_wall_ms: f64,
    cpu_ms: f64,
    /// CPU time over that of the pinhole's picture in the same weather, round by round; none for a
    /// lidar.
    #[serde(skip_serializing_if = "Option::is_none")]
    cpu_ratio: Option<f64>,
    /// Points of the last sweep; none for a picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<usize>,
}

impl SensorCase {
    fn new(
        name: &'static str,
        rounds: &Rounds<Timing>,
        against: Option<&Rounds<Timing>>,
        points: Option<usize>,
    ) -> Self {
        Self {
            name,
            wall_ms: 1e3 * rounds.median(|timing| timing.wall),
            best_wall_ms: 1e3 * rounds.best(|timing| timing.wall),
            cpu_ms: 1e3 * rounds.median(|timing| timing.cpu),
            cpu_ratio: against.map(|plain| rounds.ratio(plain, |timing| timing.cpu)),
            points,
        }
    }
}

/// Measures the sensors of a scene from a camera.
pub(crate) fn measure(
    name: &str,
    loaded: &mut OpenScene,
    camera: &Camera,
    args: &BenchArgs,
) -> Result<SensorReport> {
    let rounds = args.frames;
    let clear = Weather::clear();
    let mut rain = Weather::clear();
    rain.set_text(RAIN)?;
    let bar = progress::bar(5 * u64::from(rounds), "rounds");
    let mut cases = Vec::new();
    for (name, weather, sub_rays) in [
        ("lidar 64x1800, 1 ray", &clear, SubRays::One),
        ("lidar 64x1800, 7 rays", &clear, SubRays::Seven),
        ("lidar, 7 rays, rain 25 mm/h", &rain, SubRays::Seven),
    ] {
        let (times, points) = sweeps(loaded, camera, weather, sub_rays, rounds, &bar)?;
        cases.push(SensorCase::new(name, &times, None, Some(points)));
    }
    for (weather, names) in [
        (&clear, ["pinhole", "fisheye of 180 degrees"]),
        (&rain, ["pinhole, rain 25 mm/h", "fisheye, rain 25 mm/h"]),
    ] {
        let [pinhole, fisheye] = pictures(loaded, camera, weather, rounds, &bar)?;
        cases.push(SensorCase::new(names[0], &pinhole, Some(&pinhole), None));
        cases.push(SensorCase::new(names[1], &fisheye, Some(&pinhole), None));
    }
    bar.finish_and_clear();
    interrupt::check(INCOMPLETE)?;
    Ok(SensorReport {
        scene: name.to_owned(),
        splats: loaded.place.scene().splats.len(),
        renderer: loaded.renderer.describe(),
        cases,
    })
}

/// Times of sweeps one after the other, and the points of the last.
fn sweeps(
    loaded: &mut OpenScene,
    camera: &Camera,
    weather: &Weather,
    sub_rays: SubRays,
    rounds: u32,
    bar: &ProgressBar,
) -> Result<(Rounds<Timing>, usize)> {
    let lidar = LidarModel::parse(LIDAR, "64x1800")?;
    let motion = CameraMotion::from(*camera);
    let options = ScanOptions { sub_rays, ..ScanOptions::default() };
    let (mut times, mut points) = (Vec::new(), 0);
    let mut clock = Clock::start();
    let mut take = |sweep: weather_magician::lidar::LidarSweep| {
        times.push(clock.stop());
        points = sweep.points.len();
        drop(sweep);
        bar.inc(1);
        clock = Clock::start();
        Ok(())
    };
    let OpenScene { renderer, place } = loaded;
    let (sweeps, progress) = (rounds + WARM_UP, &mut Reporter::default());
    renderer.scan(place, weather, &lidar, &motion, &options, sweeps, &mut take, progress)?;
    times.drain(..times.len().min(WARM_UP as usize));
    Ok((Rounds(times), points))
}

/// Times of pictures of a pinhole and of a fisheye, in turns.
fn pictures(
    loaded: &mut OpenScene,
    camera: &Camera,
    weather: &Weather,
    rounds: u32,
    bar: &ProgressBar,
) -> Result<[Rounds<Timing>; 2]> {
    let (lens, round) = LensModel::fisheye((PICTURE_SIDE_PX, PICTURE_SIDE_PX), 180.0)?;
    let lens = LensView::new(lens, &round)?;
    let camera = camera.refitted(PICTURE_SIDE_PX, PICTURE_SIDE_PX);
    let (mut pinhole, mut fisheye) = (Picture::default(), Picture::default());
    let mut times = [Rounds::default(), Rounds::default()];
    let OpenScene { renderer, place } = loaded;
    let request = FrameRequest::new(weather, camera, 1.0);
    let model = CameraModel { lens: Some(lens), ..CameraModel::default() };
    let device = SensorCamera::new(model, camera.into());
    let through = FrameRequest { camera: (&device).into(), ..request };
    for round in 0..rounds + WARM_UP {
        if interrupt::asked() {
            break;
        }
        let clock = Clock::start();
        renderer.render_into(place, &request, &mut pinhole, &mut ())?;
        let first = clock.stop();
        let clock = Clock::start();
        renderer.render_into(place, &through, &mut fisheye, &mut ())?;
        let second = clock.stop();
        if round >= WARM_UP {
            times[0].0.push(first);
            times[1].0.push(second);
            bar.inc(1);
        }
    }
    Ok(times)
}

/// Prints reports as tables.
pub(crate) fn print(reports: &[SensorReport]) {
    println!(
        "Wall and CPU times are medians; ratios are of CPU time to the pinhole's picture, round by round."
    );
    println!(
        "Pictures are {PICTURE_SIDE_PX}x{PICTURE_SIDE_PX} px; the first sweeps, which sort the splats, are not counted."
    );
    for SensorReport { scene, splats, renderer, cases } in reports {
        println!("\n{scene}: {splats} splats, {renderer}");
        println!("  {:<28} {:>8} {:>8} {:>8} {:>7} {:>8}", "ms", "wall", "best", "CPU", "ratio", "points");
        for SensorCase { name, wall_ms, best_wall_ms, cpu_ms, cpu_ratio, points } in cases {
            let ratio = cpu_ratio.map_or(String::new(), |ratio| format!("{ratio:.2}"));
            let points = points.map_or(String::new(), |points| points.to_string());
            println!("  {name:<28} {wall_ms:>8.1} {best_wall_ms:>8.1} {cpu_ms:>8.1} {ratio:>7} {points:>8}");
        }
    }
}
