//! Dust cover: sand, dust or ash that lies, as deep as is asked for on open level ground.
//!
//! It lies as snow does ([`super::snow_cover`]), with another colour, and slides sooner: dry sand
//! lies at 34 degrees at most, ash at 35 to 40. Where both are asked for the snow lies on it, and
//! it is seen where there is none.

use crate::cover::{CoverMaterial, CoverRequest};
use crate::effects::effect::{Effect, EffectRole, Need};
use crate::param::ParamValue;
use wm_base::color::srgb_decode;

/// Dry sand, sRGB.
const SAND_COLOR: [f64; 3] = [0.76, 0.647, 0.467];

/// Wind that carries dry sand along the ground, m/s at 10 m.
const DRIFT_WIND_SPEED: f64 = 7.0;

crate::param::params! {
    /// The parameters of the effect.
    struct DustCoverParams {
        /// Depth on open level ground. Below some 1 cm the ground shows through. Over time by
        /// keyframes. Snow lies on it.
        depth: f64 = ParamValue::Number(0.02), 0.0 => 10.0, "m";
        /// Steepest that it lies. Dry sand 34, ash 40.
        repose: f64 = ParamValue::Number(34.0), 5.0 => 80.0, "deg";
        /// Colour of it: how much of the light it throws back, as sRGB. Sand #c2a577 (auto),
        /// Saharan dust #b07a48, ash
        /// #5f5d5a.
        color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "dust_cover",
    about: "Sand, dust or ash that lies: on what is open to the sky, sliding off what is steep",
    role: EffectRole::Lies,
    needs: &[Need::Cover],
    precipitation: None,
    params: DustCoverParams::PARAMS,
    contribute: |now, weather| {
        let DustCoverParams { depth, repose, color } = DustCoverParams::of(now.values);
        let color = color.unwrap_or(SAND_COLOR);
        let material = CoverMaterial::at(color.map(srgb_decode), [0.4; 3], f64::INFINITY, weather.site());
        weather.add_cover(CoverRequest {
            depth,
            thaw: None,
            wet_fall: 0.0,
            repose: repose.to_radians().tan(),
            threshold: DRIFT_WIND_SPEED,
            material,
        });
    },
    contribute_as_paper: None,
};
