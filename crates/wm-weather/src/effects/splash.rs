//! Splashes: crowns and droplets where rain hits wet ground and water.
//!
//! [`crate::splash`] computes which drops splash and how the droplets fly. The ground is that of
//! `wetness`, and a `flood` is water everywhere; the drops are those of `rain`, with its exposure
//! and its factors of size, opacity and brightness. The paper has no splashes.

use crate::effects::effect::{Effect, EffectRole, Need};
use crate::param::ParamValue;

crate::param::params! {
    /// The parameters of the effect.
    struct SplashParams {
        /// Factor on the water that drops throw up. `auto` is 1, as in nature; 0 for none. Dry
        /// ground has no splashes, and neither has a weather without `wetness` and `flood`.
        amount: Option<f64> = ParamValue::Auto, 0.0 => 20.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "splash",
    about: "Crowns and droplets where rain hits wet ground and water",
    role: EffectRole::Water,
    needs: &[Need::Shelter],
    precipitation: None,
    params: SplashParams::PARAMS,
    contribute: |now, weather| {
        let SplashParams { amount } = SplashParams::of(now.values);
        weather.prepared.splash = Some(amount.unwrap_or(1.0)).filter(|amount| *amount > 0.0);
    },
    contribute_as_paper: Some(|_, _| {}),
};
