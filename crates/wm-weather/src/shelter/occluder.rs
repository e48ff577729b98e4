//! A splat that stops what falls.

use crate::level::dot;
use wm_scene::{Splats, quat};

/// A splat that stops what falls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Occluder {
    /// Place from the origin, world axes, scene units.
    pub(crate) mean: [f32; 3],
    /// xx, xy, xz, yy, yz, zz.
    pub(crate) covariance: [f32; 6],
    /// Opacity; above 1 it is an optical thickness, of several splats in one.
    pub(crate) opacity: f32,
    /// The index of the splat.
    pub(crate) splat: u32,
}

impl Occluder {
    /// Covariance along two directions.
    #[inline(always)]
    pub(crate) fn between(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.covariance.map(f64::from);
        a[0] * (xx * b[0] + xy * b[1] + xz * b[2])
            + a[1] * (xy * b[0] + yy * b[1] + yz * b[2])
            + a[2] * (xz * b[0] + yz * b[1] + zz * b[2])
    }

    #[inline(always)]
    pub(crate) fn along(&self, axis: [f64; 3]) -> f64 {
        dot(self.mean.map(f64::from), axis)
    }

    pub(super) fn at(splats: &Splats, index: usize, origin: [f64; 3]) -> Self {
        let turn = quat::to_matrix(splats.quats[index].map(f64::from));
        let variances = splats.scales(index).map(|s| s * s);
        let between =
            |i: usize, j: usize| (0..3).map(|k| turn[i][k] * turn[j][k] * variances[k]).sum::<f64>() as f32;
        let mean = splats.means[index];
        Self {
            mean: std::array::from_fn(|k| (f64::from(mean[k]) - origin[k]) as f32),
            covariance: [
                between(0, 0),
                between(0, 1),
                between(0, 2),
                between(1, 1),
                between(1, 2),
                between(2, 2),
            ],
            opacity: splats.opacity(index) as f32,
            splat: index as u32,
        }
    }
}
