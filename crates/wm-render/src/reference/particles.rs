//! The reference of falling particles: f64, every particle at every pixel.

use crate::frame::{MIN_ALPHA, srgb_decode, srgb_encode};
use crate::hooks::Particle;
use crate::stages::particles::{
    DILATION, MAX_COVER, MAX_OPTICAL_DEPTH, MIN_OPTICAL_DEPTH, MIN_SQUARED_RADIUS, PEAK_COEFFICIENTS,
};
use glam::DVec3;
use std::f64::consts::TAU;
use wm_scene::Camera;

/// One pixel's particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ParticleCover {
    /// Optical depth.
    pub(crate) tau: f64,
    /// Sum of optical depth times radiance.
    pub(crate) light: [f64; 3],
    /// The error that `tau` may have in f32, see [`crate::stages::particles`].
    pub(crate) slack: f64,
}

impl ParticleCover {
    /// A display-referred colour behind it.
    pub(crate) fn over(&self, rgb: [f64; 3]) -> [f64; 3] {
        if self.tau <= 0.0 {
            return rgb;
        }
        let kept = (-self.tau).exp();
        let seen = |k: usize| srgb_decode(rgb[k]) * kept + (1.0 - kept) * self.light[k] / self.tau;
        std::array::from_fn(|k| srgb_encode(seen(k)))
    }
}

/// The cover of the middle of pixel `(x, y)` before a scene of that coverage and sum of weight
/// times view z.
pub(crate) fn cover(
    particles: &[Particle],
    camera: &Camera,
    x: u32,
    y: u32,
    alpha: f64,
    depth_sum: f64,
) -> ParticleCover {
    let rotation = camera.rotation();
    let behind = if alpha >= f64::from(MIN_ALPHA) { depth_sum / alpha } else { f64::INFINITY };
    let mut sum = ParticleCover::default();
    for particle in particles {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let at = rotation * vector(particle.offset);
        if at.z <= camera.near {
            continue;
        }
        let (tan_x, tan_y) = (at.x / at.z, at.y / at.z);
        let jx = camera.fx / at.z * (rotation.row(0) - tan_x * rotation.row(2));
        let jy = camera.fy / at.z * (rotation.row(1) - tan_y * rotation.row(2));
        let variance = f64::from(particle.sigma).powi(2);
        let mut cov = [variance * jx.dot(jx), variance * jx.dot(jy), variance * jy.dot(jy)];
        for reach in particle.reach {
            let (u, v) = (jx.dot(vector(reach)), jy.dot(vector(reach)));
            cov = [cov[0] + u * u, cov[1] + u * v, cov[2] + v * v];
        }
        let dilation = f64::from(DILATION);
        let (xx, xy, yy) = (cov[0] + dilation, cov[1], cov[2] + dilation);
        let det = xx * yy - xy * xy;
        let area = f64::from(particle.area) * jx.cross(jy).length();
        let whole = (area / (TAU * det.sqrt())).min(f64::from(MAX_COVER));
        let powers = PEAK_COEFFICIENTS.iter().zip(1..).map(|(c, power)| f64::from(*c) * whole.powi(power));
        let steeper = powers.sum::<f64>().exp();
        let radius2 = (2.0 * (whole * steeper / f64::from(MIN_OPTICAL_DEPTH)).max(1.0).ln())
            .max(f64::from(MIN_SQUARED_RADIUS));
        let peak =
            (whole * steeper / (1.0 - steeper * (-0.5 * radius2).exp())).min(f64::from(MAX_OPTICAL_DEPTH));
        let dx = f64::from(x) + 0.5 - (camera.fx * tan_x + camera.cx);
        let dy = f64::from(y) + 0.5 - (camera.fy * tan_y + camera.cy);
        let q = dx * dx / xx + (dy - xy / xx * dx).powi(2) * xx / det;
        let tau = peak * (-0.5 * q).exp();
        if (q / radius2 - 1.0).abs() < 1e-3 {
            sum.slack += tau;
        }
        if q > radius2 {
            continue;
        }
        let share = if at.z < behind { 1.0 } else { 1.0 - alpha };
        if (at.z / behind - 1.0).abs() < 1e-5 {
            sum.slack += tau;
        }
        sum.slack += 3e-5 + 2e-4 * tau;
        sum.tau += share * tau;
        for k in 0..3 {
            sum.light[k] += share * tau * f64::from(particle.rgb[k]);
        }
    }
    sum
}
