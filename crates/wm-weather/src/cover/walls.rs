//! Wet snow that the wind throws against walls and trunks, and that sticks there.
//!
//! A surface that faces the wind meets as much more of the fall than level ground as the fall is
//! slanted. Some of it sticks, up to a thickness at which it falls off by its weight. It is drawn
//! on the splats of the scene that stand up, and is no part of what lies: what meets walls would
//! have fallen in their lee.

use super::airflow::Airflow;
use super::surfels::{CoverMaterial, SNOW_OPACITY, coverage, lit};
use crate::level::{from_level, level_axes};
use crate::optics::Site;
use crate::particles::random::RandomSequence;
use crate::shelter::Occluders;
use crate::surfel::surfel;
use crate::threads::map;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use wm_scene::{Group, Splats};

/// Least slant of the fall that reaches walls.
const MIN_SLANT: f64 = 0.15;
/// Largest cosine between up and the normal of what stands up.
const MAX_UPRIGHT_COSINE: f64 = 0.5;
/// Least cosine between its normal and the wind.
const MIN_FACING_COSINE: f64 = 0.2;
/// Least opacity, and the largest standard deviation, m, of a splat that shows a surface; how flat
/// it is at least.
const MIN_OPACITY: f64 = 0.4;
const MAX_SPLAT_SIGMA_M: f64 = 0.6;
const MAX_THICKNESS_RATIO: f64 = 0.6;
/// Distance in front of a surface at which its exposure is tested.
const TEST_DISTANCE_M: f64 = 0.15;
/// Share of what meets a wall that sticks, and the thickness at which it falls off, m.
const STICKING_SHARE: f64 = 0.3;
const MAX_THICKNESS_M: f64 = 0.03;
/// Least thickness that is drawn, m.
const MIN_THICKNESS_M: f64 = 0.000_5;
/// Brightness relative to level snow.
const WALL_BRIGHTNESS_RATIO: f64 = 0.75;

/// A splat of the scene that wet snow can stick to.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Wall {
    mean: [f32; 3],
    /// Towards the wind, length 1.
    normal: [f32; 3],
    /// Standard deviation along its surface and across it, m.
    wide: f32,
    thick: f32,
    /// The fall that meets it, as a share of that on level ground.
    share: f32,
}

impl Wall {
    /// Returns true if all of its numbers are finite.
    pub(super) fn is_finite(&self) -> bool {
        let Self { mean, normal, wide, thick, share } = self;
        mean.iter().chain(normal).chain([wide, thick, share]).all(|number| number.is_finite())
    }
}

/// Finds the walls of a scene.
pub(crate) fn find(splats: &Splats, occluders: &Occluders, site: &Site, airflow: &Airflow) -> Vec<Wall> {
    let [a, b] = airflow.slope;
    let slant = a.hypot(b);
    if slant < MIN_SLANT {
        return Vec::new();
    }
    let axes = level_axes(site.up);
    let fall = from_level(&axes, [a, b, -1.0]);
    let wind = DVec3::from_array(from_level(&axes, [a / slant, b / slant, 0.0]));
    let up = DVec3::from_array(site.up).normalize();
    let shelter = occluders.shelter(fall);
    let found = map(splats.len(), |index| {
        if splats.groups[index] == Group::Sky
            || !splats.is_sound(index)
            || splats.opacity(index) < MIN_OPACITY
        {
            return None;
        }
        let mut scales = splats.scales(index).map(|scale| scale * site.metres_per_unit);
        scales.sort_by(f64::total_cmp);
        let normal = DVec3::from_array(splats.normal(index));
        let normal = normal * -normal.dot(wind).signum();
        let faces = -normal.dot(wind);
        let is_wall = normal.dot(up).abs() < MAX_UPRIGHT_COSINE && faces > MIN_FACING_COSINE;
        if !is_wall || scales[2] > MAX_SPLAT_SIGMA_M || scales[0] > MAX_THICKNESS_RATIO * scales[1] {
            return None;
        }
        let mean = DVec3::from_array(splats.means[index].map(f64::from));
        let before = mean + normal * ((TEST_DISTANCE_M + 2.0 * scales[0]) / site.metres_per_unit);
        shelter.is_exposed(before.to_array().map(|v| v as f32)).then(|| Wall {
            mean: splats.means[index],
            normal: normal.to_array().map(|v| v as f32),
            wide: (scales[1] * scales[2]).sqrt() as f32,
            thick: scales[0] as f32,
            share: (slant * faces) as f32,
        })
    });
    found.into_iter().flatten().collect()
}

/// Adds the splats of what sticks to them when `stuck` m of wet snow fall on level ground.
pub(crate) fn add(
    walls: &[Wall],
    stuck: f64,
    up: DVec3,
    metres_per_unit: f64,
    material: &CoverMaterial,
    splats: &mut Splats,
) {
    for (index, wall) in walls.iter().enumerate() {
        // Gusts make it patchy.
        let patchy = 0.3 + 1.4 * RandomSequence::new(index as u64 ^ 0x3a11_0000_0000).uniform();
        let thick = (STICKING_SHARE * stuck * f64::from(wall.share) * patchy).min(MAX_THICKNESS_M);
        if thick < MIN_THICKNESS_M {
            continue;
        }
        let normal = DVec3::from_array(wall.normal.map(f64::from));
        let off = (1.5 * f64::from(wall.thick) + 0.5 * thick) / metres_per_unit;
        let at = DVec3::from_array(wall.mean.map(f64::from)) + normal * off;
        let scales = [wall.wide, wall.wide, wall.thick].map(|v| f64::from(v) / metres_per_unit);
        let opacity = SNOW_OPACITY * coverage(thick as f32) as f64;
        splats.push(&surfel(
            at.to_array(),
            normal,
            up,
            scales,
            lit(material, WALL_BRIGHTNESS_RATIO),
            opacity,
        ));
    }
}
