//! Depressions of the ground, how they fill and run over.
//!
//! A priority flood (Barnes, Lehman and Mulla 2014) raises water over the ground from where it can
//! leave: every cell that it lifts lies in a depression, whose water runs over at one place, into
//! the next depression or away. How much water comes to each is a matter of the ground that drains
//! into it, and its level follows from its volume by the heights of its cells.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// No basin: water leaves.
pub(crate) const NO_BASIN: u32 = u32::MAX;

/// The four ways to the next cell.
pub(super) const NEIGHBOUR_STEPS: [[i64; 2]; 4] = [[-1, 0], [1, 0], [0, -1], [0, 1]];

/// The four cells about a cell of a grid of `count` cells in rows of `columns`, in the order of
/// [`NEIGHBOUR_STEPS`]; `None` beyond its edge. With one division, as it is called for every cell
/// in every frame, and not four times [`away`].
pub(super) fn beside(at: usize, columns: usize, count: usize) -> [Option<usize>; 4] {
    let x = at % columns;
    [
        (x > 0).then(|| at - 1),
        (x + 1 < columns).then(|| at + 1),
        at.checked_sub(columns),
        Some(at + columns).filter(|next| *next < count),
    ]
}

/// The cells about a cell that are in the grid.
pub(super) fn neighbours(at: usize, columns: usize, count: usize) -> impl Iterator<Item = usize> {
    beside(at, columns, count).into_iter().flatten()
}

/// The cell so many columns and rows from a cell of such a grid; `None` beyond its edge.
pub(super) fn away(at: usize, way: [i64; 2], columns: usize, count: usize) -> Option<usize> {
    let (x, y) = ((at % columns) as i64 + way[0], (at / columns) as i64 + way[1]);
    let is_in = x >= 0 && y >= 0 && x < columns as i64 && y < (count / columns) as i64;
    is_in.then(|| y as usize * columns + x as usize)
}

/// The treatment of water at the edge of a cell without ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum EdgeRule {
    /// Something stands there: water stays.
    Wall,
    /// Water leaves.
    Outlet,
}

/// A depression.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Basin {
    /// Height at which it runs over, m.
    spill: f32,
    /// The basin that it runs over into, or [`NO_BASIN`].
    pub(crate) next: u32,
    /// Heights of its cells, rising, m.
    heights: Vec<f32>,
    /// Sum of the heights before each of those.
    sums: Vec<f64>,
    /// Area of a cell, m^2.
    cell: f64,
}

impl Basin {
    fn new(spill: f32, next: u32, mut heights: Vec<f32>, cell: f64) -> Self {
        heights.sort_by(f32::total_cmp);
        let sums = heights.iter().scan(0.0, |sum, height| {
            let before = *sum;
            *sum += f64::from(*height);
            Some(before)
        });
        Self { spill, next, sums: sums.collect(), heights, cell }
    }

    /// Depth at its deepest place when it is full, m.
    pub(crate) fn depth(&self) -> f32 {
        self.heights.first().map_or(0.0, |lowest| self.spill - lowest)
    }

    /// Area of a full basin, m^2.
    pub(crate) fn area(&self) -> f64 {
        self.cell * self.heights.len() as f64
    }

    /// The volume below a level, m^3.
    pub(crate) fn volume(&self, level: f32) -> f64 {
        let under = self.heights.partition_point(|height| *height < level);
        let sum = self.sums.get(under).copied().unwrap_or_else(|| self.sum());
        self.cell * (f64::from(level) * under as f64 - sum)
    }

    fn sum(&self) -> f64 {
        self.sums.last().map_or(0.0, |sum| sum + f64::from(self.heights[self.heights.len() - 1]))
    }

    /// The volume when it is full, m^3.
    pub(crate) fn capacity(&self) -> f64 {
        self.volume(self.spill)
    }

    /// The level and the area of some m^3 of water, m and m^2; the lowest height and 0 for none.
    pub(crate) fn level(&self, volume: f64) -> (f32, f64) {
        let Some(lowest) = self.heights.first() else { return (self.spill, 0.0) };
        if volume <= 0.0 {
            return (*lowest, 0.0);
        }
        // The most cells whose heights hold no more than this below the last of them.
        let (mut low, mut high) = (1, self.heights.len());
        while low < high {
            let middle = (low + high).div_ceil(2);
            let holds = f64::from(self.heights[middle - 1]) * (middle - 1) as f64 - self.sums[middle - 1];
            if self.cell * holds <= volume { low = middle } else { high = middle - 1 }
        }
        let sum = self.sums.get(low).copied().unwrap_or_else(|| self.sum());
        let level = (volume / self.cell + sum) / low as f64;
        ((level as f32).min(self.spill), self.cell * low as f64)
    }
}

/// The basins of a ground, and where its cells drain to.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Basins {
    /// The higher ones run over into lower ones, which come first.
    pub(crate) all: Vec<Basin>,
    /// The basin that each cell lies in, or [`NO_BASIN`].
    pub(crate) of: Vec<u32>,
    /// The basin that each cell drains into, or [`NO_BASIN`] of cells whose water leaves and of
    /// those without ground.
    pub(crate) drain: Vec<u32>,
}

/// A cell that the flood has reached: the lowest first, then by index.
pub(super) type Front = BinaryHeap<Reverse<(OrderedHeight, u32)>>;

#[derive(Clone, Copy, PartialEq)]
pub(super) struct OrderedHeight(pub f32);

impl Eq for OrderedHeight {}

impl PartialOrd for OrderedHeight {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for OrderedHeight {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl Basins {
    /// Returns true if its parts fit each other and a ground of `cells` cells.
    pub(super) fn is_consistent(&self, cells: usize) -> bool {
        let is_basin = |index: &u32| *index == NO_BASIN || (*index as usize) < self.all.len();
        // Lower ones come first, so that water cannot run in a circle.
        let is_sound = |index: usize| {
            let basin = &self.all[index];
            (basin.next == NO_BASIN || (basin.next as usize) < index)
                && !basin.heights.is_empty()
                && basin.heights.len() == basin.sums.len()
                && basin.heights.is_sorted()
                && basin.heights.iter().all(|height| height.is_finite())
                && basin.sums.iter().all(|sum| sum.is_finite())
                && basin.spill.is_finite()
                && basin.cell.is_finite()
        };
        [&self.of, &self.drain].iter().all(|list| list.len() == cells && list.iter().all(is_basin))
            && (0..self.all.len()).all(is_sound)
    }

    /// Finds the basins of a ground of `[rows, columns]` heights, m; not a number where there is
    /// none, of which `beyond` says what happens to water. `relief` is what is added to it for the
    /// edges of water, m, and `cell` the width of a cell, m. `counts` says of a basin, by its cells
    /// and its depth, whether water stands in it.
    pub(crate) fn find(
        ground: &[f32],
        relief: &[f32],
        columns: usize,
        cell: f64,
        beyond: impl Fn(usize) -> EdgeRule,
        counts: impl Fn(&[u32], f32) -> bool,
    ) -> Self {
        let beside = |index: usize| beside(index, columns, ground.len());
        let mut front = Front::new();
        let mut is_reached: Vec<bool> = ground.iter().map(|height| height.is_nan()).collect();
        for index in 0..ground.len() {
            let leaves = |next: Option<usize>| {
                next.is_none_or(|next| ground[next].is_nan() && beyond(next) == EdgeRule::Outlet)
            };
            if !ground[index].is_nan() && beside(index).into_iter().any(leaves) {
                is_reached[index] = true;
                front.push(Reverse((OrderedHeight(ground[index]), index as u32)));
            }
        }
        let (mut of, mut drain) = (vec![NO_BASIN; ground.len()], vec![NO_BASIN; ground.len()]);
        // Each with its spill, the cell it runs over at, and its cells.
        let mut found: Vec<(f32, u32, Vec<u32>)> = Vec::new();
        while let Some(Reverse((OrderedHeight(level), at))) = front.pop() {
            for next in beside(at as usize).into_iter().flatten() {
                if is_reached[next] {
                    continue;
                }
                is_reached[next] = true;
                let height = ground[next];
                let own = of[at as usize];
                if height < level {
                    let basin = if own != NO_BASIN && found[own as usize].0 == level {
                        own
                    } else {
                        found.push((level, at, Vec::new()));
                        found.len() as u32 - 1
                    };
                    of[next] = basin;
                    found[basin as usize].2.push(next as u32);
                    drain[next] = basin;
                } else {
                    drain[next] = if own != NO_BASIN { own } else { drain[at as usize] };
                }
                front.push(Reverse((OrderedHeight(height.max(level)), next as u32)));
            }
        }
        // Those that do not count hand on what comes to them. The next one was found before.
        let mut place: Vec<u32> = Vec::new();
        let mut all: Vec<Basin> = Vec::new();
        for (spill, outlet, cells) in &found {
            let outlet = *outlet as usize;
            let next = if of[outlet] != NO_BASIN { of[outlet] } else { drain[outlet] };
            let next = place.get(next as usize).copied().unwrap_or(NO_BASIN);
            let heights: Vec<f32> = cells
                .iter()
                .map(|at| ground[*at as usize] + relief[*at as usize])
                .filter(|height| height < spill)
                .collect();
            let basin = Basin::new(*spill, next, heights, cell * cell);
            if basin.area() > 0.0 && counts(cells, basin.depth()) {
                place.push(all.len() as u32);
                all.push(basin);
            } else {
                place.push(next);
            }
        }
        let is_own =
            |basin: u32, kept: u32| kept != NO_BASIN && all[kept as usize].spill == found[basin as usize].0;
        for basin in of.iter_mut().filter(|basin| **basin != NO_BASIN) {
            let kept = place[*basin as usize];
            *basin = if is_own(*basin, kept) { kept } else { NO_BASIN };
        }
        drain
            .iter_mut()
            .filter(|basin| **basin != NO_BASIN)
            .for_each(|basin| *basin = place[*basin as usize]);
        Self { all, of, drain }
    }

    /// Lets water come to the basins, m^3 each, and dry by a depth, m. `volumes` are theirs. What
    /// is too much runs over into the next one. Returns what left, and what dried, m^3.
    pub(crate) fn pass(&self, volumes: &mut [f64], came: &[f64], dries: f64) -> [f64; 2] {
        let (mut left, mut dried) = (0.0, 0.0);
        volumes.iter_mut().zip(came).for_each(|(volume, came)| *volume += came);
        // From the last to the first, which the others run over into.
        for at in (0..self.all.len()).rev() {
            let basin = &self.all[at];
            if dries > 0.0 && volumes[at] > 0.0 {
                let gone = (dries * basin.level(volumes[at]).1).min(volumes[at]);
                volumes[at] -= gone;
                dried += gone;
            }
            let over = volumes[at] - basin.capacity();
            if over > 0.0 {
                volumes[at] -= over;
                match volumes.get_mut(basin.next as usize) {
                    Some(next) => *next += over,
                    None => left += over,
                }
            }
        }
        [left, dried]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn basins(ground: &[f32], columns: usize) -> Basins {
        let relief = vec![0.0; ground.len()];
        Basins::find(ground, &relief, columns, 1.0, |_| EdgeRule::Outlet, |_, _| true)
    }

    #[test]
    fn cells_beside_a_cell_are_a_step_away() {
        let (columns, count) = (5, 20);
        for at in 0..count {
            assert_eq!(beside(at, columns, count), NEIGHBOUR_STEPS.map(|way| away(at, way, columns, count)));
        }
    }

    /// Two pits in a row on a slope, of which the upper one runs over into the lower one.
    #[test]
    fn a_pit_runs_over_into_the_next() {
        let (columns, rows) = (9, 5);
        let mut ground = vec![0.0f32; columns * rows];
        for (at, height) in ground.iter_mut().enumerate() {
            *height = 0.01 * (at % columns) as f32 + if matches!(at / columns, 1..=3) { 0.0 } else { 0.2 };
        }
        ground[2 * columns + 2] -= 0.05;
        ground[2 * columns + 6] -= 0.05;
        let found = basins(&ground, columns);
        assert_eq!(found.all.len(), 2);
        assert_eq!(found.all.iter().map(|basin| basin.next).collect::<Vec<_>>(), [NO_BASIN, 0]);
        let mut volumes = [0.0; 2];
        // 5 cm deep below the cell, 1 cm of which is the slope's.
        let full: Vec<f64> = found.all.iter().map(Basin::capacity).collect();
        assert!(full.iter().all(|full| (full - 0.04).abs() < 1e-6), "{full:?}");
        assert_eq!(found.pass(&mut volumes, &[0.0, 0.03], 0.0), [0.0; 2]);
        assert_eq!(volumes, [0.0, 0.03]);
        let [left, _] = found.pass(&mut volumes, &[0.0, 0.06], 0.0);
        assert!(
            (volumes[0] - 0.04).abs() < 1e-6
                && (volumes[1] - 0.04).abs() < 1e-6
                && (left - 0.01).abs() < 1e-6
        );
        let [_, dried] = found.pass(&mut volumes, &[0.0; 2], 0.01);
        assert!((dried - 0.02).abs() < 1e-6, "{dried}");
    }

    #[test]
    fn a_slope_holds_no_water() {
        let ground: Vec<f32> =
            (0..400).map(|at| 0.02 * (at % 20) as f32 + 0.003 * (at / 20) as f32).collect();
        assert!(basins(&ground, 20).all.is_empty());
    }

    proptest! {
        /// Water is kept account of, and levels hold their volumes.
        #[test]
        fn nothing_is_lost(heights in prop::collection::vec(0.0..1.0f32, 120), came in 0.0..0.5f64, dries in 0.0..0.1f64) {
            let found = basins(&heights, 12);
            let mut volumes = vec![0.0; found.all.len()];
            let mut comes = vec![0.0; found.all.len()];
            for drain in found.drain.iter().filter(|drain| **drain != NO_BASIN) {
                comes[*drain as usize] += came;
            }
            let (mut out, mut all) = (0.0, 0.0);
            for _ in 0..4 {
                let [left, dried] = found.pass(&mut volumes, &comes, dries);
                out += left + dried;
                all += comes.iter().sum::<f64>();
            }
            prop_assert!((volumes.iter().sum::<f64>() + out - all).abs() < 1e-9);
            for (at, (basin, volume)) in found.all.iter().zip(&volumes).enumerate() {
                prop_assert!(basin.next == NO_BASIN || (basin.next as usize) < at);
                let (level, area) = basin.level(*volume);
                prop_assert!((basin.volume(level) - volume).abs() < 1e-4 && area <= basin.area());
                prop_assert!(*volume <= basin.capacity() + 1e-9);
            }
        }
    }
}
