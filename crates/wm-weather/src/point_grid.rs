//! Points by cells of a grid, and how far apart they are.

use crate::threads::map;
use glam::{IVec3, Vec3};
use std::ops::Range;

/// A map by whole numbers that say where something is. Nobody chooses them so that they collide, so
/// that a plain hash does.
pub(crate) type PlaceMap<K, V> = rustc_hash::FxHashMap<K, V>;

/// Surfaces whose nearest neighbour is looked for.
const MAX_SAMPLE_COUNT: usize = 4000;

/// Points by cells of a grid.
pub(crate) struct PointGrid {
    width: f32,
    cells: PlaceMap<IVec3, Range<u32>>,
    order: Vec<u32>,
}

impl PointGrid {
    /// Sorts points into cells of this width, or of a millionth of their distance from the origin
    /// where that is more.
    pub(crate) fn new(points: &[Vec3], width: f32) -> Self {
        let farthest = points.iter().map(|point| point.abs().max_element()).fold(0.0, f32::max);
        let width = width.max(1e-6 * farthest).max(f32::MIN_POSITIVE);
        let cell = |point: Vec3| (point / width).floor().as_ivec3();
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let key = |index: &u32| {
            let IVec3 { x, y, z } = cell(points[*index as usize]);
            (x, y, z, *index)
        };
        order.sort_unstable_by_key(key);
        let mut cells = PlaceMap::default();
        let mut first = 0;
        for run in order.chunk_by(|a, b| cell(points[*a as usize]) == cell(points[*b as usize])) {
            cells.insert(cell(points[run[0] as usize]), first..first + run.len() as u32);
            first += run.len() as u32;
        }
        Self { width, cells, order }
    }

    /// The indices of points in the cells within a width of `point`, in a fixed order.
    pub(crate) fn near(&self, point: Vec3) -> impl Iterator<Item = usize> {
        let middle = (point / self.width).floor().as_ivec3();
        cubes_about(middle, 1)
            .filter_map(|cube| self.cells.get(&cube))
            .flat_map(|range| &self.order[range.start as usize..range.end as usize])
            .map(|index| *index as usize)
    }
}

/// A cube and those within a reach of it.
pub(crate) fn cubes_about(middle: IVec3, reach: i32) -> impl Iterator<Item = IVec3> {
    let line = move || -reach..=reach;
    line().flat_map(move |x| line().flat_map(move |y| line().map(move |z| middle + IVec3::new(x, y, z))))
}

/// Median distance from a point to the nearest other, as far as `most`.
pub(crate) fn median_spacing(points: &[Vec3], most: f32) -> f32 {
    let grid = PointGrid::new(points, most);
    let asked = points.len().min(MAX_SAMPLE_COUNT);
    let mut nearest = map(asked, |k| {
        let index = k * points.len() / asked;
        let others = grid.near(points[index]).filter(|other| *other != index);
        others.map(|other| points[other].distance(points[index])).fold(most, f32::min)
    });
    let middle = nearest.len() / 2;
    if nearest.is_empty() { most } else { *nearest.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_finds_what_a_search_of_all_finds() {
        let points: Vec<Vec3> = (0..500u64)
            .map(|i| {
                let at = |k: u64| wm_base::random::uniform(7, 3 * i + k) as f32 * 4.0 - 2.0;
                Vec3::new(at(0), at(1), at(2))
            })
            .collect();
        let grid = PointGrid::new(&points, 0.5);
        for point in points.iter().step_by(17) {
            let mut found: Vec<usize> =
                grid.near(*point).filter(|i| points[*i].distance(*point) < 0.5).collect();
            found.sort_unstable();
            let all: Vec<usize> = (0..500).filter(|i| points[*i].distance(*point) < 0.5).collect();
            assert_eq!(found, all);
        }
    }
}
