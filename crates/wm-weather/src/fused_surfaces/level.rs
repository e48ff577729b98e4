//! Levels discs onto the surface through those about them.

use super::Disc;
use crate::threads::map;
use glam::DVec3;
use std::collections::HashMap;
use std::ops::Range;

/// Distance of the discs that a surface is fitted to, m, but so many of its own widths at least.
const FIELD: f64 = 0.3;
const WIDTHS: f64 = 4.0;
/// Least cosine between the normals of discs of one surface.
const ALIKE: f64 = 0.6;
/// Length of the mean normal from which on it is that of edges too.
const AGREED: f64 = 0.8;
/// The number of rounds.
const ROUNDS: usize = 3;

/// Discs by the cells of a grid.
struct Cells {
    width: f64,
    /// In order of their cells' x, y and z.
    discs: Vec<Disc>,
    /// Each disc's cell's z.
    levels: Vec<i64>,
    /// The discs of all cells above each other.
    columns: HashMap<[i64; 2], Range<usize>>,
}

impl Cells {
    /// In cells of a width.
    fn of(discs: &[Disc], width: f64) -> Self {
        let cell = |disc: &Disc| (disc.point / width).floor().as_i64vec3().to_array();
        let mut order: Vec<([i64; 3], u32)> = discs.iter().map(cell).zip(0..).collect();
        order.sort_unstable();
        let mut columns: HashMap<[i64; 2], Range<usize>> = HashMap::new();
        for (k, ([x, y, _], _)) in order.iter().enumerate() {
            columns.entry([*x, *y]).or_insert(k..k).end = k + 1;
        }
        let levels = order.iter().map(|([_, _, z], _)| *z).collect();
        Self { width, discs: order.iter().map(|(_, disc)| discs[*disc as usize]).collect(), levels, columns }
    }

    /// Calls `work` with all in the cells within `reach` of a point.
    fn near(&self, point: DVec3, reach: f64, mut work: impl FnMut(&Disc)) {
        let [low, high] = [point - reach, point + reach].map(|v| (v / self.width).floor().as_i64vec3());
        for (x, y) in (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y))) {
            let Some(column) = self.columns.get(&[x, y]) else { continue };
            let (levels, discs) = (&self.levels[column.clone()], &self.discs[column.clone()]);
            let from = levels.partition_point(|z| *z < low.z);
            let to = levels.partition_point(|z| *z <= high.z);
            discs[from..to].iter().for_each(&mut work);
        }
    }
}

/// Moves each disc along the mean normal of those about it onto the plane through their middle, and turns it so.
pub(super) fn level(discs: &mut [Disc], metres_per_unit: f64, threads: usize) {
    let reach = |size: f64| (FIELD / metres_per_unit).max(WIDTHS * size);
    let mut reaches: Vec<f64> = discs.iter().map(|disc| reach(disc.size)).collect();
    reaches.sort_by(f64::total_cmp);
    reaches.dedup();
    for _ in 0..ROUNDS {
        // A grid for each reach: few cells are in it.
        let grids: Vec<Cells> = reaches.iter().map(|reach| Cells::of(discs, *reach)).collect();
        let moved = map(discs.len(), threads, |k| {
            let own = discs[k];
            let reach = reach(own.size);
            let cells = grids.iter().find(|grid| grid.width == reach).expect("a grid for each reach");
            let (mut weight, mut middle, mut normal) = (0.0, DVec3::ZERO, DVec3::ZERO);
            cells.near(own.point, reach, |other| {
                let off = other.point - own.point;
                let near = 1.0 - off.length_squared() / (reach * reach);
                if near <= 0.0 || other.is_edge {
                    return;
                }
                if !own.is_edge && other.normal.dot(own.normal) < ALIKE {
                    return;
                }
                let share = near * near * other.weight;
                weight += share;
                middle += off * share;
                normal += other.normal * share;
            });
            // Edges take the normal of what is about them, if that is of one mind.
            if own.is_edge && (weight == 0.0 || normal.length() < AGREED * weight) {
                return own;
            }
            let normal = normal.normalize_or(own.normal);
            let own = Disc { is_edge: false, ..own };
            Disc { point: own.point + normal * (middle / weight).dot(normal), normal, ..own }
        });
        discs.copy_from_slice(&moved);
    }
}
