//! Levels discs onto the surface through those about them.

use super::cubes::Disc;
use crate::threads::map;
use glam::DVec3;
use std::collections::HashMap;
use std::ops::Range;
use wm_render::dispatch;
use wm_render::simd::SimdPath;

/// Distance of the discs that a surface is fitted to, m, but so many of its own widths at least.
const FIELD: f64 = 0.3;
const WIDTHS: f64 = 4.0;
/// Least cosine between the normals of discs of one surface.
const ALIKE: f64 = 0.6;
/// Length of the mean normal from which on it is that of edges too.
const AGREED: f64 = 0.8;
/// The number of rounds.
const ROUNDS: usize = 3;

/// Discs that are taken at once.
const LANES: usize = 8;

/// Discs that are no edges, by the cells of a grid.
struct Cells {
    width: f64,
    /// World, scene units; single precision is enough from there.
    origin: DVec3,
    /// In order of their cells' x, y and z: x, y and z from the origin, those of the normal, and the weight; and [`LANES`] of
    /// no weight behind the last.
    discs: [Vec<f32>; 7],
    /// Each disc's cell's z.
    levels: Vec<i64>,
    /// The discs of all cells above each other.
    columns: HashMap<[i64; 2], Range<usize>>,
}

/// The mean of the discs about one.
struct Surroundings {
    weight: f64,
    /// From the one, times the weight, scene units.
    middle: DVec3,
    /// Times the weight.
    normal: DVec3,
}

impl Cells {
    /// In cells of a width.
    fn of(discs: &[Disc], width: f64) -> Self {
        let cell = |disc: &Disc| (disc.point / width).floor().as_i64vec3().to_array();
        let known = (0u32..).zip(discs).filter(|(_, disc)| !disc.is_edge);
        let mut order: Vec<([i64; 3], u32)> = known.map(|(index, disc)| (cell(disc), index)).collect();
        order.sort_unstable();
        let mut columns: HashMap<[i64; 2], Range<usize>> = HashMap::new();
        for (k, ([x, y, _], _)) in order.iter().enumerate() {
            columns.entry([*x, *y]).or_insert(k..k).end = k + 1;
        }
        let levels = order.iter().map(|([_, _, z], _)| *z).collect();
        let origin = discs.first().map_or(DVec3::ZERO, |disc| disc.point);
        let column = |value: &dyn Fn(&Disc) -> f64| {
            let values = order.iter().map(|(_, index)| value(&discs[*index as usize]) as f32);
            values.chain([0.0; LANES]).collect()
        };
        let discs = [
            column(&|disc| disc.point.x - origin.x),
            column(&|disc| disc.point.y - origin.y),
            column(&|disc| disc.point.z - origin.z),
            column(&|disc| disc.normal.x),
            column(&|disc| disc.normal.y),
            column(&|disc| disc.normal.z),
            column(&|disc| disc.weight),
        ];
        Self { width, origin, discs, levels, columns }
    }

    /// Returns the mean of the discs within `reach` of one, nearer ones counting more; of those that face as it does if it has a normal.
    #[inline(always)]
    fn about(&self, own: &Disc, reach: f64) -> Surroundings {
        let [low, high] =
            [own.point - reach, own.point + reach].map(|v| (v / self.width).floor().as_i64vec3());
        let mut sums = [[0.0f32; LANES]; 7];
        for (x, y) in (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y))) {
            let Some(column) = self.columns.get(&[x, y]) else { continue };
            let levels = &self.levels[column.clone()];
            let from = column.start + levels.partition_point(|z| *z < low.z);
            let to = column.start + levels.partition_point(|z| *z <= high.z);
            self.add(from..to, own, reach, &mut sums);
        }
        let [weight, x, y, z, nx, ny, nz] = sums.map(|lanes| f64::from(lanes.iter().sum::<f32>()));
        Surroundings { weight, middle: DVec3::new(x, y, z), normal: DVec3::new(nx, ny, nz) }
    }

    /// Adds some discs to the sums of weight, offset and normal about one.
    #[inline(always)]
    fn add(&self, range: Range<usize>, own: &Disc, reach: f64, sums: &mut [[f32; LANES]; 7]) {
        let [x, y, z] = (own.point - self.origin).to_array().map(|v| v as f32);
        let [nx, ny, nz] = own.normal.to_array().map(|v| v as f32);
        let least = if own.is_edge { f32::NEG_INFINITY } else { ALIKE as f32 };
        let narrow = (1.0 / (reach * reach)) as f32;
        for first in range.clone().step_by(LANES) {
            let lanes: [&[f32; LANES]; 7] =
                self.discs.each_ref().map(|column| column[first..].first_chunk().expect("padded"));
            for lane in 0..LANES {
                let [dx, dy, dz] = [lanes[0][lane] - x, lanes[1][lane] - y, lanes[2][lane] - z];
                let near = (1.0 - (dx * dx + dy * dy + dz * dz) * narrow).max(0.0);
                let cosine = lanes[3][lane] * nx + lanes[4][lane] * ny + lanes[5][lane] * nz;
                let weight = if first + lane < range.end && cosine >= least { lanes[6][lane] } else { 0.0 };
                let share = near * near * weight;
                sums[0][lane] += share;
                sums[1][lane] += share * dx;
                sums[2][lane] += share * dy;
                sums[3][lane] += share * dz;
                sums[4][lane] += share * lanes[3][lane];
                sums[5][lane] += share * lanes[4][lane];
                sums[6][lane] += share * lanes[5][lane];
            }
        }
    }
}

/// Moves each disc along the mean normal of those about it onto the plane through their middle, and turns it so.
pub(super) fn level(discs: &mut [Disc], metres_per_unit: f64, threads: usize) {
    let path = SimdPath::widest();
    let reach = |size: f64| (FIELD / metres_per_unit).max(WIDTHS * size);
    let mut reaches: Vec<f64> = discs.iter().map(|disc| reach(disc.size)).collect();
    reaches.sort_by(f64::total_cmp);
    reaches.dedup();
    for _ in 0..ROUNDS {
        // A grid for each reach: few cells are in it.
        let grids = map(reaches.len(), threads, |k| Cells::of(discs, reaches[k]));
        let moved = map(discs.len(), threads, |k| {
            let own = discs[k];
            let reach = reach(own.size);
            let cells = grids.iter().find(|grid| grid.width == reach).expect("a grid for each reach");
            let Surroundings { weight, middle, normal } = dispatch!(path, _simd => cells.about(&own, reach));
            // Edges take the normal of what is about them, if that is of one mind.
            if weight == 0.0 || own.is_edge && normal.length() < AGREED * weight {
                return own;
            }
            let normal = normal.normalize_or(own.normal);
            let own = Disc { is_edge: false, ..own };
            Disc { point: own.point + normal * (middle / weight).dot(normal), normal, ..own }
        });
        discs.copy_from_slice(&moved);
    }
}
