//! The grids of maps: the frame that a direction of fall gives.

use crate::level::{dot, level_axes};
use serde::{Deserialize, Serialize};

/// The grid's frame: two axes and the fall, from a point in the middle of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Grid {
    /// Directions of the columns, of the rows and of the fall: world axes, length 1.
    pub(super) axes: [[f64; 3]; 3],
    /// The point that distances are from, world, scene units.
    pub(super) origin: [f64; 3],
    /// The first corner, from the origin along the first two axes, scene units.
    pub(super) low: [f64; 2],
    /// Width of a cell, scene units.
    pub(super) cell: f64,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Transmittance below which the fall counts as stopped, 0-1.
    pub(super) stopped: f32,
    /// True if the whole scene is in it.
    pub(super) is_whole: bool,
}

impl Grid {
    /// Returns true if its parts fit each other.
    pub(super) fn is_consistent(&self) -> bool {
        let numbers = self.axes.as_flattened().iter().chain(&self.origin).chain(&self.low);
        self.columns.checked_mul(self.rows).is_some_and(|cells| (1..=1 << 28).contains(&cells))
            && numbers.copied().all(f64::is_finite)
            && self.cell.is_finite()
            && self.cell > 0.0
            && self.stopped.is_finite()
    }
}

/// A vector at length 1; `None` if it has no direction.
pub(super) fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(v, v).sqrt();
    (length.is_finite() && length > 1e-12).then(|| v.map(|x| x / length))
}

/// Two axes across the fall, and the fall.
pub(super) fn axes_of(fall: [f64; 3]) -> [[f64; 3]; 3] {
    let [forward, right, _] = level_axes(fall.map(|v| -v));
    [forward, right, fall]
}
