//! The share of light that a water surface reflects.

/// Refractive index of water for visible light.
pub const WATER_INDEX: f32 = 1.333;

/// The share of unpolarised light that a smooth water surface reflects, 0-1, for the cosine of the angle between the ray
/// and the surface's normal: Fresnel's equations, exactly, for light that comes from the air.
#[inline(always)]
#[must_use]
pub fn fresnel(cosine: f32) -> f32 {
    let c = cosine.clamp(0.0, 1.0);
    let g = (WATER_INDEX * WATER_INDEX - 1.0 + c * c).sqrt();
    let across = (g - c) / (g + c);
    let along = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
    0.5 * across * across * (1.0 + along * along)
}
