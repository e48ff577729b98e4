//! The share of each leaf that nothing hides.

use super::{LevelCut, coverage};
use wm_render::{
    DrawPass, Frame, MedianDepth, Outputs, RenderBackend, RenderConfig, RenderError, SetId, SetView,
};
use wm_scene::{Camera, Rasterization, levels::LevelIndex};

/// Longest side of the picture, px.
const LONGEST: u32 = 480;
/// Weight of a leaf that is hidden: the picture is small and its splats are coarse, so that a gap in what hides it may not show.
const HIDDEN: f64 = 0.01;

/// Splats of all leaves at coarse levels, by which is told what of them a camera sees.
#[derive(Clone, Debug)]
pub struct CoarseLeaves {
    /// The splats, leaf after leaf.
    pub set: SetId,
    /// The leaves in the order of their splats, and the number of splats up to their end.
    pub ends: Vec<(usize, u64)>,
}

impl CoarseLeaves {
    /// The leaves of a cut whose splats are a set, in the order of [`LevelCut::runs`].
    #[must_use]
    pub fn of(index: &LevelIndex, cut: &LevelCut, set: SetId) -> Self {
        let runs = cut.runs(index).scan(0, |end, (leaf, run)| {
            *end += run.count;
            Some((leaf, *end))
        });
        Self { set, ends: runs.collect() }
    }

    /// Returns a weight of each leaf for [`LevelCut::weighted`], 0-1: the share of its pixels where it, and no other leaf, is at the median
    /// depth; for several cameras the largest. One small picture a camera is rendered.
    ///
    /// # Errors
    /// [`RenderError`] if it cannot be rendered.
    pub fn seen_shares(
        &self,
        index: &LevelIndex,
        cameras: &[Camera],
        rasterization: Rasterization,
        renderer: &mut dyn RenderBackend,
    ) -> Result<Vec<f64>, RenderError> {
        let outputs = Outputs { median_depth: MedianDepth::Splat, ..Outputs::default() };
        let config = RenderConfig { outputs, rasterization, ..RenderConfig::default() };
        let (mut frame, mut shares) = (Frame::default(), vec![0.0; index.leaves.len()]);
        for camera in cameras {
            let scale = (f64::from(LONGEST) / f64::from(camera.width.max(camera.height))).min(1.0);
            let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
            let small = camera.resized(side(camera.width), side(camera.height));
            renderer.render(&DrawPass::new(&[SetView::plain(self.set)], &small, &config), &mut frame)?;
            let mut seen = vec![0_u32; index.leaves.len()];
            for splat in (0..frame.pixels()).filter_map(|pixel| frame.median_splat(pixel)) {
                let run = self.ends.partition_point(|(_, end)| *end <= u64::from(splat));
                if let Some((leaf, _)) = self.ends.get(run) {
                    seen[*leaf] += 1;
                }
            }
            for ((share, seen), leaf) in shares.iter_mut().zip(seen).zip(&index.leaves) {
                let area = coverage(leaf.low, leaf.high, &small);
                if area > 0.0 {
                    *share = f64::max(*share, (f64::from(seen) / area).clamp(HIDDEN, 1.0));
                }
            }
        }
        Ok(shares)
    }
}
