//! Foam that the wind makes on water that has depth.
//!
//! Breaking waves cover a share `3.84e-6 U^3.41` of open water (Monahan and O'Muircheartaigh 1980),
//! less where the waves of a short fetch are less steep. At a shore all waves break where the depth
//! is less than `H / 0.78` (McCowan 1894). Foam lies where the waves are steepest, so it moves with
//! them. The share at the very edge is plausible and not measured.

use super::waves::WindWaves;
use fearless_simd::{SimdBase, SimdFloat};
use wm_render::simd::{Lanes, log2};

/// Reflectance of fresh foam (Koepke 1984: 0.55).
pub(crate) const FOAM_REFLECTANCE: f64 = 0.5;
/// Share that foam covers at the edge of the water under winds in which all waves break.
const EDGE_SHARE: f32 = 0.5;
/// Height of waves over the depth in which they break.
const BREAKING_HEIGHT: f64 = 0.78;
/// Winds between which waves begin to break, m/s.
const BREAKING_WIND_SPEEDS: [f64; 2] = [3.0, 7.0];
/// Range of squared slopes over which foam grows from none to all, in mean squares of the slopes. A
/// soft limit lets more through than a sharp one, by the factor `sinh(w / 2) / (w / 2)` for a range
/// of w: its logarithm.
const SOFT_RANGE_RATIO: f32 = 1.5;
const LET_THROUGH: f32 = 0.092;

/// Foam on water under a wind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Foam {
    /// Share of deep water that it covers, 0-1.
    open: f32,
    /// Share that it covers at the edge of the water, 0-1.
    edge: f32,
    /// Depth from which waves do not break by the bottom, m.
    deep: f32,
    /// Mean square of the slopes of the water, both axes together.
    slopes: f32,
}

impl Foam {
    /// Returns the foam of a wind of `speed` m/s that makes these waves; `None` for a wind that
    /// makes none. `other_slopes` is the mean square of the slopes that rain makes, both axes
    /// together.
    pub(crate) fn new(waves: &WindWaves, speed: f64, other_slopes: f64) -> Option<Self> {
        let risen = ((speed - BREAKING_WIND_SPEEDS[0]) / (BREAKING_WIND_SPEEDS[1] - BREAKING_WIND_SPEEDS[0]))
            .clamp(0.0, 1.0);
        if risen <= 0.0 {
            return None;
        }
        let own = 2.0 * waves.slope_variance();
        let steepness = (own / WindWaves::open_slopes(speed)).min(1.0);
        Some(Self {
            open: (steepness * 3.84e-6 * speed.powf(3.41)).min(1.0) as f32,
            edge: risen as f32 * EDGE_SHARE,
            deep: (waves.height / BREAKING_HEIGHT) as f32,
            slopes: (own + other_slopes) as f32,
        })
    }

    /// Returns the share of a pixel that foam covers, 0-1, on water of a depth, m. `square` is the
    /// square of the slope that the pixel shows, both axes together, and `unseen` the variance of
    /// the slopes that it is too wide to show, along one axis.
    #[inline(always)]
    pub(crate) fn share<S: Lanes>(&self, simd: S, depth: S::F, square: S::F, unseen: S::F) -> S::F {
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let shallow = (one - depth * (1.0 / self.deep)).max(zero);
        let mean = (shallow * shallow).mul_add(simd.set(self.edge - self.open), simd.set(self.open));
        let mean = mean.max(simd.set(1e-9)).min(one);
        // The square of a random slope is above `limit` times its mean at the share exp(-limit) of
        // all places.
        let seen = (one - unseen * (2.0 / self.slopes)).max(simd.set(1e-3));
        let limit = log2(simd, [mean])[0].mul_add(simd.set(-std::f32::consts::LN_2), simd.set(LET_THROUGH));
        let over = square / (seen * self.slopes) - limit;
        let patch = (over * (1.0 / SOFT_RANGE_RATIO) + 0.5).max(zero).min(one);
        // What a pixel is too wide to show is its mean.
        seen.mul_add(patch - mean, mean)
    }
}
