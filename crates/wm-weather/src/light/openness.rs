//! The share of the sky that each surface sees.

use super::irradiance::SurfaceLight;
use super::places::Surfaces;
use super::sun_search::lifted;
use crate::level::{from_level, level_axes};
use crate::optics::Site;
use crate::point_grid::{PlaceMap, cubes_about};
use crate::shelter::{Occluders, Shelter};
use crate::threads::map;
use glam::{IVec3, Vec3};
use std::f64::consts::TAU;

/// Directions over the upper half, each with an equal part of it.
const DIRECTION_COUNT: usize = 32;
/// Width of the blocks by which it is smoothed, m, the reach of their means in blocks, and the
/// share of values that are no better than the one that counts.
const BLOCK_WIDTH_M: f64 = 0.5;
const MEAN_REACH_BLOCKS: f32 = 1.5;
const BETTER_SHARE: f32 = 0.7;
/// Width of the maps' cells, in those of the occluders.
const MAP_CELL_RATIO: f64 = 2.0;

/// The shares of [`SurfaceLight::open`] of each surface. What is no surface looks to all sides.
/// Normals whose outside is not known are turned to the side that sees more of the sky.
pub(super) fn find(surfaces: &mut Surfaces, occluders: &Occluders, site: &Site) -> Vec<[f32; 2]> {
    let axes = level_axes(site.up);
    let coarse = occluders.sketched(MAP_CELL_RATIO);
    let golden = TAU * 0.618_033_988_75;
    let looks = map(DIRECTION_COUNT, |i| {
        let z = (i as f64 + 0.5) / DIRECTION_COUNT as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let level = (1.0 - z * z).sqrt();
        let towards = from_level(&axes, [level * cos, level * sin, z]);
        let map = coarse.shelter(towards.map(|v| -v));
        (Vec3::from_array(towards.map(|v| v as f32)), z as f32, map)
    });
    let found = map(surfaces.len(), |i| {
        let (point, normal) = (surfaces.points[i], surfaces.normals[i]);
        let own = shares(&looks, point, normal, site);
        if i < surfaces.oriented || normal == Vec3::ZERO {
            return (normal, own.0);
        }
        let other = shares(&looks, point, -normal, site);
        if other.1 > own.1 { (-normal, other.0) } else { (normal, own.0) }
    });
    let (normals, open): (Vec<Vec3>, Vec<[f32; 2]>) = found.into_iter().unzip();
    surfaces.normals = normals;
    smoothed(surfaces, &open, site)
}

/// The surfaces of one cube that look the same way.
struct Block {
    /// Mean of the points.
    middle: Vec3,
    open: [f32; 2],
}

/// Removes the faults of rough captures: where sheets of one surface lie above each other, the
/// lower ones see no sky. In each block the better values count, and surfaces take the mean of the
/// blocks around them.
fn smoothed(surfaces: &Surfaces, open: &[[f32; 2]], site: &Site) -> Vec<[f32; 2]> {
    let width = (BLOCK_WIDTH_M / site.metres_per_unit) as f32;
    let reach = MEAN_REACH_BLOCKS * width;
    let cube = |point: Vec3| (point / width).floor().as_ivec3();
    let key = |i: usize| (cube(surfaces.points[i]), side(surfaces.normals[i]));
    let mut order: Vec<usize> = (0..surfaces.len()).collect();
    order.sort_unstable_by_key(|i| {
        let (IVec3 { x, y, z }, side) = key(*i);
        (x, y, z, side, *i)
    });
    let mut blocks: PlaceMap<(IVec3, u32), Block> = PlaceMap::default();
    for run in order.chunk_by(|a, b| key(*a) == key(*b)) {
        let middle = run.iter().map(|i| surfaces.points[*i]).sum::<Vec3>() / run.len() as f32;
        let better = |k: usize| {
            let mut values: Vec<f32> = run.iter().map(|i| open[*i][k]).collect();
            let at = (BETTER_SHARE * (values.len() - 1) as f32).round() as usize;
            *values.select_nth_unstable_by(at, f32::total_cmp).1
        };
        blocks.insert(key(run[0]), Block { middle, open: [better(0), better(1)] });
    }
    map(surfaces.len(), |i| {
        let (point, (middle, side)) = (surfaces.points[i], key(i));
        let (mut sums, mut weights) = ([0.0f32; 2], 0.0f32);
        for block in cubes_about(middle, 1).filter_map(|cube| blocks.get(&(cube, side))) {
            let weight = (1.0 - block.middle.distance_squared(point) / (reach * reach)).max(0.0).powi(2);
            (0..2).for_each(|k| sums[k] += weight * block.open[k]);
            weights += weight;
        }
        if weights > 0.0 { sums.map(|sum| sum / weights) } else { open[i] }
    })
}

/// The axis that a direction is nearest to, with its sign: 0 to 5; 6 for none.
fn side(direction: Vec3) -> u32 {
    if direction == Vec3::ZERO {
        return 6;
    }
    let axis = direction.abs().max_position();
    2 * axis as u32 + u32::from(direction[axis] < 0.0)
}

/// The shares, and the sum of what is seen.
fn shares(looks: &[(Vec3, f32, Shelter)], point: Vec3, normal: Vec3, site: &Site) -> ([f32; 2], f32) {
    let (mut seen, mut all) = ([0.0f32; 2], [0.0f32; 2]);
    for (towards, z, map) in looks {
        let weight = if normal == Vec3::ZERO { 1.0 } else { normal.dot(*towards).max(0.0) };
        if weight == 0.0 {
            continue;
        }
        let is_open = map.is_exposed(lifted(point, normal, *towards, map, site));
        for (k, weight) in [weight, weight * z].into_iter().enumerate() {
            all[k] += weight;
            seen[k] += if is_open { weight } else { 0.0 };
        }
    }
    // A surface that looks down sees no sky, whatever its share.
    ([0, 1].map(|k| if all[k] > 0.0 { seen[k] / all[k] } else { 0.0 }), seen[0])
}

/// The geometry of a surface without a sun.
pub(super) fn under_sky(normal: Vec3, open: [f32; 2], up: Vec3) -> SurfaceLight {
    // Leaves get the light of an upright plane: as much from above as from below.
    let upright = if normal == Vec3::ZERO { 0.0 } else { f64::from(normal.dot(up)) };
    SurfaceLight { upright, open: open.map(f64::from), incidence: 0.0, sun: 0.0 }
}
