//! Solid volume behind the surfaces that cameras see.
//!
//! A wall seen at a slant is found in strips, since each camera places it by some decimetres
//! elsewhere. Sunlight would fall through between them. But behind a wall is a house: what lies
//! close behind a surface, and no camera sees through, is solid.

use super::cubes::Disc;
use crate::point_grid::PlaceMap;
use crate::surfel::surfel;
use crate::threads::map;
use glam::{DVec3, IVec3};
use wm_scene::splats::Splat;
use wm_scene::{Group, Splats};

/// Distance behind a surface, m.
const BACKING_DEPTH_M: f64 = 0.4;
/// Standard deviation along the surface and distance to which it must be hidden around: the wide
/// one is tried first.
const BACKING_SIZES_M: [[f64; 2]; 2] = [[0.35, 0.5], [0.15, 0.2]];
/// Standard deviation through the backing.
const BACKING_SIGMA_M: f64 = 0.1;
/// Width of the cubes of which each has one for each way that its surfaces look.
const CUBE_WIDTH_M: f64 = 0.2;
/// Least cosine between up and what is ground, which has nothing behind it that stands in the way
/// of light.
const MIN_GROUND_COSINE: f64 = 0.7;
const BACKING_OPACITY: f64 = 0.95;

/// The splats behind discs where no camera sees through, as `is_hidden` says of a point (world,
/// scene units).
pub(super) fn behind(
    discs: &[Disc],
    is_hidden: &(dyn Fn(DVec3) -> bool + Sync),
    up: DVec3,
    metres_per_unit: f64,
) -> Splats {
    let unit = 1.0 / metres_per_unit;
    let mut taken: PlaceMap<(IVec3, u32), ()> = PlaceMap::default();
    let cube = |disc: &Disc| (disc.point / (CUBE_WIDTH_M * unit)).floor().as_ivec3();
    let asked: Vec<&Disc> = discs
        .iter()
        .filter(|disc| !disc.is_edge && disc.normal.dot(up) < MIN_GROUND_COSINE)
        .filter(|disc| taken.insert((cube(disc), disc.normal.is_negative_bitmask()), ()).is_none())
        .collect();
    let sizes = map(asked.len(), |k| {
        let disc = asked[k];
        let middle = disc.point - BACKING_DEPTH_M * unit * disc.normal;
        let across = disc.normal.any_orthonormal_vector();
        let sides = [across, -across, disc.normal.cross(across), across.cross(disc.normal)];
        let is_solid = |reach: f64| sides.iter().all(|side| is_hidden(middle + reach * unit * *side));
        let size =
            BACKING_SIZES_M.iter().find(|[_, reach]| is_solid(*reach)).filter(|_| is_hidden(middle))?;
        Some((middle, size[0] * unit))
    });
    let mut out = Splats::with_capacity(asked.len(), 0);
    for (disc, found) in asked.iter().zip(sizes) {
        if let Some((middle, wide)) = found {
            let scales = [wide, wide, BACKING_SIGMA_M * unit];
            out.push(&Splat {
                group: Group::Scene,
                ..surfel(middle.to_array(), disc.normal, up, scales, disc.rgb, BACKING_OPACITY)
            });
        }
    }
    out
}
