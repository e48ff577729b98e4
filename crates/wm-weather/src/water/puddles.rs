//! The water of a wet place as a surface: puddles, and the film on the ground.

use super::map::{DRY_DEPTH_M, HIDING_DEPTH_M, WaterGrid, WaterNode};
use super::rills::Rills;
use crate::level::{level_axes, to_level};
use crate::optics::Site;
use crate::wetness::WaterState;

/// Height of the surface over the water: splats of the ground under it lie some centimetres
/// higher or lower.
const SURFACE_LIFT_M: f32 = 0.04;
/// Cells beyond a puddle in which its level goes on, and the most that its depth is there, m: water
/// that runs over there is gone.
const LEVEL_MARGIN_CELLS: usize = 2;
const MAX_MARGIN_DEPTH_M: f32 = -0.001;
/// Cells over which the edge of open water is softened.
const SOFT_EDGE_CELLS: usize = 3;
/// Slopes of damp asphalt, rms along one axis, and how fast a film levels them as it fills the
/// texture: menisci close over it before its peaks are under water.
const DAMP_ROUGHNESS: f32 = 0.3;
const FILM_LEVELLING_RATE: f32 = 2.0;

/// Depths of running water over which it becomes a stream of its own.
const STREAM_DEPTHS_MM: [f32; 2] = [0.5, 1.6];

/// The surface of the water on a place; `texture` is the mean depth of the texture of its ground,
/// mm. It is known on all ground, and hides as much of it as is wet. A film is the rougher the less
/// it fills the texture.
#[must_use]
pub fn puddles(state: &WaterState, texture: f64, site: &Site) -> WaterGrid {
    let axes = level_axes(site.up);
    let [x, y, base] = to_level(&axes, state.origin).map(|v| v * site.metres_per_unit);
    let texture = texture as f32;
    let streams = streams(state);
    let depths = depths(state);
    let open = open_share(state);
    let node = |at: usize| {
        let (seen, base) = (state.seen[at], base as f32 + SURFACE_LIFT_M);
        if state.open[at].is_finite() {
            return WaterNode {
                level: base + state.open[at],
                depth: DRY_DEPTH_M,
                film: seen * open[at],
                roughness: 0.0,
            };
        }
        let film = state.filled[at] + (state.film[at] + state.running[at]) / texture;
        WaterNode {
            level: base + state.ground[at] + depths[at].max(0.0),
            depth: if seen < 1.0 { depths[at].min(seen * HIDING_DEPTH_M) } else { depths[at] },
            // Ground whose pores are full mirrors too, as roughly as its grains lie. Between blades
            // of grass and crumbs of soil nothing is seen of it.
            film: seen * (state.filled[at].max(state.pores[at]) * (1.0 - state.matte[at])).max(streams[at]),
            roughness: DAMP_ROUGHNESS * (-FILM_LEVELLING_RATE * film).exp() * (1.0 - streams[at]),
        }
    };
    // Nodes are the middles of cells.
    let origin = [x + 0.5 * state.step, y + 0.5 * state.step];
    let nodes = (0..state.ground.len()).map(node);
    let mut grid = WaterGrid::new(origin, state.step, [state.width, state.height], nodes);
    grid.rills = Rills::new(streams, state.ground.clone(), state.step, state.width);
    grid
}

/// Depths of standing water at each node, m, below 0 beside it. Levels go on beyond the cells of
/// their puddles, where no water stands, so that the edge of the water is where they meet the
/// ground.
fn depths(state: &WaterState) -> Vec<f32> {
    let (width, height) = (state.width, state.height);
    let mut levels = state.level.clone();
    let depth = |level: f32, ground: f32| if level.is_nan() { DRY_DEPTH_M } else { level - ground };
    let nodes = levels.iter().zip(&state.ground);
    let mut depths: Vec<f32> = nodes.map(|(level, ground)| depth(*level, *ground)).collect();
    let mut last: Vec<usize> = (0..levels.len()).filter(|at| levels[*at].is_finite()).collect();
    for _ in 0..LEVEL_MARGIN_CELLS {
        let mut next = Vec::new();
        for at in last {
            let (x, y) = (at % width, at / width);
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for column in x.saturating_sub(1)..(x + 2).min(width) {
                    let beside = row * width + column;
                    if levels[beside].is_nan() && state.ground[beside].is_finite() {
                        levels[beside] = levels[at];
                        depths[beside] = (levels[at] - state.ground[beside]).min(MAX_MARGIN_DEPTH_M);
                        next.push(beside);
                    }
                }
            }
        }
        last = next;
    }
    softened(&depths, &levels, width)
}

/// Depths mixed with those of the nodes beside them where a level is known: the relief of the
/// ground is as fine as nodes are, and the edge of a puddle would follow single nodes.
fn softened(depths: &[f32], levels: &[f32], width: usize) -> Vec<f32> {
    const BINOMIAL_WEIGHTS: [f32; 3] = [1.0, 2.0, 1.0];
    let height = depths.len() / width;
    let soft = |at: usize| {
        let (x, y) = (at % width, at / width);
        if levels[at].is_nan() || x == 0 || y == 0 || x + 1 == width || y + 1 == height {
            return depths[at];
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for (row, down) in BINOMIAL_WEIGHTS.iter().enumerate() {
            for (column, right) in BINOMIAL_WEIGHTS.iter().enumerate() {
                let beside = (y + row - 1) * width + x + column - 1;
                if !levels[beside].is_nan() {
                    sum += down * right * depths[beside];
                    weights += down * right;
                }
            }
        }
        sum / weights
    };
    (0..depths.len()).map(soft).collect()
}

/// Share of open water at each node, 0-1: it ends softly at the cells of its edge.
fn open_share(state: &WaterState) -> Vec<f32> {
    let (width, height) = (state.width, state.height);
    let own = |at: usize| -> f32 {
        let (x, y) = (at % width, at / width);
        let rows = y.saturating_sub(SOFT_EDGE_CELLS)..(y + SOFT_EDGE_CELLS + 1).min(height);
        let columns = x.saturating_sub(SOFT_EDGE_CELLS)..(x + SOFT_EDGE_CELLS + 1).min(width);
        let near = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
        let count = near.filter(|near| state.open[*near].is_finite()).count();
        (2.0 * count as f32 / (2 * SOFT_EDGE_CELLS + 1).pow(2) as f32 - 1.0).max(0.0)
    };
    (0..state.open.len()).map(|at| if state.open[at].is_finite() { own(at) } else { 0.0 }).collect()
}

/// Share of the ground under a stream at each node, 0-1, by the depth of the running water,
/// smoothed over the nodes beside it.
fn streams(state: &WaterState) -> Vec<f32> {
    let own = |depth: f32| {
        let share =
            ((depth - STREAM_DEPTHS_MM[0]) / (STREAM_DEPTHS_MM[1] - STREAM_DEPTHS_MM[0])).clamp(0.0, 1.0);
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
