//! The water that comes together over each cell of a slope.

use super::basins::{Front, NO_BASIN, OrderedHeight, away};
use std::cmp::Reverse;
use wm_base::random;

/// Neighbours of a cell in its own row and column.
const STRAIGHT_WAY_COUNT: usize = 4;
/// Seed of the distances to the others.
const DISTANCE_SEED: u64 = 0x5255_4E4F;

/// The area that drains over each cell of a grid of heights, m^2, each cell times its share.
///
/// Water runs to the steepest lower neighbour, and out of hollows the way that the flood came in.
/// The distance to slanted neighbours is drawn by chance between 1 and 2 cells, so that water keeps
/// its direction in the mean (Fairfield and Leymarie 1991).
pub(super) fn gathered(heights: &[f32], shares: &[f32], columns: usize, cell: f64) -> Vec<f32> {
    let mut front: Front = Front::new();
    let mut is_reached: Vec<bool> = heights.iter().map(|height| height.is_nan()).collect();
    for at in 0..heights.len() {
        let is_edge =
            || around(at, columns, heights.len()).any(|next| next.is_none_or(|next| heights[next].is_nan()));
        if !heights[at].is_nan() && is_edge() {
            is_reached[at] = true;
            front.push(Reverse((OrderedHeight(heights[at]), at as u32)));
        }
    }
    // Cells in the order in which the flood passes them, and where it came from; nothing runs on
    // from the edge.
    let mut passed: Vec<u32> = Vec::with_capacity(heights.len());
    let mut rank = vec![u32::MAX; heights.len()];
    let mut to = vec![NO_BASIN; heights.len()];
    while let Some(Reverse((OrderedHeight(level), at))) = front.pop() {
        let own = at as usize;
        rank[own] = passed.len() as u32;
        passed.push(at);
        if level <= heights[own] && to[own] != NO_BASIN {
            let slanted = 2.0 - random::uniform(DISTANCE_SEED, own as u64) as f32;
            let falls = around(own, columns, heights.len()).enumerate().filter_map(|(way, next)| {
                let next = next?;
                let fall =
                    (heights[own] - heights[next]) / if way < STRAIGHT_WAY_COUNT { 1.0 } else { slanted };
                (rank[next] < rank[own] && fall > 0.0).then_some((next, fall))
            });
            // Of equal ones the first.
            if let Some((next, _)) = falls.reduce(|best, next| if next.1 > best.1 { next } else { best }) {
                to[own] = next as u32;
            }
        }
        for next in around(own, columns, heights.len()).flatten() {
            if !is_reached[next] {
                is_reached[next] = true;
                to[next] = at;
                front.push(Reverse((OrderedHeight(heights[next].max(level)), next as u32)));
            }
        }
    }
    let own = (cell * cell) as f32;
    let mut area: Vec<f32> = shares.iter().map(|share| own * share).collect();
    for at in passed.into_iter().rev().filter(|at| to[*at as usize] != NO_BASIN) {
        area[to[at as usize] as usize] += area[at as usize];
    }
    area
}

/// The eight cells about a cell, first the [`STRAIGHT_WAY_COUNT`] ones; `None` beyond the edge of
/// the grid.
fn around(at: usize, columns: usize, count: usize) -> impl Iterator<Item = Option<usize>> {
    const NEIGHBOUR_STEPS: [[i64; 2]; 8] =
        [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];
    NEIGHBOUR_STEPS.into_iter().map(move |way| away(at, way, columns, count))
}
