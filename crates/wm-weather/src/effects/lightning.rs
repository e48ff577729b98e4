//! Lightning: flashes that light the place and the clouds, in the lux that they have.
//!
//! By day little is seen of them; by night they are brighter than all else
//! ([`crate::light::Storm`]). A frame gets the mean over its exposure. The paper has no such thing.

use crate::effects::effect::{Effect, EffectRole, Need};
use crate::light::Storm;
use crate::param::ParamValue;

crate::param::params! {
    /// The parameters of the effect.
    struct LightningParams {
        /// Flashes a minute, in the mean.
        rate: f64 = ParamValue::Number(6.0), 0.0 => 120.0, "1/min";
        /// Mean distance on the ground.
        distance: f64 = ParamValue::Number(2_000.0), 50.0 => 50_000.0, "m";
        /// Time of exposure of a frame.
        exposure: f64 = ParamValue::Number(1.0 / 50.0), 1e-4 => 60.0, "s";
        /// Another storm for each number.
        seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "lightning",
    about: "Flashes of lightning that light the place and the sky",
    role: EffectRole::Light,
    needs: &[Need::Light],
    precipitation: None,
    params: LightningParams::PARAMS,
    contribute: |now, weather| {
        let LightningParams { rate, distance, exposure, seed } = LightningParams::of(now.values);
        weather.set_flash(Storm { rate, distance, seed: seed as u64 }.flash(now.time, exposure));
    },
    contribute_as_paper: Some(|_, _| {}),
};
