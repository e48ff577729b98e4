//! Snow cover: snow that lies, as deep as is asked for on open level ground.
//!
//! How it is spread, how it slides and how it is drawn: [`crate::cover`]. The depth may have keyframes: snow that grows
//! over a video. Fresh snow is about ten times as deep as the water in it (100 kg/m^3; 50 to 250 are seen), so that
//! 1 mm/h of water is 1 cm an hour.

use crate::cover::{Asked, Matter};
use crate::effects::{Action, Effect};
use crate::param::Value;
use wm_render::hooks::Slot;

crate::params! {
    /// What can be set.
    pub struct Params {
        /// Depth on open level ground. Below some 2 cm the ground shows between flakes. Over time by keyframes.
        depth: f64 = Value::Number(0.1), 0.0 => 10.0, "m";
        /// Steepest that it lies. Dry snow 38 to 50, wet snow more.
        repose: f64 = Value::Number(42.0), 5.0 => 80.0, "deg";
        /// Share of the light that it throws back: fresh snow 0.9, old 0.5.
        albedo: f64 = Value::Number(0.9), 0.0 => 1.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub const EFFECT: Effect = Effect {
    name: "snow_cover",
    about: "Snow that lies: on what is open to the sky, sliding off what is steep",
    slot: Slot::Surface,
    params: Params::PARAMS,
    act: |now, site| {
        let Params { depth, repose, albedo } = Params::of(now.values);
        // Level snow sees all of the sky, of which the airlight is the part near the horizon.
        let color = site.airlight.map(|v| (v * albedo).min(0.95));
        // In the shade blue sky is all that is left.
        let tint = [0.34, 0.37, 0.44];
        let shade = std::array::from_fn(|k| color[k] * tint[k]);
        Action::Cover(Asked { depth, repose: repose.to_radians().tan(), matter: Matter { color, shade } })
    },
    act_as_paper: None,
};
