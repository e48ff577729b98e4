//! Training steps, measured on a scene's own splats.

use super::args::BenchArgs;
use super::measure::{Clock, INCOMPLETE, Rounds, Timing, WARM_UP};
use crate::interrupt;
use crate::progress;
use crate::scene::RunArgs;
use anyhow::Result;
use serde::Serialize;
use weather_magician::train::config::{Densify, FixedConfig, RateConfig};
use weather_magician::train::{Preset, StepTimes, TrainConfig, TrainPhoto, TrainState, Trainer};
use weather_magician::{Camera, Device};
use wm_render::{Frame, StepClock};
use wm_scene::Splats;

/// Steps of one scene. Times are milliseconds, medians.
#[derive(Serialize)]
pub(crate) struct TrainingReport {
    scene: String,
    splats: usize,
    sh_degree: u8,
    width: u32,
    height: u32,
    visible: usize,
    threads: usize,
    wall_ms: f64,
    cpu_ms: f64,
    forward_ms: f64,
    loss_ms: f64,
    backward_ms: f64,
    optimizer_ms: f64,
    one_thread_wall_ms: f64,
    /// Median over the rounds of one thread's wall time divided by that of all threads.
    speedup: f64,
    /// Times by the device's own clock, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    device_ms: Option<DeviceTimes>,
}

/// Parts of a step on a device, ms; medians.
#[derive(Serialize)]
struct DeviceTimes {
    lists: f64,
    rasterize: f64,
    compare: f64,
    rasterize_backward: f64,
    project_backward: f64,
    optimize: f64,
}

impl DeviceTimes {
    /// Computes the medians; `None` if a step was not timed.
    fn of(steps: &Rounds<Step>) -> Option<Self> {
        let clocks: Option<Vec<StepClock>> = steps.0.iter().map(|step| step.clock).collect();
        let clocks = Rounds(clocks.filter(|clocks| !clocks.is_empty())?);
        let of = |value: fn(&StepClock) -> f64| 1e3 * clocks.median(value);
        Some(Self {
            lists: of(|clock| clock.lists),
            rasterize: of(|clock| clock.rasterize),
            compare: of(|clock| clock.compare),
            rasterize_backward: of(|clock| clock.rasterize_backward),
            project_backward: of(|clock| clock.project_backward),
            optimize: of(|clock| clock.optimize),
        })
    }
}

/// One step.
struct Step {
    wall: f64,
    cpu: f64,
    times: StepTimes,
    visible: usize,
    clock: Option<StepClock>,
}

/// Returns a trainer that does not change: its step length is zero.
fn standing(splats: &Splats, run: &RunArgs) -> Result<Trainer> {
    let least = 1e-15;
    let config = TrainConfig {
        steps: u32::MAX,
        sh_degree: splats.sh_degree,
        sh_every: 1,
        densify: Densify::Fixed(FixedConfig {}),
        rates: RateConfig {
            means_first: least,
            means_last: least,
            quats: least,
            log_scales: least,
            logit_opacities: least,
            sh_dc: least,
            sh_rest: least,
            exposure: least,
        },
        ..TrainConfig::preset(Preset::Quick)
    };
    // As after the steps in which the harmonics grow.
    let mut state = TrainState::new(splats.clone(), 1);
    state.step = u32::from(splats.sh_degree);
    Ok(Trainer::resumed(config, run.differentiable()?, state, 1.0, 1))
}

/// Measures steps on one photo: a render of the scene from `camera`, a fifth darker.
pub(crate) fn measure(
    name: &str,
    splats: &Splats,
    camera: &Camera,
    args: &BenchArgs,
) -> Result<TrainingReport> {
    let one = RunArgs { device: Device::Cpu, threads: Some(1), simd: args.run.simd };
    let mut trainers = [standing(splats, &args.run)?, standing(splats, &one)?];
    let mut frame = Frame::default();
    trainers[0].render(camera, &mut frame)?;
    let rgb: Vec<f32> = frame.rgb.iter().map(|v| 0.8 * v).collect();
    let truth = TrainPhoto { rgb: &rgb, mask: None, camera, prior: None };
    let bar = progress::bar(u64::from(args.frames), "steps");
    let mut steps: [Rounds<Step>; 2] = Default::default();
    for round in 0..args.frames + WARM_UP {
        for (trainer, steps) in trainers.iter_mut().zip(&mut steps) {
            interrupt::check(INCOMPLETE)?;
            // A GPU goes on with a step after the call, and the next call waits for it: it must
            // find the rest of a step.
            trainer.step(&truth, 0)?;
            let clock = Clock::start();
            let report = trainer.step(&truth, 0)?;
            let Timing { wall, cpu } = clock.stop();
            if round >= WARM_UP {
                let clock = trainer.clock();
                steps.0.push(Step { wall, cpu, times: report.times, visible: report.visible, clock });
            }
        }
        if round >= WARM_UP {
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let [all, one] = &steps;
    let of = |value: fn(&Step) -> f64| 1e3 * all.median(value);
    Ok(TrainingReport {
        scene: name.to_owned(),
        splats: splats.len(),
        sh_degree: splats.sh_degree,
        width: camera.width,
        height: camera.height,
        visible: all.0.first().map_or(0, |step| step.visible),
        threads: trainers[0].threads(),
        wall_ms: of(|step| step.wall),
        cpu_ms: of(|step| step.cpu),
        forward_ms: of(|step| step.times.forward),
        loss_ms: of(|step| step.times.loss),
        backward_ms: of(|step| step.times.backward),
        optimizer_ms: of(|step| step.times.optimizer),
        one_thread_wall_ms: 1e3 * one.median(|step| step.wall),
        speedup: one.ratio(all, |step| step.wall),
        device_ms: DeviceTimes::of(all),
    })
}

/// Prints a line per scene, and the growth of CPU time from the first scene to each of the others.
pub(crate) fn print(reports: &[TrainingReport]) {
    println!("Medians over steps of training, ms: L1 and SSIM of the scene's colour against one photo.");
    println!(
        "{:<24} {:>9} {:>9} {:>10} {:>7} {:>7} {:>7} {:>5} {:>8} {:>9} {:>8} {:>7} {:>9}",
        "scene",
        "splats",
        "in view",
        "px",
        "wall",
        "CPU",
        "forward",
        "loss",
        "backward",
        "optimiser",
        "1 thread",
        "speedup",
        "CPU ratio"
    );
    for report in reports {
        println!(
            "{:<24} {:>9} {:>9} {:>10} {:>7.1} {:>7.1} {:>7.1} {:>5.1} {:>8.1} {:>9.1} {:>8.1} {:>7.2} {:>9.2}",
            report.scene,
            report.splats,
            report.visible,
            format!("{}x{}", report.width, report.height),
            report.wall_ms,
            report.cpu_ms,
            report.forward_ms,
            report.loss_ms,
            report.backward_ms,
            report.optimizer_ms,
            report.one_thread_wall_ms,
            report.speedup,
            report.cpu_ms / reports[0].cpu_ms,
        );
    }
    for TrainingReport { scene, device_ms, .. } in reports {
        if let Some(times) = device_ms {
            let DeviceTimes { lists, rasterize, compare, rasterize_backward, project_backward, optimize } =
                times;
            println!(
                "{scene}, by the GPU's clock: tile lists {lists:.2}, pictures {rasterize:.2}, compared {compare:.2}, back \
                 to slots {rasterize_backward:.2}, to gradients {project_backward:.2}, moved {optimize:.2}"
            );
        }
    }
}
