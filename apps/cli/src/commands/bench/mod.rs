//! `bench`: rendering speed of scenes, as times and as ratios of cases that take turns.
//!
//! Cases of one scene are measured in rounds, one frame of each per round, and compared round by
//! round, so that other load on the machine slows both sides of a ratio. CPU time is that of the
//! process. With `--training` training steps are measured, on all threads and on one in turns; with
//! `--sensors` lidar sweeps and fisheyes.

mod args;
mod measure;
pub(crate) mod paper;
mod report;
mod scene_cases;
mod scenes;
mod sensors;
mod training;

pub(crate) use args::BenchArgs;
pub(crate) use measure::INCOMPLETE;

use crate::interrupt;
use crate::output::print_json;
use crate::scene::{OpenScene, RunArgs};
use anyhow::Result;
use measure::{BenchCase, BenchTarget, peak_memory, turns};
use report::{MeasuredCases, PathSpeed, SceneReport, ThreadsReport};
use scene_cases::{cases, in_turns};
use scenes::each;
use serde::Serialize;
use weather_magician::{Camera, Device};
use wm_render::RenderBackend;
use wm_render::simd::SimdPath;

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
