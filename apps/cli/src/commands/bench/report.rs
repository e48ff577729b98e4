//! Printed and JSON reports of the benchmark.

use super::measure::{BenchCase, FrameTiming, FrameTimings};
use crate::scene::OpenScene;
use serde::Serialize;
use weather_magician::Camera;
use weather_magician::view::spec;
use wm_render::DeviceWork;

/// Measurements of one scene. Times are milliseconds.
#[derive(Serialize)]
pub(crate) struct SceneReport {
    scene: String,
    splats: usize,
    sh_degree: u8,
    camera: String,
    width: u32,
    height: u32,
    renderer: String,
    visible: u64,
    /// Pairs of a splat and a tile.
    intersections: u64,
    /// Evaluated pairs of a splat and a pixel, per pixel of the picture.
    pairs_per_pixel: f64,
    peak_memory_mb: Option<f64>,
    /// Memory used on a GPU, if its interface reports it.
    #[serde(skip_serializing_if = "Option::is_none")]
    device_memory_mb: Option<f64>,
    cases: Vec<CaseReport>,
    threads: Option<ThreadsReport>,
    paths: Vec<PathSpeed>,
}

/// Times of one case.
#[derive(Serialize)]
struct CaseReport {
    name: &'static str,
    wall_ms: f64,
    best_wall_ms: f64,
    cpu_ms: f64,
    /// CPU time divided by that of `rgb`, round by round.
    cpu_ratio: f64,
    particles: u64,
    /// Time of each stage, summed over threads.
    stages_ms: Stages,
    /// Work submitted to the GPU for a frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<DeviceWork>,
}

#[derive(Clone, Copy, Serialize)]
struct Stages {
    project: f64,
    medium: f64,
    intersect: f64,
    sort: f64,
    rasterize: f64,
    fall: f64,
    /// On the CPU, for a GPU.
    gather: f64,
    composite: f64,
}

/// Cases, `rgb` first, and the frames of each.
#[derive(Clone, Copy)]
pub(crate) struct MeasuredCases<'a> {
    /// The cases.
    pub(crate) cases: &'a [BenchCase],
    /// The frames, in the order of the cases.
    pub(crate) frames: &'a [FrameTimings],
}

/// Frames with all threads and with one, in the same rounds.
#[derive(Serialize)]
pub(crate) struct ThreadsReport {
    threads: usize,
    one_wall_ms: f64,
    all_wall_ms: f64,
    speedup: f64,
    /// CPU time with all threads divided by that with one.
    cpu_ratio: f64,
}

impl ThreadsReport {
    /// Compares the frames with all `threads` and those with one.
    pub(crate) fn new(threads: usize, all: &FrameTimings, one: &FrameTimings) -> Self {
        Self {
            threads,
            one_wall_ms: one.median(|s| s.wall * 1e3),
            all_wall_ms: all.median(|s| s.wall * 1e3),
            speedup: one.ratio(all, |s| s.wall),
            cpu_ratio: all.ratio(one, |s| s.cpu),
        }
    }
}

/// Speed of a SIMD path on one thread: CPU time of the whole stage, nanoseconds per evaluated pair.
#[derive(Serialize)]
pub(crate) struct PathSpeed {
    path: String,
    rgb_ns_per_pair: f64,
    rgb_depth_normal_ns_per_pair: f64,
    frame_cpu_ms: f64,
}

impl PathSpeed {
    /// Computes the speed from the frames of `rgb` and of `rgb+depth+normal`.
    pub(crate) fn new(path: String, rgb: &FrameTimings, full: &FrameTimings) -> Self {
        // The stage's share of the frame's CPU time: others' load moves that less than the clock.
        let pair = |FrameTiming { cpu, stats, .. }: &FrameTiming| {
            let stages = [stats.project, stats.medium, stats.intersect, stats.sort, stats.composite];
            let share = stats.rasterize / (stats.rasterize + stages.iter().sum::<f64>());
            cpu * share * 1e9 / stats.evaluated_pairs.max(1) as f64
        };
        Self {
            path,
            rgb_ns_per_pair: rgb.median(pair),
            rgb_depth_normal_ns_per_pair: full.median(pair),
            frame_cpu_ms: full.median(|s| s.cpu * 1e3),
        }
    }
}

impl SceneReport {
    /// Builds the report.
    pub(crate) fn new(
        scene: &str,
        loaded: &OpenScene,
        camera: &Camera,
        measured: MeasuredCases<'_>,
        threads: Option<ThreadsReport>,
        paths: Vec<PathSpeed>,
        peak_memory: Option<u64>,
    ) -> Self {
        let MeasuredCases { cases, frames: measured } = measured;
        let stats = measured[0].0.first().map(|sample| sample.stats).unwrap_or_default();
        let pixels = f64::from(camera.width) * f64::from(camera.height);
        let cases = cases.iter().zip(measured).map(|(case, frames)| CaseReport {
            name: case.name,
            wall_ms: frames.median(|s| s.wall * 1e3),
            best_wall_ms: frames.best(|s| s.wall * 1e3),
            cpu_ms: frames.median(|s| s.cpu * 1e3),
            cpu_ratio: frames.ratio(&measured[0], |s| s.cpu),
            particles: frames.0.first().map_or(0, |sample| sample.stats.particles),
            stages_ms: Stages {
                project: frames.median(|s| s.stats.project * 1e3),
                medium: frames.median(|s| s.stats.medium * 1e3),
                intersect: frames.median(|s| s.stats.intersect * 1e3),
                sort: frames.median(|s| s.stats.sort * 1e3),
                rasterize: frames.median(|s| s.stats.rasterize * 1e3),
                fall: frames.median(|s| s.stats.fall * 1e3),
                gather: frames.median(|s| s.stats.gather * 1e3),
                composite: frames.median(|s| s.stats.composite * 1e3),
            },
            device: frames.0.last().map(|s| s.stats.device).filter(|work| work.submissions > 0),
        });
        Self {
            scene: scene.to_owned(),
            splats: loaded.place.scene().splats.len(),
            sh_degree: loaded.place.scene().splats.sh_degree,
            camera: spec::text_of(camera, loaded.place.survey().origin),
            width: camera.width,
            height: camera.height,
            renderer: loaded.renderer.describe(),
            visible: stats.visible,
            intersections: stats.intersections,
            pairs_per_pixel: stats.evaluated_pairs as f64 / pixels,
            peak_memory_mb: peak_memory.map(|bytes| bytes as f64 * 1e-6),
            device_memory_mb: loaded.renderer.backend().device_memory().map(|bytes| bytes as f64 * 1e-6),
            cases: cases.collect(),
            threads,
            paths,
        }
    }

    fn print(&self) {
        println!("{}: {} splats, SH degree {}, {}", self.scene, self.splats, self.sh_degree, self.renderer);
        let Self { width, height, camera, visible, intersections, pairs_per_pixel, .. } = self;
        println!(
            "  {width}x{height} px from {camera}: {visible} splats in view, {intersections} pairs with tiles, \
             {pairs_per_pixel:.1} evaluated a pixel"
        );
        println!(
            "  {:<26} {:>8} {:>8} {:>8} {:>7}   project medium intersect  sort rasterize   fall composite  particles",
            "ms a frame", "wall", "best", "CPU", "ratio"
        );
        for case in &self.cases {
            let CaseReport {
                name,
                wall_ms,
                best_wall_ms,
                cpu_ms,
                cpu_ratio,
                particles,
                stages_ms: stages,
                ..
            } = case;
            let Stages { project, medium, intersect, sort, rasterize, fall, gather, composite } = stages;
            let fall = fall + gather;
            println!(
                "  {name:<26} {wall_ms:>8.1} {best_wall_ms:>8.1} {cpu_ms:>8.1} {cpu_ratio:>7.3}   {project:>7.1} \
                 {medium:>6.1} {intersect:>9.1} {sort:>5.1} {rasterize:>9.1} {fall:>6.1} {composite:>9.1} {particles:>10}"
            );
        }
        for case in &self.cases {
            if let Some(DeviceWork { dispatches, submissions, sent, returned }) = case.device {
                println!(
                    "  {:<26} {dispatches} programs in {submissions} submissions; {sent} bytes to the GPU, {returned} back",
                    case.name
                );
            }
        }
        if let Some(memory) = self.device_memory_mb {
            let each = memory * 1e6 / self.splats.max(1) as f64;
            println!("  memory taken on the GPU: {memory:.0} MB, {each:.0} bytes a splat of the scene");
        }
        if let Some(ThreadsReport { threads, one_wall_ms, all_wall_ms, speedup, cpu_ratio }) = &self.threads {
            println!(
                "  rgb+depth+normal with 1 thread {one_wall_ms:.1} ms, with {threads} {all_wall_ms:.1} ms: {speedup:.2} \
                 times faster on the clock, {cpu_ratio:.3} times the CPU time"
            );
        }
        for PathSpeed { path, rgb_ns_per_pair, rgb_depth_normal_ns_per_pair, frame_cpu_ms } in &self.paths {
            println!(
                "  {path:<9} 1 thread: blending takes {rgb_ns_per_pair:.3} ns a pair (rgb), \
                 {rgb_depth_normal_ns_per_pair:.3} (rgb+depth+normal); the frame {frame_cpu_ms:.1} ms of CPU"
            );
        }
        if let Some(memory) = self.peak_memory_mb {
            println!("  peak memory of the process with one renderer: {memory:.0} MB");
        }
    }
}

/// Prints a table per scene, and the growth of time from the first scene to each of the others.
pub(crate) fn print(reports: &[SceneReport]) {
    println!("Wall and CPU times are medians, ratios (to rgb) are of CPU time, round by round.");
    println!("Times of the stages are summed over the threads; on a GPU they are by its own clock.");
    for report in reports {
        println!();
        report.print();
    }
    let full = |report: &SceneReport| {
        report.cases.iter().find(|case| case.name == "rgb+depth+normal").map_or(f64::NAN, |case| case.cpu_ms)
    };
    if let [first, others @ ..] = reports
        && !others.is_empty()
    {
        println!("\nrgb+depth+normal beside {} ({:.1} ms of CPU)", first.scene, full(first));
        for other in others {
            let splats = other.splats as f64 / first.splats.max(1) as f64;
            println!(
                "  {}: {splats:.2} times the splats, {:.2} times the CPU time",
                other.scene,
                full(other) / full(first)
            );
        }
    }
}
