//! Water that runs over sloping ground: how much of it comes together where.
//!
//! A priority flood over the ground with its relief gives each cell the cell that its water runs
//! to. What runs off of all cells above it, times the share of the rain that they get, runs over a
//! cell; it is as deep as Manning's formula for a wide sheet says, `d = (q n / sqrt(S))^0.6` for
//! `q` m^2/s on a slope `S`.

use super::basins::NO_BASIN;
use super::gather::gathered;
use super::surfaces::{WetShares, WetSurfaces};

/// Manning's roughness of paving, s/m^(1/3).
const MANNING_ROUGHNESS: f64 = 0.015;
/// Slopes over which water begins to run together into rills, and the steepest, on which it falls.
const RILL_SLOPES: [f32; 3] = [0.012, 0.025, 1.0];
/// Cells to each side over which a slope is taken.
const SLOPE_RADIUS_CELLS: usize = 2;

/// The flow of water over the ground of a place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunOff {
    /// Area whose water runs over each cell, each part times its share of the rain, m^2.
    area: Vec<f32>,
    /// Slope of each cell; 0 where it is level, has no ground, or lies in a basin.
    slope: Vec<f32>,
    /// Width of a cell, m.
    cell: f64,
}

impl RunOff {
    /// The flow over the ground of a scene that gets these shares of the rain.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, shares: &WetShares) -> Self {
        let ground = surfaces.ground();
        let [columns, _] = ground.places.size();
        let area = gathered(&ground.rough, &shares.ground, columns, ground.places.cell());
        let is_free = |at: usize| ground.basins.of[at] == NO_BASIN;
        let slope = (0..area.len()).map(|at| {
            if is_free(at) { slope_at(&ground.ground, at, columns, ground.places.cell() as f32) } else { 0.0 }
        });
        Self { slope: slope.collect(), area, cell: ground.places.cell() }
    }

    /// Depth of the running water, mm, if `rate` mm/h run off of ground that gets all of the rain;
    /// 0 where none runs together.
    pub(crate) fn depths(&self, rate: f64) -> Vec<f32> {
        if rate <= 0.0 {
            return vec![0.0; self.area.len()];
        }
        let depth = |area: f32, slope: f32| {
            let [least, most, steepest] = RILL_SLOPES;
            if slope <= least || slope > steepest {
                return 0.0;
            }
            let flow = f64::from(area) * rate * 1e-3 / 3600.0 / self.cell;
            let depth = 1e3 * (flow * MANNING_ROUGHNESS / f64::from(slope).sqrt()).powf(0.6);
            depth as f32 * ((slope - least) / (most - least)).min(1.0)
        };
        self.area.iter().zip(&self.slope).map(|(area, slope)| depth(*area, *slope)).collect()
    }
}

/// The slope of the ground at a cell; 0 where it is not known on both sides.
fn slope_at(ground: &[f32], at: usize, columns: usize, cell: f32) -> f32 {
    let (x, y, rows) = (at % columns, at / columns, ground.len() / columns);
    if x < SLOPE_RADIUS_CELLS
        || y < SLOPE_RADIUS_CELLS
        || x + SLOPE_RADIUS_CELLS >= columns
        || y + SLOPE_RADIUS_CELLS >= rows
    {
        return 0.0;
    }
    let over = 2.0 * SLOPE_RADIUS_CELLS as f32 * cell;
    let along = (ground[at + SLOPE_RADIUS_CELLS] - ground[at - SLOPE_RADIUS_CELLS]) / over;
    let across =
        (ground[at + SLOPE_RADIUS_CELLS * columns] - ground[at - SLOPE_RADIUS_CELLS * columns]) / over;
    let slope = along.hypot(across);
    if slope.is_nan() { 0.0 } else { slope }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slope with a furrow down its middle: what falls on it runs together there, and leaves at
    /// its foot.
    #[test]
    fn water_runs_together_in_a_furrow() {
        let (columns, rows) = (21, 40);
        let height = |at: usize| {
            let (x, y) = ((at % columns) as f32 - 10.0, (at / columns) as f32);
            0.005 * y + 0.002 * x.abs()
        };
        let heights: Vec<f32> = (0..columns * rows).map(height).collect();
        let area = gathered(&heights, &vec![1.0; heights.len()], columns, 0.1);
        let all = 0.01 * (columns * rows) as f32;
        let along = |y: usize| area[y * columns + 10];
        assert!(
            along(1) > 0.5 * all && along(1) > 1.5 * along(20) && along(20) > 20.0 * 0.01,
            "{} {}",
            along(1),
            along(20)
        );
        // Under half of the rain half as much runs.
        let half = gathered(&heights, &vec![0.5; heights.len()], columns, 0.1);
        assert!(area.iter().zip(&half).all(|(all, half)| (0.5 * all - half).abs() < 1e-4));
        let slope = slope_at(&heights, 20 * columns + 15, columns, 0.1);
        assert!((slope - 0.05f32.hypot(0.02)).abs() < 1e-4, "{slope}");
        let run_off = RunOff { slope: vec![0.05; area.len()], area, cell: 0.1 };
        // 5 m^2 in 50 mm/h are 7e-5 m^3/s, 7e-4 m^2/s in a cell.
        let depth = run_off.depths(50.0)[columns + 10];
        let flow = f64::from(run_off.area[columns + 10]) * 50e-3 / 3600.0 / 0.1;
        let want = 1e3 * (flow * 0.015 / 0.05f64.sqrt()).powf(0.6);
        assert!(
            (f64::from(depth) / want - 1.0).abs() < 1e-5 && (0.5..5.0).contains(&depth),
            "{depth} {want}"
        );
        assert!(run_off.depths(0.0).iter().all(|depth| *depth == 0.0));
    }
}
