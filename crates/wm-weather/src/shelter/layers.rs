//! Surfaces one below the other: what lies open to the sky, and what lies under that.

use super::cast;
use super::grid::Grid;
use super::occluders::{FirstSurfaces, FloaterMap, Occluders};
use crate::level::dot;
use serde::{Deserialize, Serialize};

/// A surface is where less of what comes from above is left: near the top of leaves and of what is
/// not quite dense.
const TOP_TRANSMITTANCE: f32 = 0.75;

/// Surfaces straight below each other on a level grid, the uppermost first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct HeightLayers {
    grid: Grid,
    metres_per_unit: f64,
    /// Heights of each layer from the middle of the scene, m, `[rows, columns]`; negative infinity
    /// where there is none.
    pub(crate) heights: Vec<Vec<f32>>,
    /// The splats of those surfaces, in the same order; any where there is none.
    pub(crate) splats: Vec<Vec<u32>>,
}

impl Occluders {
    /// Removes the occluders that float over the place.
    #[must_use]
    pub fn standing(&self) -> Self {
        self.without(&self.layers(1, 0.0, 0.0).1)
    }

    /// The first `count` surfaces from above, each at least `gap` m and `cells` of the grid below
    /// the one before; and what floats above the first.
    pub(crate) fn layers(&self, count: usize, gap: f64, cells: f64) -> (HeightLayers, FloaterMap) {
        let grid = Grid { stopped: TOP_TRANSMITTANCE, ..self.grid(self.up.map(|v| -v)) };
        let footprints = cast::project(&self.all, &grid);
        let FirstSurfaces { mut stops, mut splats, opened } = self.first(&footprints, &grid);
        let gap = (gap / self.metres_per_unit).max(cells * grid.cell) as f32;
        let (mut heights, mut sources) = (Vec::new(), Vec::new());
        for layer in 0..count {
            if layer > 0 {
                let mut clear: Vec<f32> =
                    stops.iter().map(|stop| if stop.is_finite() { 1.0 } else { 0.0 }).collect();
                stops.iter_mut().for_each(|stop| *stop += gap);
                cast::cast(&footprints, &grid, &mut stops, &mut clear, &mut splats);
            }
            sources.push(splats.clone());
            heights.push(stops.iter().map(|stop| -stop * self.metres_per_unit as f32).collect());
        }
        let layers = HeightLayers { grid, metres_per_unit: self.metres_per_unit, heights, splats: sources };
        (layers, FloaterMap { grid, opened })
    }
}

impl HeightLayers {
    /// Returns true if its parts fit each other and a scene of `splats` splats.
    pub(crate) fn is_consistent(&self, splats: usize) -> bool {
        let cells = self.grid.columns.saturating_mul(self.grid.rows);
        let knows_its_splats = |heights: &[f32], found: &[u32]| {
            let mut cells = heights.iter().zip(found);
            cells.all(|(height, splat)| *height == f32::NEG_INFINITY || (*splat as usize) < splats)
        };
        self.grid.is_consistent()
            && self.metres_per_unit.is_finite()
            && self.heights.len() == self.splats.len()
            && self.heights.iter().zip(&self.splats).all(|(heights, found)| {
                heights.len() == cells && found.len() == cells && knows_its_splats(heights, found)
            })
    }

    /// The grid alone.
    pub(crate) fn heightless(&self) -> Self {
        Self { heights: Vec::new(), splats: Vec::new(), ..self.clone() }
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.grid.columns, self.grid.rows]
    }

    /// True if the whole scene is on the grid.
    pub(crate) fn is_whole(&self) -> bool {
        self.grid.is_whole
    }

    /// Width of a cell, m.
    pub(crate) fn cell(&self) -> f64 {
        self.grid.cell * self.metres_per_unit
    }

    /// The world axes of columns, of rows, and up.
    pub(crate) fn axes(&self) -> [[f64; 3]; 3] {
        let [across, along, fall] = self.grid.axes;
        [across, along, fall.map(|v| -v)]
    }

    /// Returns the position of a point (world, scene units) on the grid, in columns and rows from
    /// its first corner and m of height.
    pub(crate) fn point(&self, place: [f64; 2], height: f64) -> [f64; 3] {
        let [column, row] = place;
        let Grid { axes, origin, low, cell, .. } = &self.grid;
        let along = [low[0] + column * cell, low[1] + row * cell, -height / self.metres_per_unit];
        std::array::from_fn(|k| origin[k] + (0..3).map(|axis| axes[axis][k] * along[axis]).sum::<f64>())
    }

    /// Columns and rows of a point (world, scene units) from the first corner, and its height, m.
    pub(crate) fn locate(&self, point: [f64; 3]) -> ([f64; 2], f64) {
        let Grid { axes, origin, low, cell, .. } = &self.grid;
        let from = std::array::from_fn(|k| point[k] - origin[k]);
        let [column, row] = [0, 1].map(|k| (dot(from, axes[k]) - low[k]) / cell);
        ([column, row], -dot(from, axes[2]) * self.metres_per_unit)
    }

    /// The middle of a cell in columns and rows.
    pub(crate) fn middle(&self, cell: usize) -> [f64; 2] {
        [cell % self.grid.columns, cell / self.grid.columns].map(|v| v as f64 + 0.5)
    }

    /// The cell of a place in columns and rows; `None` off the grid.
    pub(crate) fn cell_at(&self, place: [f64; 2]) -> Option<usize> {
        let [column, row] = place;
        let [columns, rows] = self.size();
        let is_in = column >= 0.0 && row >= 0.0 && column < columns as f64 && row < rows as f64;
        is_in.then(|| row as usize * columns + column as usize)
    }
}
