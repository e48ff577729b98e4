//! How far the depth of a reconstruction is from the truth of a made-up data set.
//!
//! ```text
//! weather-magician demo --photos street/
//! weather-magician reconstruct street/ -o street.ply --metres-per-unit 1 --eval-every 8
//! cargo run --release -p wm-train --example depth_error -- street.ply street/ 8
//! ```
//!
//! Every N-th photo counts, from the first on: those that the training held out. Errors are relative,
//! |depth - truth| / truth, over pixels whose centre is not sky; a pixel without depth counts as an error of 1.

use std::error::Error;
use std::path::Path;
use wm_render::{CpuConfig, CpuRenderer, Frame, Geometry, Job, MedianDepth, Outputs, RenderConfig, Renderer};
use wm_render::{SetView, hooks::Hooks};
use wm_scene::capture::{CaptureOptions, read};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::npy;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [scene, dataset, every] = &args[..] else { return Err("which scene, data set and N?".into()) };
    let (dataset, every): (&Path, usize) = (dataset.as_ref(), every.parse()?);
    let scene = read_scene(Path::new(scene), &ReadOptions::default())?;
    let capture = read(dataset, &CaptureOptions::default())?;
    let mut renderer = CpuRenderer::new(CpuConfig::default())?;
    let sets = [SetView::plain(renderer.load(&scene.splats)?)];
    let outputs = Outputs { geometry: Geometry::Depth, median_depth: MedianDepth::On };
    let config = RenderConfig { outputs, ..RenderConfig::default() };
    let (mut expected, mut median, mut frame) = (Vec::new(), Vec::new(), Frame::default());
    for view in capture.views.iter().step_by(every.max(1)) {
        let job = Job { sets: &sets, camera: &view.camera, config: &config, hooks: Hooks::default() };
        renderer.render(&job, &mut frame)?;
        let (truth, _) = npy::read(&dataset.join("truth/depth").join(&view.name).with_extension("npy"))?;
        for (pixel, truth) in truth.iter().enumerate().filter(|(_, truth)| **truth > 0.0) {
            expected.push(((frame.depth[pixel] - truth) / truth).abs().min(1e3));
            median.push(((frame.median_depth[pixel] - truth) / truth).abs().min(1e3));
        }
    }
    for (name, mut errors) in [("expected", expected), ("median", median)] {
        errors.sort_by(f32::total_cmp);
        let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
        let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
        println!(
            "{name} depth: error median {:.4}, mean {mean:.4}, 90th percentile {:.4}, of {} pixels",
            at(0.5),
            at(0.9),
            errors.len()
        );
    }
    Ok(())
}
