//! Splats along any rays, each with its own origin: lidar, fisheye and rolling shutters.
//!
//! Contract, for a ray `o + t d` with `|d| = 1` and the splats `i` by the distance of their means
//! from the middle of the origins of the ray's group (see [`packets::Packets`]), equal ones in an
//! order that depends on the splats alone:
//!
//! - `M = S^-1 R^T` with the rotation `R` and the standard deviations `S`, none below 1e-4 of the
//!   largest; `a = M (o - mean)`, `b = M d`. The splat is densest at `t = -(a.b) / (b.b)`, where
//!   `q = |a x b|^2 / |b|^2`: unlike `|a|^2 - (a.b)^2 / (b.b)` that is exact in single precision
//!   far from the splat. Those with `t <= 0` are skipped.
//! - `alpha = min(0.99, opacity exp(-q / 2))`, skipped below 1/255; transmittance, weights and
//!   their end are those of [`super::rasterize`]. No splat is widened: what is thinner than the
//!   distance between rays may lie between them.
//! - Coverage is the sum of weights; colour, normal and value are `sum w f`. Colours are those of
//!   [`super::shade`] seen from the middle of the group's origins, normals turn towards it, values
//!   are the caller's own.
//! - The hit is the first splat with which the sum of weights reaches half of the coverage, and
//!   lies at its `t`; a coverage above 0.99 counts as 1. Below a coverage of 0.5 there is none. The
//!   expected distance would draw points behind edges. Where more than 16 splats bring the sum of
//!   weights from a quarter to a half, the last of them may stand for one before it.
//!
//! Tolerance against f64: `q` errs by about `1e-6 (1 + d / s)` with the distance `d` and the
//! standard deviation `s` across the ray, so sums agree to 1e-4 within 1e4 standard deviations;
//! cuts are steps, as in [`super::rasterize`].

pub mod cpu;
mod cull;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(all(test, feature = "gpu"))]
mod gpu_tests;
pub(crate) mod packets;
mod records;
#[cfg(test)]
mod tests;
mod walk;

use crate::simd::SimdPath;

/// Rays, each with an origin and a direction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rays {
    /// Origin of each ray, world axes, scene units.
    pub origins: Vec<[f32; 3]>,
    /// Unit direction of each ray, world axes.
    pub directions: Vec<[f32; 3]>,
}

impl Rays {
    /// Makes rays from one origin.
    #[must_use]
    pub fn from_one(origin: [f32; 3], directions: Vec<[f32; 3]>) -> Self {
        Self { origins: vec![origin; directions.len()], directions }
    }

    /// Returns the number of rays.
    #[must_use]
    pub fn len(&self) -> usize {
        self.directions.len()
    }

    /// Returns true if there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.directions.is_empty()
    }
}

/// Outputs beside coverage and distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayOutputs {
    /// Colours.
    pub color: bool,
    /// Normals.
    pub normal: bool,
    /// The values that the caller gave the splats.
    pub value: bool,
}

/// Results of rays, one entry a ray.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RayHits {
    /// Coverage, 0-1.
    pub coverage: Vec<f32>,
    /// Distance of the hit, scene units; infinite without one.
    pub distance: Vec<f32>,
    /// The splat that is hit; `u32::MAX` without one.
    pub splat: Vec<u32>,
    /// Display-referred colour times coverage; empty unless asked.
    pub(crate) color: Vec<[f32; 3]>,
    /// Normal times coverage, world axes, towards the origin; empty unless asked.
    pub normal: Vec<[f32; 3]>,
    /// The caller's value times coverage; empty unless asked.
    pub value: Vec<f32>,
}

impl RayHits {
    /// Makes the results of `count` rays that meet nothing.
    pub(crate) fn none(count: usize, asked: RayOutputs) -> Self {
        Self {
            coverage: vec![0.0; count],
            distance: vec![f32::INFINITY; count],
            splat: vec![u32::MAX; count],
            color: vec![[0.0; 3]; if asked.color { count } else { 0 }],
            normal: vec![[0.0; 3]; if asked.normal { count } else { 0 }],
            value: vec![0.0; if asked.value { count } else { 0 }],
        }
    }
}

/// Least standard deviation of a splat, relative to its largest.
pub(crate) const MIN_RELATIVE_SCALE: f64 = 1e-4;
/// Coverage above which a ray counts as stopped.
pub(crate) const STOPPED_COVERAGE: f32 = 0.99;
/// Least coverage of a hit.
pub(crate) const MIN_HIT_COVERAGE: f32 = 0.5;

/// Splats that rays can meet, on the CPU or on a GPU.
pub trait RayTracer: Sync {
    /// Traces rays, on the threads of the current pool where the CPU does it, with its instructions
    /// `path`.
    ///
    /// # Panics
    /// If there are fewer origins than directions.
    fn trace(&self, rays: &Rays, asked: RayOutputs, path: SimdPath) -> RayHits;
}
