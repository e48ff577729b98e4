//! The map of one direction of fall, and what it tells of points.

use super::grid::Grid;
use serde::{Deserialize, Serialize};

/// Margin in cells, at least: half a cell on a surface of slope 3.
const MARGIN_CELLS: f64 = 1.5;
/// Largest radius of [`Shelter::exposure`], cells: its cost grows with the square.
pub(super) const MOST_RADIUS: f32 = 64.0;

/// The treatment of lone pieces of a map high above all that is around them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloaterRule {
    /// Floaters stop nothing: what falls goes on to the next surface.
    PassThrough,
    /// Floaters stop what falls, and take no time to find.
    Stop,
}

/// Options of a shelter map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShelterOptions {
    /// Width of a cell, m; above 0. Made wider where the scene would have more than `most_cells`.
    pub cell: f64,
    /// Most cells of the grid, up to 2^28; 4 bytes each, and some 30 while it is made.
    pub most_cells: usize,
    /// The ends of a line (world, scene units) and how far from it across the fall the grid goes,
    /// m; `None` for the whole scene. In scenes that reach far it keeps the cells narrow where
    /// cameras are.
    pub focus: Option<([[f64; 3]; 2], f64)>,
    /// Share of the splats that the grid of a whole scene leaves out at each side, 0-0.5.
    pub outliers: f64,
    /// Splats of a lower opacity, 0-1, stop nothing: they are haze of the reconstruction.
    pub least_opacity: f64,
    /// Height above a point at which a surface begins to shelter it, m.
    pub margin: f64,
    /// The treatment of floaters.
    pub floaters: FloaterRule,
    /// Largest angle between a fall and that of the map for which the map is used, degrees.
    pub turn: f64,
}

impl Default for ShelterOptions {
    fn default() -> Self {
        Self {
            cell: 0.1,
            most_cells: 4_000_000,
            focus: None,
            outliers: 0.005,
            least_opacity: 0.1,
            margin: 0.15,
            floaters: FloaterRule::PassThrough,
            turn: 3.0,
        }
    }
}

/// The map of one scene for one direction of fall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shelter {
    pub(super) grid: Grid,
    /// Distance along the fall to what stops it, scene units from the origin, `[rows, columns]`.
    pub(super) stops: Vec<f32>,
    pub(super) metres_per_unit: f64,
    /// Cosine of the turn that the map allows.
    pub(super) turn: f64,
    pub(super) query: Query,
}

/// The data of a query, in f32.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Query {
    pub(super) origin: [f32; 3],
    /// Columns, rows a scene unit along the world axes; and the fall.
    pub(super) axes: [[f32; 3]; 3],
    /// Column and row of the origin.
    pub(super) start: [f32; 2],
    pub(super) size: [f32; 2],
    /// Scene units.
    pub(super) cell: f32,
    pub(super) margin: f32,
    pub(super) cells_per_metre: f32,
}

impl Shelter {
    /// Returns true if its parts fit each other, as an asset that a stranger made may not.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        self.grid.is_consistent()
            && self.stops.len() == self.grid.columns * self.grid.rows
            && [self.metres_per_unit, self.turn].into_iter().all(f64::is_finite)
            && self.query.size == [self.grid.columns, self.grid.rows].map(|cells| cells as f32)
    }

    pub(super) fn new(grid: Grid, stops: Vec<f32>, metres_per_unit: f64, options: &ShelterOptions) -> Self {
        let Grid { axes, origin, low, cell, columns, rows, .. } = grid;
        let scaled = |axis: [f64; 3], by: f64| axis.map(|v| (v * by) as f32);
        let query = Query {
            origin: origin.map(|v| v as f32),
            axes: [scaled(axes[0], 1.0 / cell), scaled(axes[1], 1.0 / cell), scaled(axes[2], 1.0)],
            start: low.map(|v| (-v / cell) as f32),
            size: [columns, rows].map(|v| v as f32),
            cell: cell as f32,
            margin: (options.margin / metres_per_unit).max(MARGIN_CELLS * cell) as f32,
            cells_per_metre: (1.0 / (metres_per_unit * cell)) as f32,
        };
        Self { grid, stops, metres_per_unit, turn: options.turn.to_radians().cos(), query }
    }

    /// Column and row of a point, and its distance along the fall, scene units.
    #[inline]
    pub(super) fn locate(&self, point: [f32; 3]) -> [f32; 3] {
        let Query { origin, axes, start, .. } = &self.query;
        let [x, y, z] = [point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]];
        let along = |axis: &[f32; 3]| x * axis[0] + y * axis[1] + z * axis[2];
        [start[0] + along(&axes[0]), start[1] + along(&axes[1]), along(&axes[2])]
    }

    /// Returns the distance along the fall from a point to the surface of its cell, scene units;
    /// infinite where there is none.
    #[inline]
    pub(super) fn ahead(&self, point: [f32; 3]) -> f32 {
        let [u, v, t] = self.locate(point);
        let [width, height] = self.query.size;
        // No NaN passes.
        if u >= 0.0 && v >= 0.0 && u < width && v < height {
            self.stops[v as usize * self.grid.columns + u as usize] - t
        } else {
            f32::INFINITY
        }
    }

    /// Returns true if the fall reaches `point` (world, scene units): no surface stands above it by
    /// more than the margin. Points off the grid are exposed, and those that are no number.
    #[inline]
    #[must_use]
    pub fn is_exposed(&self, point: [f32; 3]) -> bool {
        self.ahead(point) >= -self.query.margin
    }

    /// The direction that it was made for, world axes, length 1.
    pub(crate) fn fall(&self) -> [f64; 3] {
        self.grid.axes[2]
    }

    /// Width of a cell, m.
    pub(crate) fn cell(&self) -> f64 {
        self.grid.cell * self.metres_per_unit
    }
}
