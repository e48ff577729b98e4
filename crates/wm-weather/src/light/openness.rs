//! The share of the sky that each surface sees.

use super::irradiance::SurfaceLight;
use super::places::Surfaces;
use super::sun_search::lifted;
use crate::dome::{from_level, level_axes};
use crate::optics::Site;
use crate::shelter::{Occluders, Shelter};
use crate::threads::map;
use glam::Vec3;
use std::f64::consts::TAU;

/// Directions over the upper half, each with an equal part of it.
const DIRECTIONS: usize = 32;
/// Width of the maps' cells, in those of the occluders.
const COARSE: f64 = 2.0;

/// The shares of [`SurfaceLight::open`] of each surface. What is no surface looks to all sides. Normals whose outside is not
/// known are turned to the side that sees more of the sky.
pub(super) fn find(
    surfaces: &mut Surfaces,
    occluders: &Occluders,
    site: &Site,
    threads: usize,
) -> Vec<[f32; 2]> {
    let axes = level_axes(site.up);
    let coarse = occluders.sketched(COARSE);
    let golden = TAU * 0.618_033_988_75;
    let looks = map(DIRECTIONS, threads, |i| {
        let z = (i as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let level = (1.0 - z * z).sqrt();
        let towards = from_level(&axes, [level * cos, level * sin, z]);
        let map = coarse.shelter(towards.map(|v| -v), Some(1));
        (Vec3::from_array(towards.map(|v| v as f32)), z as f32, map)
    });
    let found = map(surfaces.len(), threads, |i| {
        let (point, normal) = (surfaces.points[i], surfaces.normals[i]);
        let own = shares(&looks, point, normal, site);
        if i < surfaces.oriented || normal == Vec3::ZERO {
            return (normal, own.0);
        }
        let other = shares(&looks, point, -normal, site);
        if other.1 > own.1 { (-normal, other.0) } else { (normal, own.0) }
    });
    let (normals, open) = found.into_iter().unzip();
    surfaces.normals = normals;
    open
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
