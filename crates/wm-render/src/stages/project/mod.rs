//! Splats to 2D Gaussians in the picture (EWA splatting, Zwicker et al. 2002, as 3DGS uses it).
//!
//! Contract, for a splat with mean `mu`, rotation `R` (from its quaternion), scales `s`, opacity
//! `o` and a camera with rotation `W`, centre `c`:
//!
//! - `(X, Y, z) = W (mu - c)`; drawn only if `z > near`. Centre `(fx X / z + cx, fy Y / z + cy)`.
//! - `M = J W R diag(s)`, `[2, 3]`, with `J` the Jacobian of the projection at `mu`, where `X / z`
//!   is clamped to `[-cx / fx - margin, (width - cx) / fx + margin]`, margin = 0.3 width / (2 fx),
//!   and `Y / z` likewise: outside it the linearisation explodes.
//! - `cov2d = M M^T + 0.3 I` px^2. Its determinant is summed from the 2x2 minors of `M`
//!   (Cauchy-Binet), all terms positive, so that needles lose no digits.
//! - [`Rasterization::Antialiased`](wm_scene::Rasterization) multiplies `o` by
//!   `sqrt(max(det(M M^T) / det(cov2d), 0.005^2))`.
//! - The exponent is kept as a Cholesky factor, `alpha = 2^(log2_opacity - u^2 - v^2)` with
//!   `u = ux dx`, `v = vx dx + vy dy`: one operation less than the conic's form, and where a long
//!   splat's conic cancels over hundreds of pixels this does not.
//! - Half extents of `alpha >= 1/255`: exact, `sqrt(2 ln(255 o) cov2d[k][k])`.
//! - Not drawn: opacity below 1/255, a box that holds no pixel centre of the picture, a determinant
//!   above 1e37 (f32 would overflow).
//! - The normal is the shortest axis (the first of equal ones), turned towards the camera.
//!
//! Tolerance: each value is a sum of a few dozen products: relative 1e-5 (about 80 ulp) where they
//! are of like magnitude. The entries of `M` err by 1e-6 of the longest axis times the focal length
//! over z, which tells where a needle is seen along its axis. `u`, `v` at distance `d` px from the
//! centre err by `d` times the error of `ux`, `vx`, `vy`.
//!
//! The radius of culling a cluster is conservative: see `cpu::ClusterCull`.

pub(crate) mod activate;
pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(feature = "gpu")]
pub(crate) mod rows;
#[cfg(test)]
mod tests;

use wm_scene::Camera;

/// Variance added to both axes of the 2D Gaussian, px^2.
pub const DILATION: f32 = 0.3;
/// Dilation where slopes of depth are found, px^2: flat splats that are seen at a grazing angle are
/// lines.
pub(crate) const SLOPE_DILATION: f32 = 0.02;
/// Share of a splat's thickness along the normal of a surface that does not count for on which side
/// of it the splat is, for those that lie along the surface; and the shares of a splat's whole
/// variance along the normal up to which it lies, and from which it stands.
pub(crate) const FLATTENING: f32 = 0.99;
pub(crate) const MAX_LYING_SHARE: f32 = 0.15;
pub(crate) const MIN_STANDING_SHARE: f32 = 0.3;
/// Smallest opacity factor of the anti-aliased mode.
pub(crate) const MIN_COMPENSATION: f32 = 0.005;
/// Smallest alpha that is drawn.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;
/// log2 of [`MIN_ALPHA`].
pub(crate) const LOG2_MIN_ALPHA: f32 = -7.994_353_3;
/// Tolerance in log2 alpha of the tests of extents and tiles, against rounding.
pub(crate) const TEST_SLACK: f32 = 1e-3;
/// `sqrt(log2(e) / 2)`: turns standard deviations into the exponent of 2.
pub(crate) const SQRT_HALF_LOG2E: f32 = 0.849_321_8;
/// Largest determinant of a 2D covariance, px^4.
pub(crate) const MAX_DET: f32 = 1e37;

/// One projected and shaded splat: one cache line, all that later stages need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct Record {
    /// Centre, px.
    pub(crate) x: f32,
    /// Centre, px.
    pub(crate) y: f32,
    /// `u = ux dx`.
    pub(crate) ux: f32,
    /// `v = vx dx + vy dy`.
    pub(crate) vx: f32,
    /// See `vx`.
    pub(crate) vy: f32,
    /// log2 of the opacity at the centre.
    pub(crate) log2_opacity: f32,
    /// Display-referred colour.
    pub(crate) rgb: [f32; 3],
    /// View z, scene units.
    pub(crate) depth: f32,
    /// World axes, towards the camera.
    pub(crate) normal: [f32; 3],
    /// The dy at which alpha is largest for dx = 1: `cov2d[x][y] / cov2d[x][x]`.
    pub(crate) slope_y: f32,
    /// The dx at which alpha is largest for dy = 1: `cov2d[x][y] / cov2d[y][y]`.
    pub(crate) slope_x: f32,
    /// Index of the splat in its model; in a pass with a surface slopes of its depth, see
    /// [`pack_slopes`].
    pub(crate) index: u32,
}

/// Packs slopes of the reciprocal depth along x and y, 1/(scene units px), into one word: the upper
/// half of each number.
#[inline(always)]
pub(crate) fn pack_slopes(x: f32, y: f32) -> u32 {
    (x.to_bits() & 0xffff_0000) | (y.to_bits() >> 16)
}

/// Reads what [`pack_slopes`] wrote.
#[inline(always)]
pub(crate) fn unpack_slopes(word: u32) -> [f32; 2] {
    [f32::from_bits(word & 0xffff_0000), f32::from_bits(word << 16)]
}

/// The camera in the form and precision that projection uses.
#[derive(Clone, Copy, Debug)]
pub struct ProjectCamera {
    /// World to camera, rows.
    pub(crate) rotation: [[f32; 3]; 3],
    /// Camera centre, world axes.
    pub(crate) center: [f32; 3],
    /// Focal lengths, px.
    pub(crate) focal: [f32; 2],
    /// Principal point, px.
    pub(crate) principal: [f32; 2],
    /// Picture size, px.
    pub(crate) size: [f32; 2],
    /// Lowest `X / z`, `Y / z` at which the Jacobian is taken.
    pub(crate) low: [f32; 2],
    /// Highest.
    pub(crate) high: [f32; 2],
    /// Near plane, scene units.
    pub(crate) near: f32,
}

impl ProjectCamera {
    /// The camera as projection uses it.
    #[must_use]
    pub fn new(camera: &Camera) -> Self {
        let rotation = camera.rotation().transpose();
        let center = camera.center();
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let (focal, principal) = ([camera.fx, camera.fy], [camera.cx, camera.cy]);
        let limit = |k: usize| {
            let margin = 0.3 * 0.5 * size[k] / focal[k];
            [-principal[k] / focal[k] - margin, (size[k] - principal[k]) / focal[k] + margin]
        };
        Self {
            rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis]
                .map(|row| row.to_array().map(|v| v as f32)),
            center: center.to_array().map(|v| v as f32),
            focal: focal.map(|v| v as f32),
            principal: principal.map(|v| v as f32),
            size: size.map(|v| v as f32),
            low: [limit(0)[0] as f32, limit(1)[0] as f32],
            high: [limit(0)[1] as f32, limit(1)[1] as f32],
            near: camera.near as f32,
        }
    }

    /// Makes the projection of a camera that shows a part of the picture of `whole`, whose limits
    /// of the Jacobian it takes.
    pub(crate) fn part_of(self, whole: Option<&Camera>) -> Self {
        match whole.map(Self::new) {
            Some(Self { low, high, .. }) => Self { low, high, ..self },
            None => self,
        }
    }
}
