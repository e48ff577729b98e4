//! The surfaces of a scene that may stop rain and snow, stored compactly, for maps in any
//! direction.

use super::grid::{Grid, axes_of, unit};
use super::map::{FloaterRule, Shelter, ShelterOptions};
use super::occluder::Occluder;
use super::{cast, floaters};
use crate::level::dot;
use crate::optics::Site;
use crate::point_grid::median_spacing;
use glam::Vec3;
use wm_scene::{Group, Splats};

/// Extent of a splat for the size of the grid.
const SPLAT_REACH_SIGMAS: f64 = 2.0;
/// Largest standard deviation of a splat, in diagonals of the scene.
const MAX_SIGMA_DIAGONALS: f64 = 0.25;

/// Cells that indices and sums of 32 bits can hold.
const MOST_CELLS: usize = 1 << 28;

/// The splats of a scene that stop what falls, 44 bytes each: a map for another wind needs no more.
#[derive(Clone, Debug, PartialEq)]
pub struct Occluders {
    pub(super) options: ShelterOptions,
    pub(super) metres_per_unit: f64,
    pub(super) up: [f64; 3],
    /// Middle of the scene, scene units.
    pub(super) origin: [f64; 3],
    pub(super) all: Vec<Occluder>,
}

/// The first surface of each cell along a fall.
pub(super) struct FirstSurfaces {
    /// Distance of the stop along the fall, scene units from the origin; infinite where there is
    /// none.
    pub(crate) stops: Vec<f32>,
    /// Index of the stopping splat; any where there is none.
    pub(crate) splats: Vec<u32>,
    /// The cells that floaters were taken out of, and the distances beyond which they look on, the
    /// last of a cell last.
    pub(crate) opened: Vec<(u32, f32)>,
}

/// Floaters of a scene: what stands in an opened cell of a level map, above what it was opened for.
#[derive(Clone, Debug)]
pub(crate) struct FloaterMap {
    pub(super) grid: Grid,
    /// The opened cells of [`FirstSurfaces`].
    pub(super) opened: Vec<(u32, f32)>,
}

impl Occluders {
    /// Collects the occluders of a scene. Its sky must be labelled; splats with faults stop
    /// nothing.
    ///
    /// # Panics
    /// If the width of a cell is not above 0, or the site has no scale or no up.
    #[must_use]
    pub fn of(splats: &Splats, site: &Site, options: &ShelterOptions) -> Self {
        assert!(options.cell.is_finite() && options.cell > 0.0, "cells of {} m", options.cell);
        let metres_per_unit = site.metres_per_unit;
        assert!(metres_per_unit.is_finite() && metres_per_unit > 0.0, "a scale of {metres_per_unit}");
        let up = unit(site.up).expect("a site has an up");
        let kept: Vec<usize> = (0..splats.len())
            .filter(|&i| splats.groups[i] != Group::Sky && splats.opacity(i) >= options.least_opacity)
            .filter(|&i| is_sound(splats, i))
            .collect();
        let ranges = [0, 1, 2].map(|k| {
            let bounds = kept.iter().map(|&i| {
                let (mean, reach) = (f64::from(splats.means[i][k]), SPLAT_REACH_SIGMAS * largest(splats, i));
                [mean - reach, mean + reach]
            });
            range_within(bounds, options.outliers, [f64::NEG_INFINITY, f64::INFINITY]).0
        });
        let origin = ranges.map(|[low, high]| 0.5 * (low + high));
        let diagonal = ranges.iter().map(|[low, high]| (high - low).powi(2)).sum::<f64>().sqrt();
        let small = kept.iter().filter(|&&i| largest(splats, i) <= MAX_SIGMA_DIAGONALS * diagonal);
        let all = small.map(|&i| Occluder::at(splats, i, origin)).collect();
        Self { options: *options, metres_per_unit, up, origin, all }
    }

    /// Width of the cells of its maps, m.
    pub(crate) fn cell(&self) -> f64 {
        self.options.cell
    }

    /// Median distance from one to the nearest other, m; that of the cells at most, which is also
    /// the answer for none.
    pub(crate) fn spacing(&self) -> f64 {
        let most = (self.options.cell / self.metres_per_unit) as f32;
        let points: Vec<Vec3> = self.all.iter().map(|splat| Vec3::from_array(splat.mean)).collect();
        f64::from(median_spacing(&points, most)) * self.metres_per_unit
    }

    /// Sets options for maps of other cells, of another field and with another margin; what stops
    /// nothing stays so.
    pub(crate) fn mapped(self, options: &ShelterOptions) -> Self {
        Self { options: *options, ..self }
    }

    /// Makes maps with cells a number of times as wide.
    pub(crate) fn coarser(&self, times: f64) -> Self {
        self.clone().mapped(&ShelterOptions { cell: times * self.options.cell, ..self.options })
    }

    /// Returns the map for what falls along `fall` (world axes, of any length; straight down where
    /// it is zero or not finite). The map is the same for any number of threads.
    #[must_use]
    pub fn shelter(&self, fall: [f64; 3]) -> Shelter {
        let grid = self.grid(unit(fall).unwrap_or(self.up.map(|v| -v)));
        let footprints = cast::project(&self.all, &grid);
        let FirstSurfaces { stops, .. } = self.first(&footprints, &grid);
        Shelter::new(grid, stops, self.metres_per_unit, &self.options)
    }

    /// Finds the first surface of each cell along the fall.
    pub(super) fn first(&self, footprints: &cast::Footprints, grid: &Grid) -> FirstSurfaces {
        let mut stops = vec![f32::NEG_INFINITY; grid.columns * grid.rows];
        let mut clear = vec![1.0; stops.len()];
        let mut splats = vec![0; stops.len()];
        let mut opened = Vec::new();
        cast::cast(footprints, grid, &mut stops, &mut clear, &mut splats);
        let rounds = match self.options.floaters {
            FloaterRule::PassThrough => floaters::REMOVAL_ROUND_COUNT,
            FloaterRule::Stop => 0,
        };
        for _ in 0..rounds {
            if !floaters::reopen(&mut stops, &mut clear, grid, self.metres_per_unit) {
                break;
            }
            let beyond = stops.iter().zip(&clear).enumerate().filter(|(_, (_, left))| **left >= grid.stopped);
            opened.extend(beyond.map(|(cell, (stop, _))| (cell as u32, *stop)));
            cast::cast(&footprints.over(grid, &clear), grid, &mut stops, &mut clear, &mut splats);
        }
        FirstSurfaces { stops, splats, opened }
    }

    /// Removes the given floaters.
    pub(crate) fn without(&self, floaters: &FloaterMap) -> Self {
        let FloaterMap { grid, opened } = floaters;
        let mut floors = vec![f32::NEG_INFINITY; grid.columns * grid.rows];
        // What was opened twice is deeper the second time.
        opened.iter().for_each(|(cell, stop)| floors[*cell as usize] = *stop);
        let floats = |it: &&Occluder| {
            let [column, row] = [0, 1].map(|k| ((it.along(grid.axes[k]) - grid.low[k]) / grid.cell).floor());
            let is_in = column >= 0.0 && row >= 0.0 && column < grid.columns as f64 && row < grid.rows as f64;
            is_in && it.along(grid.axes[2]) as f32 <= floors[row as usize * grid.columns + column as usize]
        };
        let all = match opened.as_slice() {
            [] => self.all.clone(),
            _ => self.all.iter().filter(|it| !floats(it)).copied().collect(),
        };
        Self { all, ..*self }
    }

    /// The grid across a direction of fall.
    pub(super) fn grid(&self, fall: [f64; 3]) -> Grid {
        let axes = axes_of(fall);
        let mut is_whole = true;
        let [across, down] = [0, 1].map(|k| {
            let limits = self.options.focus.map_or([f64::NEG_INFINITY, f64::INFINITY], |(ends, metres)| {
                let [a, b] = ends.map(|end| dot(std::array::from_fn(|i| end[i] - self.origin[i]), axes[k]));
                let reach = metres / self.metres_per_unit;
                [a.min(b) - reach, a.max(b) + reach]
            });
            let bounds = self.all.iter().map(|splat| {
                let (mean, reach) =
                    (splat.along(axes[k]), SPLAT_REACH_SIGMAS * splat.between(axes[k], axes[k]).sqrt());
                [mean - reach, mean + reach]
            });
            let (range, is_cut) = range_within(bounds, self.options.outliers, limits);
            is_whole &= !is_cut;
            range
        });
        let size = [across[1] - across[0], down[1] - down[0]];
        let mut cell = self.options.cell / self.metres_per_unit;
        let cells = |length: f64, cell: f64| (length / cell).ceil().max(1.0);
        let most = self.options.most_cells.clamp(1, MOST_CELLS) as f64;
        loop {
            let count = cells(size[0], cell) * cells(size[1], cell);
            if count <= most {
                break;
            }
            // A long strip takes several steps.
            cell *= (count / most).sqrt().max(1.001);
        }
        let [mut columns, mut rows] = size.map(|length| cells(length, cell) as usize);
        if self.all.is_empty() || size.iter().any(|length| *length < 0.0) {
            [columns, rows] = [0, 0];
        }
        Grid {
            axes,
            origin: self.origin,
            low: [across[0], down[0]],
            cell,
            columns,
            rows,
            stopped: cast::STOPPING_TRANSMITTANCE,
            is_whole,
        }
    }
}

/// Returns true if the position and shape of a splat can be used; its colour does not matter.
fn is_sound(splats: &Splats, index: usize) -> bool {
    let faults = splats.faults(index);
    !(faults.mean || faults.scale || faults.opacity || faults.quat)
}

/// The largest standard deviation of a splat, scene units.
fn largest(splats: &Splats, index: usize) -> f64 {
    let [a, b, c] = splats.log_scales[index];
    f64::from(a.max(b).max(c)).exp()
}

/// The range from the low quantile `outliers` of the lower ends to the high one of the upper ends,
/// cut off at limits; and true if they cut anything off. Both ends are 0 if there are no bounds.
fn range_within(
    bounds: impl ExactSizeIterator<Item = [f64; 2]> + Clone,
    outliers: f64,
    ends: [f64; 2],
) -> ([f64; 2], bool) {
    let [first, last] = ends;
    let Some(end) = bounds.len().checked_sub(1) else { return ([0.0; 2], false) };
    let rank = ((outliers * end as f64) as usize).min(end / 2);
    // Counting is quicker than looking for a quantile that is cut off, and mostly ends soon.
    let is_cut = [
        first.is_finite() && bounds.clone().filter(|[low, _]| *low < first).nth(rank).is_some(),
        last.is_finite() && bounds.clone().filter(|[_, high]| *high > last).nth(rank).is_some(),
    ];
    if is_cut == [true; 2] {
        return ([first, last], true);
    }
    let (mut lows, mut highs): (Vec<f64>, Vec<f64>) = bounds.map(|[low, high]| (low, high)).unzip();
    let low = if is_cut[0] { first } else { *lows.select_nth_unstable_by(rank, f64::total_cmp).1 };
    let high = if is_cut[1] { last } else { *highs.select_nth_unstable_by(end - rank, f64::total_cmp).1 };
    ([low, high], is_cut[0] || is_cut[1])
}
