//! Wind: what carries rain and snow along.
//!
//! Formulas: [`crate::wind`]. One wind for all heights: drops take some metres to follow a change
//! of wind, and those that are seen are near the ground. The paper moves its drops by hand.

use crate::effects::effect::{Effect, EffectRole};
use crate::param::ParamValue;
use crate::wind::Wind;

crate::param::params! {
    /// The parameters of the effect.
    struct WindParams {
        /// Mean speed. Over time by keyframes: what falls drifts by its integral.
        speed: f64 = ParamValue::Number(5.0), 0.0 => 60.0, "m/s";
        /// Direction it blows towards, clockwise seen from above; 0 is the scene's x axis,
        /// projected to the horizontal (its y axis where x is up), as for `sky.heading`.
        direction: f64 = ParamValue::Number(90.0), -36_000.0 => 36_000.0, "deg";
        /// Gusts: standard deviation of the speed as a share of it; half as much across. 0.15 over
        /// open land, 0.25 and more between houses.
        gusts: f64 = ParamValue::Number(0.2), 0.0 => 1.0, "";
        /// Seed of the random gusts: a whole number.
        seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "wind",
    about: "Wind: carries rain and snow along, with gusts",
    role: EffectRole::Wind,
    needs: &[],
    precipitation: None,
    params: WindParams::PARAMS,
    contribute: |now, weather| {
        let WindParams { gusts, seed, .. } = WindParams::of(now.values);
        weather.set_wind(&Wind::new(now.tracks[0].clone(), now.tracks[1].clone(), gusts, seed as u64));
    },
    contribute_as_paper: None,
};
