//! Snow slides off what is too steep for it, down to where it can lie.

use super::ground::GroundGrid;
use serde::{Deserialize, Serialize};

/// Most rounds over all cells.
const MAX_ROUND_COUNT: usize = 120;
/// Least amount that a round must move to be followed by another, as a share of the total.
const MIN_MOVED_SHARE: f64 = 2e-5;
/// Excess over the fall that an edge holds before it falls over: snow holds together.
const EDGE_EXCESS_RATIO: f32 = 1.3;

/// The depths after sliding.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settled {
    /// Depth at each node of the ground, m.
    pub depth: Vec<f32>,
    /// The amount on walls, where nothing can lie, and that falls through leaves, as a depth on one
    /// cell, m.
    pub(crate) lost: f64,
}

/// Lets `fell` (m of depth per node) slide until no slope of its surface is steeper than `repose`
/// (a tangent).
pub(crate) fn settle(ground: &GroundGrid, fell: &[f32], repose: f32) -> Settled {
    let mut depth = fell.to_vec();
    let mut lost = 0.0;
    let total: f64 = fell.iter().map(|d| f64::from(*d)).sum();
    let step = repose * ground.cell;
    // Where something may move: after the first round, where it did and beside it.
    let mut active: Vec<u32> = (0..depth.len() as u32).filter(|node| depth[*node as usize] > 0.0).collect();
    let mut is_active = vec![false; depth.len()];
    let is_steep: Vec<bool> = (0..depth.len()).map(|node| ground.is_steep(node)).collect();
    for _ in 0..MAX_ROUND_COUNT {
        let mut moved = 0.0f64;
        for node in &active {
            let node = *node as usize;
            let own = depth[node];
            if own <= 1e-5 {
                continue;
            }
            let top = ground.height[node] + own;
            let mut went = false;
            // An inner ground holds as much as this one: nothing slides there.
            for (way, next) in ground.next(node).into_iter().enumerate() {
                // A pit between higher surfaces spills over their edges.
                let spills = || if own > ground.edge { ground.below(node, way, top) } else { None };
                let Some(to) = next.or_else(spills).filter(|to| !ground.is_elsewhere(*to)) else { continue };
                let fall = top - (ground.height[to] + depth[to]);
                // A pit that is full has no edge.
                let is_edge = ground.height[node] - (ground.height[to] + depth[to]) > ground.edge;
                let own = depth[node];
                let goes = if is_edge {
                    // Over an edge goes what came from above, and what lies on no surface.
                    if is_steep[node] { own } else { (own - EDGE_EXCESS_RATIO * fell[node]).max(0.0) }
                } else {
                    (0.25 * (fall - step)).clamp(0.0, own)
                };
                if goes > 1e-6 {
                    depth[node] -= goes;
                    depth[to] += goes;
                    moved += f64::from(goes);
                    went = true;
                    is_active[to] = true;
                }
            }
            if went {
                for near in ground.beside(node).into_iter().flatten().chain([node]) {
                    is_active[near] = true;
                }
            }
        }
        active.clear();
        active.extend((0u32..).zip(&is_active).filter_map(|(node, is_active)| is_active.then_some(node)));
        is_active.fill(false);
        if moved < MIN_MOVED_SHARE * total {
            break;
        }
    }
    // What still lies on walls has nowhere to go.
    for (node, depth) in depth.iter_mut().enumerate() {
        if is_steep[node] && *depth > 0.0 {
            lost += f64::from(*depth);
            *depth = 0.0;
        }
    }
    Settled { depth, lost }
}
