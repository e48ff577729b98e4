//! Flood: water that stands at one level, everywhere, so high over the ground at one place.
//!
//! [`crate::water`] computes where the water stands, what it mirrors and how it moves. The ground
//! under it fades with its depth as a Secchi disc does. `wind.speed` makes waves, and drops of
//! `rain` make rings. The paper has no flood; in fidelity `paper` it is drawn in the same way.
//!
//! With `flood.ground = "auto"` the level is over the ground under the camera: the plane of the
//! lowest large level surface about its foot, which `wm_scene::survey` finds. Over a shot the
//! ground is found once, for the first camera.

use crate::effects::effect::{Effect, EffectRole};
use crate::param::ParamValue;
use crate::water::Flood;

crate::param::params! {
    /// The parameters of the effect.
    struct FloodParams {
        /// Height of the water over the ground. Over time by keyframes: it rises and falls. At 0 or
        /// below there is none.
        level: f64 = ParamValue::Number(0.5), -100.0 => 1000.0, "m";
        /// Height of the ground that `level` counts from, over the ground that the scene states.
        /// `auto`: of the ground under the camera, at the start of a video or of a path.
        ground: Option<f64> = ParamValue::Auto, -10_000.0 => 10_000.0, "m";
        /// Secchi depth: how deep a white disc is still seen. 0.1 brown and muddy, 0.5 as most
        /// floods of rivers, 3 a clear lake, 10 and more the clear sea.
        secchi: f64 = ParamValue::Number(0.3), 0.02 => 60.0, "m";
        /// Colour of the water's own light, sRGB; only its hue counts. `auto` for that of the
        /// clearness: brown to blue-green.
        tint: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Open water that the wind blows over before it comes here: waves grow with it. 20 between
        /// houses, 1000 on a wide plain.
        fetch: f64 = ParamValue::Number(50.0), 0.0 => 100_000.0, "m";
        /// Another pattern of waves for each number.
        seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "flood",
    about: "Water that stands over the ground, with reflections, waves and rings of drops",
    role: EffectRole::Water,
    needs: &[],
    precipitation: None,
    params: FloodParams::PARAMS,
    contribute: |now, weather| {
        let FloodParams { level, ground, secchi, tint, fetch, seed } = FloodParams::of(now.values);
        let tint = tint.map(|rgb| {
            let light = rgb.map(wm_render::frame::srgb_decode);
            let most = light.into_iter().fold(1e-6, f64::max);
            light.map(|v| v / most)
        });
        weather.prepared.flood = Some(Flood { level, ground, secchi, tint, fetch, seed: seed as u64 });
    },
    contribute_as_paper: None,
};
