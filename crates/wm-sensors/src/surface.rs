//! Reflectance of surfaces for a lidar, dry, wet and under snow.
//!
//! A dry surface is Lambert's, with the reflectance `0.05 + 0.8 Y` of the luminance `Y` of its
//! colour: an order of magnitude, since colours say little about the near infrared. Full pores
//! darken it by Angstrom's law. Under a film of water it is `T^2 / (n^2 (1 - 0.475 rho))` times as
//! bright, `T = 1 - R` by Fresnel at the beam's own angle, and the share `R` is mirrored away: a
//! wet road vanishes where the beam is flat.

use wm_base::color::{luminance, srgb_decode};
use wm_render::RaySplats;
use wm_scene::Splats;
use wm_weather::water::{WATER_INDEX, fresnel};
use wm_weather::wetness::optics::{RETURNED_LIGHT_SHARE, pores_factor};

/// Reflectance of black, and what white adds.
const REFLECTANCE_FIT: [f64; 2] = [0.05, 0.8];
/// Reflectance of lying snow where water does not absorb, and where it does (from memory of spectra
/// of old and of fresh snow).
pub(crate) const SNOW_REFLECTANCE: [f64; 2] = [0.85, 0.15];

/// Water and snow on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SurfaceState {
    /// It is snow.
    pub is_snow: bool,
    /// Share whose pores are full of water, without a film, 0-1.
    pub pores: f64,
    /// Share under a film of water, 0-1.
    pub film: f64,
    /// The label, 0 for none.
    pub label: u16,
}

/// The state of the surfaces of a scene.
pub trait SurfaceStates: Sync {
    /// The state of the surface of a splat.
    fn state(&self, splat: u32) -> SurfaceState;
}

/// The splats for which `is_met` returns true, such as those that are no sky, with their dry
/// reflectances: those of their colours as seen from everywhere, since what a colour does with the
/// direction is light that a beam is not.
#[must_use]
pub fn reflecting_splats(splats: &Splats, is_met: impl Fn(usize) -> bool + Sync) -> RaySplats<'_> {
    RaySplats::new(splats, is_met).with_values(|index| base_reflectance(splats, index))
}

/// The dry reflectance of a splat, by its colour as seen from all sides on average.
#[must_use]
pub fn base_reflectance(splats: &Splats, index: usize) -> f32 {
    let light = luminance(splats.base_color(index).map(|v| srgb_decode(v.clamp(0.0, 1.0))));
    (REFLECTANCE_FIT[0] + REFLECTANCE_FIT[1] * light) as f32
}

/// Surfaces that are all dry.
#[derive(Clone, Copy, Debug, Default)]
pub struct DrySurfaces;

impl SurfaceStates for DrySurfaces {
    fn state(&self, _: u32) -> SurfaceState {
        SurfaceState::default()
    }
}

/// The reflectance of a surface in a state, for a beam whose cosine to the normal is `cosine`;
/// `dry` is that without water.
pub(crate) fn wet_reflectance(dry: f64, state: &SurfaceState, cosine: f64) -> f64 {
    let through = 1.0 - mirrored(cosine);
    let index = f64::from(WATER_INDEX);
    let film = through * through / (index * index * (1.0 - RETURNED_LIGHT_SHARE * dry));
    let rest = 1.0 - state.pores - state.film;
    dry * (rest + state.pores * pores_factor(dry) + state.film * film)
}

/// The Fresnel reflectance of a film of water.
pub(crate) fn mirrored(cosine: f64) -> f64 {
    f64::from(fresnel(cosine as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Computed once from Fresnel's equations, for a reflectance of 0.2 and an index of 1.333.
    #[test]
    fn films_darken_flat_beams_most() {
        let wet = SurfaceState { film: 1.0, ..SurfaceState::default() };
        for (degrees, ratio, mirror) in [
            (0.0, 0.60, 0.02),
            (60.0, 0.55, 0.06),
            (70.0, 0.47, 0.13),
            (80.0, 0.26, 0.35),
            (85.0, 0.11, 0.58),
            (88.0, 0.024, 0.80),
        ] {
            let cosine = f64::to_radians(degrees).cos();
            assert!((wet_reflectance(0.2, &wet, cosine) / 0.2 - ratio).abs() < 0.006, "{degrees}");
            assert!((mirrored(cosine) - mirror).abs() < 0.006, "{degrees}");
        }
        assert_eq!(wet_reflectance(0.2, &SurfaceState::default(), 0.5), 0.2);
    }
}
