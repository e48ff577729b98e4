//! `bench`: rendering speed of scenes, as times and as ratios of cases that take turns.
//!
//! Cases of one scene are measured in rounds, one frame of each per round, and compared round by
//! round, so that other load on the machine slows both sides of a ratio. CPU time is that of the
//! process. With `--training` training steps are measured, on all threads and on one in turns; with
//! `--sensors` lidar sweeps and fisheyes.

mod measure;
pub(crate) mod paper;
mod report;
mod sensors;
mod training;

use crate::interrupt;
use crate::names::stem_of;
use crate::output::print_json;
use crate::overwrite::OverwriteArgs;
use crate::progress::Reporter;
use crate::scene::{AssetFolder, OpenScene, RunArgs, SceneArgs, read_saying_remarks};
use anyhow::{Context, Result};
use clap::Args;
use glam::DVec3;
use measure::{BenchCase, BenchTarget, FrameTimings, peak_memory, turns};
use report::{MeasuredCases, PathSpeed, SceneReport, ThreadsReport};
use serde::Serialize;
use std::path::{Path, PathBuf};
use weather_magician::formats::ReadOptions;
use weather_magician::view::ViewOptions;
use weather_magician::view::spec::{self, CameraSpec};
use weather_magician::{Camera, Device, Metadata, PlaceOptions, PreparedPlace, Renderer, Scene};
use wm_render::bench_scene::{shell_camera, shell_splats};
use wm_render::simd::SimdPath;
use wm_render::{RenderBackend, RenderConfig, SetId, SetView};
use wm_scene::{Group, Lamp};
use wm_weather::Site;
use wm_weather::cover::Buried;

/// Options of `bench`.
#[derive(Args, Clone, Debug)]
pub(crate) struct BenchArgs {
    /// Scenes to render, one after the other [default: a synthetic one with --splats]
    scenes: Vec<PathBuf>,
    /// Number of splats of the synthetic scene
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..=50_000_000))]
    splats: u32,
    /// SH degree of the synthetic scene
    #[arg(long, value_name = "DEGREE", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// Camera: EYE:TARGET as X,Y,Z:X,Y,Z, or a photo's name or number [default: chosen
    /// automatically]
    #[arg(short, long, value_name = "CAMERA", allow_hyphen_values = true)]
    camera: Option<CameraSpec>,
    /// Picture size, px
    #[arg(long, value_name = "WxH", value_parser = spec::parse_size, default_value = "1200x800")]
    size: (u32, u32),
    /// Vertical field of view, degrees [default: 50, or the photo's]
    #[arg(long, value_name = "DEGREES")]
    fov: Option<f64>,
    /// Number of rounds to measure, after two warm-up rounds
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Measure only rgb and the cases whose name contains this, such as rain, or one of several;
    /// skips threads and SIMD paths
    #[arg(long, value_name = "TEXT")]
    cases: Vec<String>,
    /// Do not render the splats of the sky
    #[arg(long)]
    drop_sky: bool,
    /// Measure training steps instead of frames
    #[arg(long)]
    training: bool,
    /// Measure lidar sweeps and pictures through a fisheye instead of frames
    #[arg(long, conflicts_with_all = ["training", "cases"])]
    sensors: bool,
    /// Measure the paper's Table I (frames a second in clear air, fog, rain or snowfall, and snow
    /// cover) and print it with the paper's numbers as Markdown
    #[arg(long, conflicts_with_all = ["training", "sensors", "cases"])]
    paper: bool,
    /// Devices of the table, as for --device, such as cpu,gpu [default: the one of --device]
    #[arg(long, value_name = "LIST", value_delimiter = ',', requires = "paper")]
    devices: Vec<Device>,
    /// Write the table as speed.md, .csv and .json into this folder, with plots as SVG
    #[arg(long, value_name = "FOLDER", requires = "paper")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    run: RunArgs,
}

/// Runs the command.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    if args.paper {
        return paper::run(args);
    }
    if args.training {
        let reports = each(args, |name, loaded, camera| {
            training::measure(name, &loaded.place.scene().splats, &camera, args)
        })?;
        return show(args, &reports, training::print);
    }
    if args.sensors {
        let reports = each(args, |name, loaded, camera| sensors::measure(name, loaded, &camera, args))?;
        return show(args, &reports, sensors::print);
    }
    let reports = each(args, |name, loaded, camera| measure_scene(name, loaded, camera, args))?;
    show(args, &reports, report::print)
}

/// Prints reports as JSON, or by `print` for people.
fn show<R: Serialize>(args: &BenchArgs, reports: &[R], print: impl FnOnce(&[R])) -> Result<()> {
    if args.json {
        return print_json(reports);
    }
    print(reports);
    Ok(())
}

/// The error of a measurement that was stopped.
pub(crate) const INCOMPLETE: &str = "the measurement is not complete";

/// Calls `measure` for each scene with its name, the scene and the camera.
fn each<R>(
    args: &BenchArgs,
    mut measure: impl FnMut(&str, &mut OpenScene, Camera) -> Result<R>,
) -> Result<Vec<R>> {
    if args.scenes.is_empty() {
        let (mut loaded, camera) = made_up(args)?;
        return Ok(vec![measure(&format!("synthetic, {} splats", args.splats), &mut loaded, camera)?]);
    }
    let of = |path: &PathBuf| {
        let (mut loaded, camera) = real(path, args)?;
        measure(&stem_of(path), &mut loaded, camera)
    };
    args.scenes.iter().map(of).collect()
}

fn made_up(args: &BenchArgs) -> Result<(OpenScene, Camera)> {
    /// Splats over each pixel, about as many as in trained scenes.
    const SPLATS_PER_PIXEL: f64 = 60.0;
    /// Height above which 98 % of the splats lie, scene units.
    const GROUND_HEIGHT: f64 = -13.6;
    let splats = shell_splats(args.splats as usize, SPLATS_PER_PIXEL, args.sh_degree, 1);
    // All facts are given, so that none is guessed; the ground lies below nearly all splats.
    let facts = Metadata {
        metres_per_unit: Some(1.0),
        up: Some(DVec3::Z),
        ground: Some(GROUND_HEIGHT),
        ..Metadata::default()
    };
    let scene = Scene { splats, ..Scene::default() };
    let camera = shell_camera(args.size.0, args.size.1);
    Ok((OpenScene::of(scene, &facts, &args.run)?, camera))
}

fn real(path: &Path, args: &BenchArgs) -> Result<(OpenScene, Camera)> {
    let read = SceneArgs {
        scene: path.to_owned(),
        repair: true,
        assets: Some(AssetFolder::Off),
        ..SceneArgs::default()
    };
    let mut loaded = if args.drop_sky {
        let mut scene = read_saying_remarks(path, &ReadOptions::default())?;
        wm_scene::survey::label_sky(&mut scene.splats);
        let groups = &scene.splats.groups;
        let rest: Vec<usize> = (0..groups.len()).filter(|i| groups[*i] != Group::Sky).collect();
        scene.splats = scene.splats.select(&rest);
        OpenScene::of(scene, &Metadata::default(), &args.run)?
    } else {
        OpenScene::new(&read, &args.run, None)?
    };
    let options = ViewOptions { up: None, fov: args.fov, near: None, size: Some(args.size) };
    let camera = loaded.camera(args.camera.as_ref(), &options)?;
    Ok((loaded, camera))
}

/// A scene and its cover, in a renderer of its own.
struct SnowyScene {
    renderer: Renderer,
    /// The splat sets of the scene and its cover.
    sets: [SetId; 2],
    buried: Buried,
}

impl SnowyScene {
    fn new(loaded: &mut OpenScene, case: &BenchCase, run: &RunArgs) -> Result<Self> {
        let OpenScene { renderer, place } = loaded;
        let lying = renderer.lying_cover(place, &case.weather, 0.0, &mut Reporter::default())?;
        let lying = lying.with_context(|| format!("the case {} has no cover", case.name))?;
        let mut renderer = run.renderer()?;
        let backend = renderer.backend_mut();
        let sets = [backend.load(&place.scene().splats)?, backend.load(&lying.splats)?];
        Ok(Self { renderer, sets, buried: lying.buried })
    }
}

/// A second copy of the scene, with lamps in view and its light split into sun and sky.
struct LitScene {
    renderer: Renderer,
    place: PreparedPlace,
}

impl LitScene {
    fn new(loaded: &OpenScene, camera: &Camera, cases: &[&BenchCase], run: &RunArgs) -> Result<Self> {
        let scene = Scene::clone(loaded.place.scene());
        let mut renderer = run.renderer()?;
        let facts = loaded.place.survey().metadata();
        let mut place =
            renderer.load_with(scene, &PlaceOptions { facts, assets: None, ..PlaceOptions::default() })?;
        place.background = loaded.place.background;
        place.rasterization = loaded.place.rasterization;
        renderer.set_lamps(&mut place, lamps(camera, loaded.place.site()), Vec::new())?;
        for case in cases {
            renderer.prepare(&mut place, &case.weather, &mut Reporter::default())?;
        }
        Ok(Self { renderer, place })
    }
}

/// Ten lamps in two rows along the view, 2 m above the camera.
fn lamps(camera: &Camera, site: &Site) -> Vec<Lamp> {
    const DISTANCES_AHEAD_M: [f64; 5] = [6.0, 10.0, 15.0, 22.0, 30.0];
    let metre = 1.0 / site.metres_per_unit;
    let up = DVec3::from_array(site.up);
    let forward = camera.forward().reject_from(up).try_normalize().unwrap_or(up.any_orthonormal_vector());
    let right = forward.cross(up);
    let at = |ahead: f64, aside: f64| camera.center() + (forward * ahead + right * aside + up * 2.0) * metre;
    let row = |aside: f64| DISTANCES_AHEAD_M.map(|ahead| Lamp::new(at(ahead, aside).to_array()));
    [row(-3.0), row(3.0)].concat()
}

/// Returns the cases of a scene.
fn cases(loaded: &OpenScene) -> Result<Vec<BenchCase>> {
    let PreparedPlace { background, rasterization, .. } = loaded.place;
    BenchCase::all(loaded.place.site(), |outputs| RenderConfig { outputs, background, rasterization })
}

/// Renders cases in turns, each on the scene with the cover of its weather.
fn in_turns(
    loaded: &mut OpenScene,
    camera: &Camera,
    cases: &[BenchCase],
    run: &RunArgs,
    rounds: u32,
) -> Result<Vec<FrameTimings>> {
    // The first target is the bare scene, the second, if there is one, is lit by the weather.
    let lit: Vec<&BenchCase> = cases.iter().filter(|case| case.needs_place()).collect();
    let mut lit = if lit.is_empty() { None } else { Some(LitScene::new(loaded, camera, &lit, run)?) };
    let mut snowy = Vec::new();
    let mut plan: Vec<(usize, &BenchCase)> = Vec::new();
    for case in cases {
        let is_bare = case.cover().is_empty() && case.paper_cover().is_none();
        if !is_bare {
            snowy.push(SnowyScene::new(loaded, case, run)?);
        }
        plan.push(match (case.needs_place(), is_bare) {
            (true, _) => (1, case),
            (false, true) => (0, case),
            (false, false) => (usize::from(lit.is_some()) + snowy.len(), case),
        });
    }
    let mut stands = vec![BenchTarget::plain(&mut loaded.renderer, loaded.place.set())];
    if let Some(LitScene { renderer, place }) = &mut lit {
        stands.push(BenchTarget::Place { renderer, place });
    }
    for SnowyScene { renderer, sets: [scene, snow], buried } in &mut snowy {
        let scene = SetView::plain(*scene).with_attributes(Some(buried));
        stands.push(BenchTarget::Sets { renderer, sets: vec![scene, SetView::plain(*snow)] });
    }
    turns(&mut stands, camera, &plan, rounds, "rounds")
}

/// Measures the cases, the threads and the SIMD paths of a scene.
fn measure_scene(
    name: &str,
    loaded: &mut OpenScene,
    camera: Camera,
    args: &BenchArgs,
) -> Result<SceneReport> {
    let mut cases = cases(loaded)?;
    if args.cases.is_empty() {
        // Those of the paper's table alone.
        cases.retain(|case| !case.is_of_table());
    } else {
        cases = BenchCase::named(cases, &args.cases)?;
    }
    let rounds = args.frames;
    let (full, rgb) = (BenchCase::position(&cases, "rgb+depth+normal"), BenchCase::position(&cases, "rgb"));
    // Memory is that of one renderer: it is told before there is another.
    let plain: Vec<(usize, &BenchCase)> = cases
        .iter()
        .filter(|case| case.cover().is_empty() && !case.needs_place())
        .map(|case| (0, case))
        .collect();
    let alone = BenchTarget::plain(&mut loaded.renderer, loaded.place.set());
    turns(&mut [alone], &camera, &plain, 0, "rounds")?;
    let memory = peak_memory();
    let measured = in_turns(loaded, &camera, &cases, &args.run, rounds)?;
    let measured = MeasuredCases { cases: &cases, frames: &measured };
    // Threads and SIMD paths are the CPU's.
    if (!args.cases.is_empty() || loaded.renderer.backend().is_gpu()) && !interrupt::asked() {
        return Ok(SceneReport::new(name, loaded, &camera, measured, None, Vec::new(), memory));
    }

    // One thread against all, in the same rounds.
    let one = RunArgs { device: Device::Cpu, threads: Some(1), simd: args.run.simd };
    let mut single = one.renderer()?;
    let set = single.backend_mut().load(&loaded.place.scene().splats)?;
    let threads = loaded.renderer.backend().threads();
    let mut stands =
        [BenchTarget::plain(&mut loaded.renderer, loaded.place.set()), BenchTarget::plain(&mut single, set)];
    let pair = turns(&mut stands, &camera, &[(0, &cases[full]), (1, &cases[full])], rounds, "threads")?;
    drop(single);

    // Every SIMD path on one thread; the slow ones in fewer rounds.
    let mut paths = Vec::new();
    for path in SimdPath::available() {
        let mut renderer = RunArgs { simd: path.choice(), ..one.clone() }.renderer()?;
        let set = renderer.backend_mut().load(&loaded.place.scene().splats)?;
        let mut stands = [BenchTarget::plain(&mut renderer, set)];
        let plan = [(0, &cases[rgb]), (0, &cases[full])];
        let frames = turns(&mut stands, &camera, &plan, rounds.min(8), "paths")?;
        paths.push(PathSpeed::new(path.to_string(), &frames[0], &frames[1]));
    }
    interrupt::check(INCOMPLETE)?;
    let threads = ThreadsReport::new(threads, &pair[0], &pair[1]);
    Ok(SceneReport::new(name, loaded, &camera, measured, Some(threads), paths, memory))
}
