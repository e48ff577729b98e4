//! Surfaces for a radar. Nothing is known of their material, so their geometry has to do, with
//! constants that are guessed.
//!
//! The RCS of a surface is in proportion to the area that it shows the radar, `r^2 dOmega` of a
//! ray; the factor is `sigma0 / cos(theta)` with the RCS `sigma0` of an area of the surface itself
//! and the angle of incidence `theta`. It is the sum of
//!
//! - a rough part, the same for all angles: 0.02 of level ground (-17 dB; asphalt at 80 degrees has
//!   a `sigma0` of some -25 dB), 0.3 of all else (-5 dB: walls, plants and cars alike);
//! - facets that mirror (geometric optics): `0.15 exp(-tan^2(theta) / m^2) / (m^2 cos^5(theta))`
//!   with `m = 0.2`, so that a wall that faces the radar is 11 dB brighter than one that does not.

/// Cosine between up and the normal of level ground.
const MIN_LEVEL_COSINE: f64 = 0.9;
/// The rough part of level ground, and of all else.
const ROUGH_BACKSCATTER: [f64; 2] = [0.02, 0.3];
/// Reflectance of facets, and their slopes.
const FACET_REFLECTANCE: f64 = 0.15;
const FACET_SLOPE: f64 = 0.2;

/// RCS for each area that a surface shows, by the cosine of the angle of incidence, 0-1, and the
/// cosine between its normal and up.
pub(crate) fn surface_backscatter(cosine: f64, upward: f64) -> f64 {
    let rough = ROUGH_BACKSCATTER[usize::from(upward.abs() < MIN_LEVEL_COSINE)];
    // At 82 degrees the facets' part is nothing.
    let cosine = cosine.clamp(0.14, 1.0);
    let tangent = (1.0 / (cosine * cosine) - 1.0) / (FACET_SLOPE * FACET_SLOPE);
    rough + FACET_REFLECTANCE * (-tangent).exp() / (FACET_SLOPE * FACET_SLOPE * cosine.powi(5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_are_brightest_when_they_face_the_radar() {
        assert!((surface_backscatter(1.0, 0.0) - 4.05).abs() < 1e-9);
        assert!((surface_backscatter(0.5, 0.0) - 0.3).abs() < 1e-6);
        assert!((surface_backscatter(0.0, 1.0) - 0.02).abs() < 1e-6);
    }
}
