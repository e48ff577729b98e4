//! Eaves of roofs: where water that runs off of them falls to the ground.
//!
//! A roof is what stands over the ground beside it and is even, as leaves are not. Its water runs
//! as that of the ground does ([`run_off`](super::run_off)), to the cells from which it falls onto
//! open ground. Most eaves have gutters, which no capture shows; so the share of the water that
//! falls is requested.

use super::basins::{NEIGHBOUR_STEPS, away, neighbours};
use super::gather::gathered;
use super::plane_fit::PlaneFit;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Least height of an eave over the ground under it, m.
const MIN_EAVE_HEIGHT_M: f32 = 1.8;
/// Height of what stands on ground that is open, m.
const OPEN_HEIGHT_M: f32 = 0.4;
/// Distance to the ground whose height a roof is compared with, m.
const GROUND_DISTANCE_M: f32 = 12.0;
/// Cells to each side over which a roof must be even, the least share of them, and how uneven it
/// may be, rms, m.
const ROOF_RADIUS_CELLS: i64 = 3;
const MIN_EVEN_SHARE: f64 = 0.4;
const MAX_UNEVENNESS_M: f64 = 0.06;
/// The most cells of an edge between a roof and open ground.
const MAX_EDGE_CELLS: usize = 6;
/// Least area that drains over an eave, m^2 for each metre of it.
const MIN_DRAINED_AREA: f32 = 0.4;

/// A piece of an eave, as long as a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Eave {
    /// The place on which its water falls: columns and rows from the first corner.
    pub(crate) place: [f32; 2],
    /// Height over the ground there, m.
    pub(crate) drop: f32,
    /// Height of that ground, m.
    pub(crate) ground: f32,
    /// Area whose water it sheds, m^2.
    pub(crate) area: f32,
}

/// Finds the eaves over a `ground` of smoothed heights, m, by the heights of what stands highest on
/// it, `top`, m, both on cells `cell` m wide in rows of `columns`; not a number where there is
/// none.
pub(crate) fn eaves(top: &[f32], ground: &[f32], columns: usize, cell: f32) -> Vec<Eave> {
    let about = ground_about(top, ground, columns, (GROUND_DISTANCE_M / cell) as u32);
    let is_roof =
        |at: usize| top[at] > about[at] + MIN_EAVE_HEIGHT_M && is_even(top, at, columns, f64::from(cell));
    let roofs: Vec<f32> = (0..top.len()).map(|at| if is_roof(at) { top[at] } else { f32::NAN }).collect();
    if roofs.iter().all(|height| height.is_nan()) {
        return Vec::new();
    }
    let area = gathered(&roofs, &vec![1.0; roofs.len()], columns, f64::from(cell));
    let is_open = |at: usize, height: f32| {
        ground[at].is_finite()
            && top[at] < ground[at] + OPEN_HEIGHT_M
            && height > ground[at] + MIN_EAVE_HEIGHT_M
    };
    let middle = |at: usize| [at % columns, at / columns].map(|v| v as f32 + 0.5);
    let mut found = Vec::new();
    for at in (0..roofs.len()).filter(|at| roofs[*at].is_finite() && area[*at] > MIN_DRAINED_AREA * cell) {
        // Beyond the edge, on the side where open ground is nearest. The edge itself is uneven.
        let falls = |steps: usize| {
            let onto = |way: [i64; 2]| {
                let beyond = |steps: usize| away(at, way.map(|v| v * steps as i64), columns, roofs.len());
                let [from, to] = [steps, steps + 1].map(beyond);
                let is_off = beyond(1).is_some_and(|next| roofs[next].is_nan());
                from.zip(to).filter(|(_, to)| is_off && is_open(*to, roofs[at]))
            };
            NEIGHBOUR_STEPS.into_iter().filter_map(onto).min_by(|a, b| ground[a.1].total_cmp(&ground[b.1]))
        };
        if let Some((from, to)) = (0..MAX_EDGE_CELLS).find_map(falls) {
            let (last, next) = (middle(from), middle(to));
            found.push(Eave {
                place: [0, 1].map(|k| 0.4 * last[k] + 0.6 * next[k]),
                drop: roofs[at] - ground[to],
                ground: ground[to],
                area: area[at],
            });
        }
    }
    found
}

/// The height of the open ground that is nearest to each cell; not a number where it is farther
/// than so many cells.
fn ground_about(top: &[f32], ground: &[f32], columns: usize, far: u32) -> Vec<f32> {
    let mut about = vec![f32::NAN; ground.len()];
    let mut next = VecDeque::new();
    for at in 0..ground.len() {
        if ground[at].is_finite() && top[at] < ground[at] + OPEN_HEIGHT_M {
            about[at] = ground[at];
            next.push_back((at, 0));
        }
    }
    while let Some((at, steps)) = next.pop_front() {
        for beside in neighbours(at, columns, ground.len()) {
            if steps < far && about[beside].is_nan() {
                about[beside] = about[at];
                next.push_back((beside, steps + 1));
            }
        }
    }
    about
}

/// Returns true if what is about a cell at about its height lies in a plane.
fn is_even(top: &[f32], at: usize, columns: usize, cell: f64) -> bool {
    // Roofs are no steeper than this over the reach.
    let steep = 1.5 * cell as f32 * ROOF_RADIUS_CELLS as f32 * std::f32::consts::SQRT_2;
    let (mut fit, mut all) = (PlaneFit::default(), 0.0);
    for (dy, dx) in (-ROOF_RADIUS_CELLS..=ROOF_RADIUS_CELLS)
        .flat_map(|dy| (-ROOF_RADIUS_CELLS..=ROOF_RADIUS_CELLS).map(move |dx| (dy, dx)))
    {
        all += 1.0;
        let Some(next) = away(at, [dx, dy], columns, top.len()) else { continue };
        let rise = top[next] - top[at];
        if !rise.is_nan() && rise.abs() <= steep {
            fit.add([dx, dy].map(|v| v as f64 * cell), f64::from(rise));
        }
    }
    let plane = fit.plane(MIN_EVEN_SHARE * all, 1e-9);
    plane.is_some_and(|plane| plane.variance < MAX_UNEVENNESS_M * MAX_UNEVENNESS_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMN_COUNT: usize = 100;
    const CELL_WIDTH_M: f32 = 0.1;

    /// A yard with a lean-to roof of 4 m by 6 m, whose lower edge is 3 m over the ground, at column
    /// 60, and a crown of leaves.
    fn yard(bumps: f32) -> (Vec<f32>, Vec<f32>) {
        let count = COLUMN_COUNT * COLUMN_COUNT;
        let ground = vec![0.0; count];
        let top = (0..count).map(|at| {
            let (x, y) = (at % COLUMN_COUNT, at / COLUMN_COUNT);
            let noise = ((at as u32).wrapping_mul(2_654_435_761) >> 16) as f32 / 65_536.0 - 0.5;
            if (20..60).contains(&x) && (20..80).contains(&y) {
                3.0 + 0.5 * CELL_WIDTH_M * (59 - x) as f32 + bumps * noise
            } else {
                0.0
            }
        });
        (top.collect(), ground)
    }

    #[test]
    fn water_falls_from_the_lower_edge_of_a_roof() {
        let (top, ground) = yard(0.005);
        let found = eaves(&top, &ground, COLUMN_COUNT, CELL_WIDTH_M);
        let low: Vec<&Eave> = found.iter().filter(|eave| eave.place[0] > 59.5).collect();
        let area = |of: &[&Eave]| of.iter().map(|eave| eave.area).sum::<f32>();
        assert!(area(&low) > 0.85 * 24.0, "{}", area(&low));
        assert!(area(&found.iter().collect::<Vec<_>>()) < 1.01 * 24.0);
        for eave in low {
            assert!((eave.drop - 3.0).abs() < 0.05 && eave.ground == 0.0, "{eave:?}");
            assert!((59.5..60.5).contains(&eave.place[0]), "{eave:?}");
        }
    }

    #[test]
    fn crowns_of_trees_are_no_roofs() {
        let (top, ground) = yard(0.5);
        assert!(eaves(&top, &ground, COLUMN_COUNT, CELL_WIDTH_M).is_empty());
    }
}
