//! The share of each leaf that nothing hides.

use super::{LevelCut, coverage};
use wm_render::{DrawPass, Frame, MedianDepth, Outputs, RenderBackend, RenderConfig, RenderError, SetView};
use wm_scene::{Camera, Rasterization, Splats, levels::LevelIndex};

/// Longest side of the picture, px.
const LONGEST: u32 = 480;
/// Weight of a leaf that is hidden: the picture is small and its splats are coarse, so that a gap in what hides it may not show.
const HIDDEN: f64 = 0.01;

/// Returns a weight of each leaf for [`LevelCut::weighted`], 0-1: the share of its pixels where it, and no other leaf, is at the median depth.
///
/// `splats` are those of all leaves as `cut` has them, in the order of [`LevelCut::runs`]: the coarsest cut is enough. One small
/// picture is rendered. For several cameras, take the largest weight of each leaf.
///
/// # Errors
/// [`RenderError`] if it cannot be rendered.
pub fn seen_shares(
    index: &LevelIndex,
    cut: &LevelCut,
    splats: &Splats,
    camera: &Camera,
    rasterization: Rasterization,
    renderer: &mut dyn RenderBackend,
) -> Result<Vec<f64>, RenderError> {
    let scale = (f64::from(LONGEST) / f64::from(camera.width.max(camera.height))).min(1.0);
    let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    let small = camera.resized(side(camera.width), side(camera.height));
    let outputs = Outputs { median_depth: MedianDepth::Splat, ..Outputs::default() };
    let config = RenderConfig { outputs, rasterization, ..RenderConfig::default() };
    let mut frame = Frame::default();
    renderer.render(&DrawPass::new(&[SetView::transient(splats)], &small, &config), &mut frame)?;
    let runs: Vec<(usize, u64)> = cut
        .runs(index)
        .scan(0, |end, (leaf, run)| {
            *end += run.count;
            Some((leaf, *end))
        })
        .collect();
    let mut seen = vec![0_u32; index.leaves.len()];
    for splat in (0..frame.pixels()).filter_map(|pixel| frame.median_splat(pixel)) {
        let run = runs.partition_point(|(_, end)| *end <= u64::from(splat));
        if let Some((leaf, _)) = runs.get(run) {
            seen[*leaf] += 1;
        }
    }
    let share = |(seen, leaf): (&u32, &wm_scene::levels::LevelLeaf)| {
        let area = coverage(leaf.low, leaf.high, &small);
        if area > 0.0 { (f64::from(*seen) / area).clamp(HIDDEN, 1.0) } else { 0.0 }
    };
    Ok(seen.iter().zip(&index.leaves).map(share).collect())
}
