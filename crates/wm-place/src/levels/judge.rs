//! The errors of a leaf's levels: how far its pictures are from those of its finest level.

use super::coverage;
use glam::DVec3;
use wm_render::{
    Background, CpuRenderer, DrawPass, Frame, RenderBackend, RenderConfig, RenderError, SetView,
};
use wm_scene::{Camera, Rasterization, Splats};

/// Number of directions that a leaf is seen from.
const VIEW_COUNT: usize = 6;
/// Distance of the eye, radii of the leaf: far enough that its near side is drawn at the scale of
/// its far side.
const EYE_DISTANCE_RADII: f64 = 4.0;
/// Limits of the side of the pictures, px; about one splat of the finest level per pixel.
const VIEW_SIDE_LIMITS_PX: (u32, u32) = (48, 160);

/// Measures the errors of levels.
pub(crate) struct LeafJudge {
    renderer: CpuRenderer,
    config: RenderConfig,
    truth: Frame,
    other: Frame,
}

impl LeafJudge {
    /// A judge that renders with `renderer`.
    pub(crate) fn new(renderer: CpuRenderer, rasterization: Rasterization) -> Self {
        let config = RenderConfig {
            background: Background::Color([0.5; 3]),
            rasterization,
            ..RenderConfig::default()
        };
        Self { renderer, config, truth: Frame::default(), other: Frame::default() }
    }

    /// The error of each level, the finest first: 0, and no less than that of the level before.
    ///
    /// Squared differences of colour (mean of the channels) and of alpha, summed over pictures of
    /// the leaf alone before grey, over the pixels that its box covers in them; the root of that.
    pub(crate) fn errors(&mut self, levels: &[Splats]) -> Result<Vec<f32>, RenderError> {
        let mut sums = vec![0.0; levels.len()];
        let mut pixels = 0.0;
        let Some((finest, coarser)) = levels.split_first() else { return Ok(Vec::new()) };
        let extent = extent(finest);
        let side = (finest.len() as f64).sqrt() as u32;
        for camera in
            cameras_about(finest, VIEW_COUNT, side.clamp(VIEW_SIDE_LIMITS_PX.0, VIEW_SIDE_LIMITS_PX.1))
        {
            pixels += coverage(extent.0, extent.1, &camera);
            look(&mut self.renderer, finest, &camera, &self.config, &mut self.truth)?;
            for (splats, sum) in coarser.iter().zip(&mut sums[1..]) {
                look(&mut self.renderer, splats, &camera, &self.config, &mut self.other)?;
                *sum += difference(&self.truth, &self.other);
            }
        }
        let mut worst = 0.0_f32;
        Ok(sums
            .iter()
            .map(|sum| {
                worst = worst.max((sum / pixels.max(1.0)).sqrt() as f32);
                worst
            })
            .collect())
    }
}

fn look(
    renderer: &mut CpuRenderer,
    splats: &Splats,
    camera: &Camera,
    config: &RenderConfig,
    frame: &mut Frame,
) -> Result<(), RenderError> {
    renderer.render(&DrawPass::new(&[SetView::transient(splats)], camera, config), frame).map(|_| ())
}

/// The sum over pixels of the squared differences of colour, the mean of the channels, and of
/// alpha.
fn difference(a: &Frame, b: &Frame) -> f64 {
    let squared = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2)).sum()
    };
    squared(&a.rgb, &b.rgb) / 3.0 + squared(&a.alpha, &b.alpha)
}

/// The box of the ellipsoids of 3 standard deviations, all taken for balls.
fn extent(splats: &Splats) -> ([f32; 3], [f32; 3]) {
    let empty = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    (0..splats.len()).fold(empty, |(low, high), index| {
        let mean = splats.means[index];
        let half = 3.0 * splats.log_scales[index].iter().fold(f32::MIN, |a, b| a.max(*b)).exp();
        (
            std::array::from_fn(|k| low[k].min(mean[k] - half)),
            std::array::from_fn(|k| high[k].max(mean[k] + half)),
        )
    })
}

/// Cameras about the means of splats, evenly over all directions, with square pictures that hold
/// them.
pub(crate) fn cameras_about(splats: &Splats, count: usize, side: u32) -> Vec<Camera> {
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = splats.means.iter().fold(empty, |(low, high), mean| {
        let mean = DVec3::from_array(mean.map(f64::from));
        (low.min(mean), high.max(mean))
    });
    let (center, radius) = (0.5 * (low + high), (0.5 * (high - low).length()).max(1e-6));
    let fov = 2.0 * (1.0 / EYE_DISTANCE_RADII).asin().to_degrees();
    let camera = |index: usize| {
        // A spiral of equal steps in height and golden angles.
        let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
        let (sin, cos) = (index as f64 * 2.399_963_229_728_653).sin_cos();
        let outward = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        let eye = center + EYE_DISTANCE_RADII * radius * outward;
        let camera =
            Camera::looking((side, side), fov, eye, center, outward.any_orthonormal_vector()).ok()?;
        Some(Camera { near: 0.01 * radius, ..camera })
    };
    (0..count).filter_map(camera).collect()
}
