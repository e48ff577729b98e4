//! Levels discs onto the surface through those about them.

use super::Disc;
use crate::threads::map;
use glam::{DVec3, I64Vec3};
use std::collections::HashMap;

/// How far the discs are that a surface goes through, m, but so many of its own widths at least.
const FIELD: f64 = 0.3;
const WIDTHS: f64 = 2.5;
/// Least cosine between the normals of discs of one surface.
const ALIKE: f64 = 0.6;
/// Length of the mean normal from which on it is that of edges too.
const AGREED: f64 = 0.8;
/// How often.
const ROUNDS: usize = 3;

/// Discs by the cells of a grid.
struct Cells {
    width: f64,
    /// Where those of a cell begin and end.
    ranges: HashMap<I64Vec3, (u32, u32)>,
}

impl Cells {
    /// Sorts the discs by cell.
    fn of(discs: &mut [Disc], width: f64) -> Self {
        let cell = |disc: &Disc| (disc.point / width).floor().as_i64vec3();
        discs.sort_by_key(|disc| cell(disc).to_array());
        let mut ranges = HashMap::new();
        for (k, disc) in discs.iter().enumerate() {
            ranges.entry(cell(disc)).or_insert((k as u32, 0)).1 = k as u32 + 1;
        }
        Self { width, ranges }
    }

    /// Calls `work` with all in the cells within `reach` of a point.
    fn near(&self, point: DVec3, reach: f64, mut work: impl FnMut(usize)) {
        let [low, high] = [point - reach, point + reach].map(|v| (v / self.width).floor().as_i64vec3());
        for x in low.x..=high.x {
            for y in low.y..=high.y {
                for z in low.z..=high.z {
                    if let Some((from, to)) = self.ranges.get(&I64Vec3::new(x, y, z)) {
                        (*from..*to).for_each(|k| work(k as usize));
                    }
                }
            }
        }
    }
}

/// Moves each disc along the mean normal of those about it onto the plane through their middle, and turns it so.
pub(super) fn level(discs: &mut [Disc], metres_per_unit: f64, threads: usize) {
    let field = FIELD / metres_per_unit;
    for _ in 0..ROUNDS {
        let cells = Cells::of(discs, field);
        let moved = map(discs.len(), threads, |k| {
            let own = discs[k];
            let reach = field.max(WIDTHS * own.size);
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
