//! Levels discs onto the surface through those about them.

use super::Disc;
use crate::threads::map;
use glam::{DVec3, I64Vec3};
use std::collections::HashMap;

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
    order: Vec<u32>,
    /// The range of a cell's discs in the order.
    ranges: HashMap<I64Vec3, (u32, u32)>,
}

impl Cells {
    /// In cells of a width.
    fn of(discs: &[Disc], width: f64) -> Self {
        let cells: Vec<I64Vec3> =
            discs.iter().map(|disc| (disc.point / width).floor().as_i64vec3()).collect();
        let mut order: Vec<u32> = (0..discs.len() as u32).collect();
        order.sort_by_key(|disc| cells[*disc as usize].to_array());
        let mut ranges = HashMap::new();
        for (k, disc) in order.iter().enumerate() {
            ranges.entry(cells[*disc as usize]).or_insert((k as u32, 0)).1 = k as u32 + 1;
        }
        Self { width, order, ranges }
    }

    /// Calls `work` with all in the cells within `reach` of a point.
    fn near(&self, point: DVec3, reach: f64, mut work: impl FnMut(usize)) {
        let [low, high] = [point - reach, point + reach].map(|v| (v / self.width).floor().as_i64vec3());
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    if let Some((from, to)) = self.ranges.get(&I64Vec3::new(x, y, z)) {
                        self.order[*from as usize..*to as usize].iter().for_each(|disc| work(*disc as usize));
                    }
                }
            }
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
                let other = &discs[other];
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
