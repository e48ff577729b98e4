//! The water of a wet place as a surface: puddles, and the film on the ground.

use super::map::{WaterGrid, WaterNode};
use crate::dome::{level_axes, to_level};
use crate::optics::Site;
use crate::wetness::WaterState;

/// Height of the surface over the water, m: splats of the ground under it lie some centimetres higher or lower.
const LIFT: f32 = 0.04;
/// Depth of a puddle from which it hides the texture of its bottom, m.
const HIDES: f32 = 0.004;
/// Slopes of asphalt under a film too thin to fill its texture, rms along one axis.
const ROUGH: f32 = 0.3;

/// The surface of the water on a place; `texture` is the mean depth of the texture of its ground, mm. It is known on all ground, and hides
/// as much of it as is under water. A film is the rougher the less it fills the texture.
#[must_use]
pub fn puddles(state: &WaterState, texture: f64, site: &Site) -> WaterGrid {
    let axes = level_axes(site.up);
    let [x, y, base] = to_level(&axes, state.origin).map(|v| v * site.metres_per_unit);
    let texture = texture as f32;
    let node = |at: usize| {
        let ground = state.ground[at];
        let depth = (state.level[at] - ground).max(0.0);
        let stands = if depth.is_nan() { 0.0 } else { (depth / HIDES).min(1.0) };
        let stands = stands * stands * (3.0 - 2.0 * stands);
        let film = state.filled[at] + state.film[at] / texture;
        let cover = stands.max(state.filled[at]);
        let level = base as f32 + ground.max(state.level[at]) + LIFT;
        WaterNode { level, cover, roughness: ROUGH * (-film).exp() * (1.0 - stands) }
    };
    // Nodes are the middles of cells.
    let origin = [x + 0.5 * state.step, y + 0.5 * state.step];
    let nodes = (0..state.ground.len()).map(node);
    WaterGrid::new(origin, state.step, [state.width, state.height], nodes)
}
