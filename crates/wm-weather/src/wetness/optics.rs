//! The look of wet surfaces: what is left of their light.
//!
//! Water in pores lengthens the path of light in the material: reflectance `A` becomes
//! `A / (A + n^2 (1 - A))` (Angstrom 1925). Under a film, light that the surface throws back at
//! steep angles is reflected down again: `0.934 * 0.525 A / (1 - 0.475 A)`, with the share 0.934 of
//! daylight that gets into water, the share 0.525 of diffuse light that gets out of it, and 0.475
//! that does not (the form of Lekner and Dorf 1988). Both act on each channel, so that colours
//! become more saturated by themselves.

/// Square of the refractive index of water.
const SQUARED_REFRACTIVE_INDEX: f64 = 1.333 * 1.333;
/// Shares of the light that get into a film, and out of it.
const ENTERING_LIGHT_SHARE: f64 = 0.934;
const LEAVING_LIGHT_SHARE: f64 = 0.525;
/// Share of diffuse light below a film of water that its surface throws back down.
pub const RETURNED_LIGHT_SHARE: f64 = 0.475;
/// Steps of reflectance.
pub(super) const ALBEDO_STEP_COUNT: usize = 256;

/// The factor on the light of a surface of reflectance `albedo`, 0-1, whose pores are full of
/// water.
#[must_use]
pub fn pores_factor(albedo: f64) -> f64 {
    1.0 / (albedo + SQUARED_REFRACTIVE_INDEX * (1.0 - albedo))
}

/// The factor on the light of a surface of reflectance `albedo`, 0-1, under a film of water.
pub(crate) fn film_factor(albedo: f64) -> f64 {
    ENTERING_LIGHT_SHARE * LEAVING_LIGHT_SHARE / (1.0 - RETURNED_LIGHT_SHARE * albedo)
}

/// Both factors less 1, for each reflectance in [`ALBEDO_STEP_COUNT`].
pub(super) fn table() -> [[f32; 2]; ALBEDO_STEP_COUNT] {
    std::array::from_fn(|step| {
        let albedo = step as f64 / (ALBEDO_STEP_COUNT - 1) as f64;
        [pores_factor(albedo) - 1.0, film_factor(albedo) - 1.0].map(|v| v as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published values, by hand.
    #[test]
    fn wet_reflectances_are_those_of_the_laws() {
        for (albedo, film) in [(0.1, 0.052), (0.2, 0.108), (0.4, 0.242)] {
            assert!((albedo * film_factor(albedo) - film).abs() < 6e-4, "{albedo}");
        }
        for (albedo, pores) in [(0.2, 0.123), (0.4, 0.273)] {
            assert!((albedo * pores_factor(albedo) - pores).abs() < 5e-4, "{albedo}");
        }
    }

    #[test]
    fn dark_colours_darken_more_and_nothing_brightens() {
        let table = table();
        assert!(table.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[0][1] < pair[1][1]));
        assert!(table.iter().flatten().all(|change| *change <= 1e-6));
    }
}
