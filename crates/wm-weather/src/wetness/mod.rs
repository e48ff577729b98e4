//! Wet ground and walls: how much water is where, and how it looks.
//!
//! # How much water is where
//! Rain fills pores, then the texture of surfaces, then it runs off ([`mod@column`]), into the
//! depressions of the ground that fill and run over ([`basins`]). What dries is taken from films
//! first and from puddles last ([`drying`]). Each surface gets the share of the rain that reaches
//! it: by what stands above it in the slanted direction of the rain ([`crate::shelter`]), by its
//! slope, and on walls by the wind ([`surfaces`]). The state at an instant is a sum of steps until
//! then ([`timeline`]), and depends on nothing else. Snow that melts ([`crate::cover::snowpack`])
//! is water in the same steps: where a share of the rain falls the same share of the snow does.
//!
//! Columns of ground for sixteen shares of the rain pass all steps, and a splat looks up its own
//! share between them. The rain has one direction for all times, that of the heaviest rain in the
//! wind of the start, so that no dry edge jumps.
//!
//! # How it looks
//! The light of each splat is multiplied by a factor a channel ([`optics`]): in the slot of the
//! light, so that both compose. What a splat is wetted by is found once a direction of the rain; a
//! frame looks up two numbers a splat. Steep surfaces mirror the sky's light too ([`SkySheen`]): as
//! a part of the same factor, since what depends on the direction is gone from a wet splat, so that
//! its light is known.
//!
//! The attribute [`Fade`](wm_render::hooks::Attribute::Fade) takes away what the dry surface
//! mirrored of another sky.
//!
//! [`WaterState`] is the same water as a grid, to be drawn as a surface. Depths are interpolated
//! between nodes, so that puddles end in curves within cells, and water fades where the capture
//! ends.

pub(crate) mod basins;
pub(crate) mod column;
pub(crate) mod drying;
mod eaves;
mod ground_map;
pub mod optics;
mod relief;
mod run_off;
mod sheen;
pub(crate) mod state;
pub(crate) mod surfaces;
pub(crate) mod timeline;

pub(crate) use column::{Drainage, WetStep};
pub(crate) use eaves::Eave;
pub(crate) use ground_map::GroundMap;
pub(crate) use relief::{lower_share, relief, smooth_noise};
pub use run_off::RunOff;
pub(crate) use sheen::SkySheen;
pub use state::{Catchments, WaterState, WetState};
pub use surfaces::{WetGains, WetShares, WetSurfaces};

/// A request for wet surfaces: the rain so far, or a wetness by hand.
#[derive(Clone, Debug, PartialEq)]
pub struct WetRequest {
    /// Rain and drying until the instant.
    pub(crate) steps: Vec<WetStep>,
    /// Wetness that is requested, 0-1, in the place of what the steps give: pores are full at a
    /// half, and the texture at 1.
    pub(crate) amount: Option<f64>,
    /// Share of the volume of puddles that is filled, 0-1, in the place of what has come to them.
    pub(crate) puddles: Option<f64>,
    /// Factor on the darkening of surfaces, 0-1.
    pub porosity: f64,
    /// Mean depth of the texture of surfaces, mm.
    pub texture: f64,
    /// Share of the water of roofs that falls from their eaves, 0-1; gutters take the rest.
    pub eaves: f64,
    /// The rain.
    pub rain: SlantedRain,
}

/// The direction of the rain, the same at all times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlantedRain {
    /// The direction of fall, world axes, length 1.
    pub fall: [f64; 3],
    /// The direction of the wind, world axes, times the rain on a wall that faces it over that on
    /// level ground.
    pub(crate) driving: [f64; 3],
}

impl WetRequest {
    /// Returns true if nothing is wet anywhere.
    pub(crate) fn is_nothing(&self) -> bool {
        let is_dry = match self.amount {
            Some(amount) => amount <= 0.0,
            None => !self.steps.iter().any(WetStep::is_wet),
        };
        is_dry && self.puddles.is_none_or(|share| share <= 0.0)
    }
}

/// Rain on a wall that faces the wind, m/s, over that on level ground, in a rain of `rate` mm/h:
/// `2/9 v R^(8/9)` mm/h (ISO 15927-3).
pub(crate) fn driving_rain(wind: f64, rate: f64) -> f64 {
    if rate > 0.0 { 2.0 / 9.0 * wind * rate.powf(-1.0 / 9.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_get_the_driving_rain_of_the_standard() {
        assert!((10.0 * driving_rain(5.0, 10.0) - 8.6).abs() < 0.05);
        assert_eq!(driving_rain(5.0, 0.0), 0.0);
    }
}
