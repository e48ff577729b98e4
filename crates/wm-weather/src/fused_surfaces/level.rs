//! Levels discs onto the surface through those about them.

use super::cubes::Disc;
use crate::point_grid::{PlaceMap, cubes_about};
use crate::threads::map;
use fearless_simd::{Select, Simd, SimdBase, f32x8};
use glam::{DVec3, IVec3};
use std::ops::Range;
use wm_render::dispatch;
use wm_render::simd::SimdPath;

/// Distance of the discs that a surface is fitted to, m, but so many of its own widths at least.
const FIELD_RADIUS_M: f64 = 0.3;
const FIELD_RADIUS_WIDTHS: f64 = 4.0;
/// Least cosine between the normals of discs of one surface.
const MIN_NORMAL_COSINE: f64 = 0.6;
/// Length of the mean normal from which it is that of edges too.
const MIN_MEAN_NORMAL_LENGTH: f64 = 0.8;
const ROUND_COUNT: usize = 3;

/// Discs that are taken at once.
const LANES: usize = 8;
/// One array each for [`LANES`] discs: x, y and z from an origin, the normal, and the weight, 0
/// behind the last disc.
type Block = [[f32; LANES]; 7];

/// The discs that reach as far, and what may be within that, by cells as wide.
struct Grid {
    reach: f64,
    own: Vec<(IVec3, Vec<u32>)>,
    /// Discs that are no edges: those of a cell are in whole blocks.
    blocks: Vec<Block>,
    places: PlaceMap<IVec3, Range<usize>>,
}

/// The mean of the discs about one.
struct Surroundings {
    weight: f64,
    /// Mean place from the one, times the weight, scene units.
    middle: DVec3,
    /// Mean normal, times the weight.
    normal: DVec3,
}

/// Indices of discs that pass a test, by cells of a width.
fn by_cells(discs: &[Disc], width: f64, is_in: impl Fn(&Disc) -> bool) -> PlaceMap<IVec3, Vec<u32>> {
    let mut cells = PlaceMap::<IVec3, Vec<u32>>::default();
    for (index, disc) in (0u32..).zip(discs).filter(|(_, disc)| is_in(disc)) {
        cells.entry((disc.point / width).floor().as_ivec3()).or_default().push(index);
    }
    cells
}

impl Grid {
    /// Builds blocks with places relative to an origin, from which single precision is enough.
    fn of(discs: &[Disc], origin: DVec3, reach: f64, reach_of: impl Fn(&Disc) -> f64) -> Self {
        let own = by_cells(discs, reach, |disc| reach_of(disc) == reach).into_iter().collect();
        let (mut blocks, mut places) = (Vec::<Block>::new(), PlaceMap::default());
        for (cell, known) in by_cells(discs, reach, |disc| !disc.is_edge) {
            let first = blocks.len();
            for part in known.chunks(LANES) {
                let mut block = [[0.0; LANES]; 7];
                for (lane, index) in part.iter().enumerate() {
                    let disc = &discs[*index as usize];
                    let [x, y, z] = (disc.point - origin).to_array();
                    let [nx, ny, nz] = disc.normal.to_array();
                    for (lanes, value) in block.iter_mut().zip([x, y, z, nx, ny, nz, disc.weight]) {
                        lanes[lane] = value as f32;
                    }
                }
                blocks.push(block);
            }
            places.insert(cell, first..blocks.len());
        }
        Self { reach, own, blocks, places }
    }

    /// Returns the discs of its own in a cell after a round.
    fn levelled(&self, cell: IVec3, own: &[u32], discs: &[Disc], origin: DVec3) -> Vec<Disc> {
        let path = SimdPath::widest();
        let about = cubes_about(cell, 1).filter_map(|cube| self.places.get(&cube));
        let about: Vec<&[Block]> = about.map(|range| &self.blocks[range.clone()]).collect();
        let level = |index: &u32| {
            let own = discs[*index as usize];
            let Surroundings { weight, middle, normal } =
                dispatch!(path, simd => surroundings(simd, &own, own.point - origin, self.reach, &about));
            // Edges take the normal of what is about them, if that is consistent.
            if weight == 0.0 || own.is_edge && normal.length() < MIN_MEAN_NORMAL_LENGTH * weight {
                return own;
            }
            let normal = normal.normalize_or(own.normal);
            let own = Disc { is_edge: false, ..own };
            Disc { point: own.point + normal * (middle / weight).dot(normal), normal, ..own }
        };
        own.iter().map(level).collect()
    }
}

/// Returns the mean of the discs within `reach` of one at `place`, nearer ones counting more; of
/// those that face as it does if it has a normal.
#[inline(always)]
fn surroundings<S: Simd>(simd: S, own: &Disc, place: DVec3, reach: f64, about: &[&[Block]]) -> Surroundings {
    let [x, y, z] = place.to_array().map(|v| v as f32);
    let [nx, ny, nz] = own.normal.to_array().map(|v| v as f32);
    let least = if own.is_edge { f32::NEG_INFINITY } else { MIN_NORMAL_COSINE as f32 };
    let narrow = (1.0 / (reach * reach)) as f32;
    let zero = f32x8::splat(simd, 0.0);
    let mut sums = [zero; 7];
    for blocks in about {
        // No closures in here: they would be compiled without the path's instructions.
        for [px, py, pz, ox, oy, oz, weight] in *blocks {
            let dx = f32x8::from_slice(simd, px) - x;
            let dy = f32x8::from_slice(simd, py) - y;
            let dz = f32x8::from_slice(simd, pz) - z;
            let ox = f32x8::from_slice(simd, ox);
            let oy = f32x8::from_slice(simd, oy);
            let oz = f32x8::from_slice(simd, oz);
            let near = ((dx * dx + dy * dy + dz * dz) * -narrow + 1.0).max(zero);
            let is_alike = (ox * nx + oy * ny + oz * nz).simd_ge(f32x8::splat(simd, least));
            let share = is_alike.select(near * near * f32x8::from_slice(simd, weight), zero);
            sums[0] += share;
            sums[1] += share * dx;
            sums[2] += share * dy;
            sums[3] += share * dz;
            sums[4] += share * ox;
            sums[5] += share * oy;
            sums[6] += share * oz;
        }
    }
    let [weight, x, y, z, nx, ny, nz] = sums.map(|lanes| f64::from(lanes.as_slice().iter().sum::<f32>()));
    Surroundings { weight, middle: DVec3::new(x, y, z), normal: DVec3::new(nx, ny, nz) }
}

/// Moves each disc along the mean normal of those about it onto the plane through their middle, and
/// turns it so.
pub(super) fn level(discs: &mut [Disc], metres_per_unit: f64) {
    let reach_of = |disc: &Disc| (FIELD_RADIUS_M / metres_per_unit).max(FIELD_RADIUS_WIDTHS * disc.size);
    let mut reaches: Vec<f64> = discs.iter().map(reach_of).collect();
    reaches.sort_unstable_by(f64::total_cmp);
    reaches.dedup();
    let origin = discs.first().map_or(DVec3::ZERO, |disc| disc.point);
    for _ in 0..ROUND_COUNT {
        let grids = map(reaches.len(), |k| Grid::of(discs, origin, reaches[k], reach_of));
        let cells: Vec<(&Grid, &(IVec3, Vec<u32>))> =
            grids.iter().flat_map(|grid| grid.own.iter().map(move |cell| (grid, cell))).collect();
        let levelled = map(cells.len(), |k| {
            let (grid, (cell, own)) = cells[k];
            grid.levelled(*cell, own, discs, origin)
        });
        for ((_, (_, own)), levelled) in cells.iter().zip(levelled) {
            own.iter().zip(levelled).for_each(|(index, disc)| discs[*index as usize] = disc);
        }
    }
}
