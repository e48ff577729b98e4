//! The water of a wet place as a surface: puddles, and the film on the ground.

use super::map::{WaterGrid, WaterNode};
use super::rills::Rills;
use crate::dome::{level_axes, to_level};
use crate::optics::Site;
use crate::wetness::WaterState;

/// Height of the surface over the water, m: splats of the ground under it lie some centimetres higher or lower.
const LIFT: f32 = 0.04;
/// Depth of a puddle from which it hides the texture of its bottom, m.
const HIDES: f32 = 0.004;
/// Slopes of asphalt under a film too thin to fill its texture, rms along one axis.
const ROUGH: f32 = 0.3;

/// Depths of running water over which it becomes a stream of its own, mm.
const RUNS: [f32; 2] = [0.5, 1.6];

/// The surface of the water on a place; `texture` is the mean depth of the texture of its ground, mm. It is known on all ground, and hides
/// as much of it as is under water. A film is the rougher the less it fills the texture.
#[must_use]
pub fn puddles(state: &WaterState, texture: f64, site: &Site) -> WaterGrid {
    let axes = level_axes(site.up);
    let [x, y, base] = to_level(&axes, state.origin).map(|v| v * site.metres_per_unit);
    let texture = texture as f32;
    let streams = streams(state);
    let node = |at: usize| {
        let ground = state.ground[at];
        let depth = (state.level[at] - ground).max(0.0);
        let stands = if depth.is_nan() { 0.0 } else { (depth / HIDES).min(1.0) };
        let stands = stands * stands * (3.0 - 2.0 * stands);
        let film = state.filled[at] + (state.film[at] + state.running[at]) / texture;
        let cover = stands.max(state.filled[at]).max(streams[at]);
        let level = base as f32 + ground.max(state.level[at]) + LIFT;
        WaterNode { level, cover, roughness: ROUGH * (-film).exp() * (1.0 - stands.max(streams[at])) }
    };
    // Nodes are the middles of cells.
    let origin = [x + 0.5 * state.step, y + 0.5 * state.step];
    let nodes = (0..state.ground.len()).map(node);
    let grid = WaterGrid::new(origin, state.step, [state.width, state.height], nodes);
    grid.with_rills(Rills::new(streams, state.ground.clone(), state.step, state.width))
}

/// Share of the ground under a stream at each node, 0-1, by the depth of the running water, smoothed over the nodes beside it.
fn streams(state: &WaterState) -> Vec<f32> {
    let own = |depth: f32| {
        let share = ((depth - RUNS[0]) / (RUNS[1] - RUNS[0])).clamp(0.0, 1.0);
        share * share * (3.0 - 2.0 * share)
    };
    let streams: Vec<f32> = state.running.iter().map(|depth| own(*depth)).collect();
    if streams.iter().all(|stream| *stream == 0.0) {
        return streams;
    }
    let (width, count) = (state.width, streams.len());
    let soft = |of: &[f32], stride: usize| -> Vec<f32> {
        let at = |at: Option<usize>| at.and_then(|at| of.get(at)).copied().unwrap_or(0.0);
        (0..count).map(|i| 0.5 * of[i] + 0.25 * (at(i.checked_sub(stride)) + at(Some(i + stride)))).collect()
    };
    soft(&soft(&streams, 1), width)
}
