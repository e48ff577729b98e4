//! The share of light that a water surface reflects.

use fearless_simd::{SimdBase, SimdFloat};
use wm_render::simd::Lanes;

/// Refractive index of water for visible light.
pub const WATER_INDEX: f32 = 1.333;

/// The share of unpolarised light that a smooth water surface reflects, 0-1, for the cosine of the
/// angle between the ray and the surface's normal: Fresnel's equations, exactly, for light that
/// comes from the air.
#[inline(always)]
#[must_use]
pub fn fresnel(cosine: f32) -> f32 {
    let c = cosine.clamp(0.0, 1.0);
    let g = (WATER_INDEX * WATER_INDEX - 1.0 + c * c).sqrt();
    let across = (g - c) / (g + c);
    let along = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    0.5 * across * across * (1.0 + along * along)
}

/// [`fresnel`] of cosines from 0 to 1.
#[inline(always)]
pub(super) fn fresnel_of<S: Lanes>(simd: S, cosine: S::F) -> S::F {
    let c = cosine.min(simd.set(1.0));
    let g = c.mul_add(c, simd.set(WATER_INDEX * WATER_INDEX - 1.0)).sqrt();
    let (sum, difference) = (g + c, g - c);
    let across = difference / sum;
    let along = c.mul_add(sum, simd.set(-1.0)) / c.mul_add(difference, simd.set(1.0));
    across * across * along.mul_add(along, simd.set(1.0)) * 0.5
}
