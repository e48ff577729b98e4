//! The surfaces that get wet: one per splat, with its reflectance, the rain that reaches it, and
//! the puddle that it may lie under.

use super::basins::NO_BASIN;
use super::column::MAX_RAIN_SHARE;
use super::ground_map::{GroundMap, ON_GROUND};
use super::optics::ALBEDO_STEP_COUNT;
use super::request::SlantedRain;
use super::sheen::{NO_SKY, skyline_of};
use crate::cover::ground::FarFloor;
use crate::fused_surfaces::FusedSurfaces;
use crate::light::{CaptureLight, GREEN_EXCESS_RATIO};
use crate::open_water::OpenWater;
use crate::optics::Site;
use crate::shelter::Shelter;
use crate::threads::map;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use wm_base::color::srgb_decode;
use wm_scene::Splats;
use wm_scene::sh;

const ALBEDO_LIMITS: [f64; 2] = [0.02, 0.9];
/// Cosine between up and the normal from which ground is nearly level.
const MIN_LEVEL_COSINE: f32 = 0.85;
/// Share of the rain that leaves get, which turn to all sides.
const LEAF_RAIN_SHARE: f32 = 0.6;
/// Height above ground and distance from walls at which shelter is requested, m: captured surfaces
/// are rough.
const SHELTER_HEIGHT_M: f32 = 0.25;
const SHELTER_WALL_DISTANCE_M: f32 = 0.4;
/// Radius about a point over which shelter is averaged: on the ground and on walls.
const SHELTER_RADII_M: [f32; 2] = [0.4, 0.2];
/// Height above and below the bottom of a puddle within which a splat belongs to it, m.
const IN_PUDDLE: [f32; 2] = [0.05, 0.3];
/// Standard deviation of splats that are too wide for the edge of a puddle, m.
const MAX_EDGE_SIGMA_M: f64 = 0.3;
/// Steps of the share of the rain, and the classes: of level, steep and leafy surfaces, and of
/// those that stay dry.
pub(super) const RAIN_SHARE_BIN_COUNT: usize = 64;
pub(super) const DRY_CLASS: u8 = 3 * RAIN_SHARE_BIN_COUNT as u8;
/// Steps of the share of the ground that is lower than a splat.
pub(super) const LOWER_SHARE_COUNT: usize = 16;

/// The surfaces of a scene, and its ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WetSurfaces {
    pub(super) splats: Vec<WetSplat>,
    /// The puddles that splats may lie under.
    pub(super) ponds: Vec<Pond>,
    /// Normals look to the outside; else to either side.
    is_oriented: bool,
    ground: GroundMap,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct WetSplat {
    pub(super) point: [f32; 3],
    /// Normal times 127; zero of leaves.
    pub(super) normal: [i8; 3],
    pub(super) albedo: [u8; 3],
    /// The colour that does not depend on the direction, display-referred.
    pub(super) color: [u8; 3],
    /// Elevation up to which something hides the sky, by [`skyline_of`]; [`NO_SKY`] of what is not
    /// steep.
    pub(super) skyline: u8,
    /// Share of the ground that is lower, in [`LOWER_SHARE_COUNT`] steps: hollows get wet first.
    pub(super) lower: u8,
    /// Sky, and open water.
    pub(super) stays: bool,
    pub(super) pond: u32,
}

/// A place in a basin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Pond {
    pub(super) basin: u32,
    /// Height of the ground, m.
    pub(super) height: f32,
}

impl WetSurfaces {
    /// Returns true if its parts fit each other and a scene of `splats` splats, as an asset that a
    /// stranger made may not.
    #[must_use]
    pub fn is_consistent(&self, splats: usize) -> bool {
        let is_pond =
            |pond: &Pond| (pond.basin as usize) < self.ground.basins.all.len() && pond.height.is_finite();
        let is_splat = |splat: &WetSplat| {
            usize::from(splat.lower) < LOWER_SHARE_COUNT
                && (splat.pond == NO_BASIN || (splat.pond as usize) < self.ponds.len())
        };
        self.splats.len() == splats
            && self.splats.iter().all(is_splat)
            && self.ponds.iter().all(is_pond)
            && self.ground.is_consistent(splats)
    }

    /// Finds the surfaces of a scene, by its fused surfaces and its captured light, and the ground
    /// about a path (world, scene units) without its open water.
    #[must_use]
    #[allow(
        clippy::too_many_arguments,
        reason = "the scene, its water, the path and the site are independent"
    )]
    pub fn of(
        splats: &Splats,
        found: &FusedSurfaces<'_>,
        capture: &CaptureLight,
        water: &OpenWater,
        path: [[f64; 3]; 2],
        is_up_known: bool,
        site: &Site,
    ) -> Self {
        let mut ground = GroundMap::new(found, water, path, is_up_known, site);
        let points = found.places(splats);
        let mean = capture.mean(&capture.light);
        let reflectance = |index: usize| -> [f64; 3] {
            let stride = splats.sh_stride();
            let sh = &splats.sh[index * stride..];
            let irradiance = capture.surface(index, site.up).irradiance(&capture.light, mean);
            std::array::from_fn(|k| {
                let light = srgb_decode((0.5 + sh::C0 * f64::from(sh[k])).clamp(0.0, 1.0));
                light / (capture.white(irradiance[k])).max(1e-3)
            })
        };
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let floor = FarFloor::new(found, site);
        let wide = (MAX_EDGE_SIGMA_M / site.metres_per_unit).ln() as f32;
        let with_ponds = map(splats.len(), |index| {
            let point = points[index];
            // Pools are as wet as they can be.
            let stays = capture.is_sky(index) || water.covers(point.map(f64::from));
            let albedo = if stays { [0.0; 3] } else { reflectance(index) };
            let albedo = albedo.map(|v| v.clamp(ALBEDO_LIMITS[0], ALBEDO_LIMITS[1]));
            let normal = capture.normal(index);
            let is_level = normal.dot(up).abs() > MIN_LEVEL_COSINE;
            let is_green = albedo[1] > GREEN_EXCESS_RATIO * albedo[0].max(albedo[2]);
            // Lawns turn to all sides, however flat they were captured.
            let normal = if is_green && is_level { Vec3::ZERO } else { normal };
            // Whatever way it lies, what shows through the ground is a part of it.
            let normal = if ground.depth_below(point) > ON_GROUND { up } else { normal };
            // Ground in the round of the water's surface has its own reflection.
            let is_wall = normal != Vec3::ZERO
                && normal.dot(up).abs() < MIN_LEVEL_COSINE
                && !floor.holds(point.map(f64::from));
            let stride = splats.sh_stride();
            let sh = &splats.sh[index * stride..];
            let splat = WetSplat {
                color: std::array::from_fn(|k| {
                    (255.0 * (0.5 + sh::C0 * f64::from(sh[k])).clamp(0.0, 1.0)).round() as u8
                }),
                skyline: match is_wall {
                    true => skyline_of(capture.surface(index, site.up).open[0]),
                    false => NO_SKY,
                },
                point,
                normal: (127.0 * normal).to_array().map(|v| v.round() as i8),
                albedo: albedo.map(|v| (v * (ALBEDO_STEP_COUNT - 1) as f64).round() as u8),
                lower: (ground.lower_share(point.map(f64::from)) * (LOWER_SHARE_COUNT - 1) as f32).round()
                    as u8,
                stays,
                pond: NO_BASIN,
            };
            let (place, height) = ground.locate(point.map(f64::from));
            let faces_up = normal == Vec3::ZERO || normal.dot(up).abs() > MIN_LEVEL_COSINE;
            let is_wide = splats.log_scales[index].into_iter().any(|scale| scale > wide);
            let pond = ground.basin_at(place).filter(|(_, bottom)| {
                let above = height as f32 - bottom;
                !stays && !is_wide && faces_up && (-IN_PUDDLE[1]..IN_PUDDLE[0]).contains(&above)
            });
            (splat, pond)
        });
        let mut ponds = Vec::new();
        let with_ponds = with_ponds.into_iter().map(|(splat, pond)| match pond {
            Some((basin, height)) => {
                ponds.push(Pond { basin, height });
                WetSplat { pond: ponds.len() as u32 - 1, ..splat }
            }
            None => splat,
        });
        let made: Vec<WetSplat> = with_ponds.collect();
        let shown = made.iter().enumerate().filter(|(_, splat)| !splat.stays).map(|(index, splat)| {
            let [a, b, c] = splats.scales(index).map(|scale| scale as f32);
            let area = (a * b).max(a * c).max(b * c);
            (splat.point, splats.opacity(index) as f32 * area, splat.albedo.map(f32::from))
        });
        ground.find_matte(shown);
        Self { splats: made, ponds, is_oriented: found.oriented > 0, ground }
    }

    /// The ground.
    #[must_use]
    pub fn ground(&self) -> &GroundMap {
        &self.ground
    }

    /// The number of splats.
    pub(crate) fn len(&self) -> usize {
        self.splats.len()
    }

    /// The share of the rain that a splat gets, and its class.
    fn class(&self, splat: &WetSplat, rain: &SlantedRain, shelter: Option<&Shelter>, site: &Site) -> u8 {
        if splat.stays {
            return DRY_CLASS;
        }
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let driving = Vec3::from_array(rain.driving.map(|v| v as f32));
        let mut normal = Vec3::from_array(splat.normal.map(|v| f32::from(v) / 127.0));
        if !self.is_oriented && normal.dot(up) < 0.3 {
            // Either side may be outside: that which rain falls on.
            let is_under = normal.dot(up) < -0.3 || normal.dot(driving) > 0.0;
            normal = if is_under { -normal } else { normal };
        }
        let upright = normal.dot(up);
        let is_leaf = normal == Vec3::ZERO;
        let metres = site.metres_per_unit as f32;
        let level = if is_leaf { 1.0 } else { upright.clamp(0.0, 1.0) };
        let above = SHELTER_HEIGHT_M * level + self.ground.depth_below(splat.point);
        let off = up * above + normal * (SHELTER_WALL_DISTANCE_M * (1.0 - level));
        let at = Vec3::from_array(splat.point) + off / metres;
        let radius = SHELTER_RADII_M[1] + (SHELTER_RADII_M[0] - SHELTER_RADII_M[1]) * level;
        let open = shelter.map_or(1.0, |shelter| shelter.exposure(at.to_array(), radius));
        let falls =
            if is_leaf { LEAF_RAIN_SHARE } else { upright.max(0.0) + (-normal.dot(driving)).max(0.0) };
        let share = (open * falls / MAX_RAIN_SHARE as f32).clamp(0.0, 1.0).sqrt();
        let kind = if is_leaf { 2 } else { usize::from(upright < MIN_LEVEL_COSINE) };
        (kind * RAIN_SHARE_BIN_COUNT) as u8 + (share * (RAIN_SHARE_BIN_COUNT - 1) as f32).round() as u8
    }
}

/// The few bytes of a splat that every frame reads, in any order. Splats in puddles and steep ones
/// need their [`WetSplat`] too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WetLook {
    pub(super) class: u8,
    /// Share of the ground that is lower, in [`LOWER_SHARE_COUNT`] steps.
    pub(super) lower: u8,
    pub(super) albedo: [u8; 3],
    /// [`IN_POND`] and [`MIRRORS`].
    pub(super) flags: u8,
}

/// Flags of [`WetLook`]: the splat may lie under a puddle, and may mirror the sky.
pub(super) const IN_POND: u8 = 1;
pub(super) const MIRRORS: u8 = 2;

/// The shares of a slanted rain that reach surfaces and ground.
#[derive(Clone, Debug, PartialEq)]
pub struct WetShares {
    /// The rain.
    pub rain: SlantedRain,
    /// One for each splat.
    pub(super) looks: Vec<WetLook>,
    /// The share of each cell of the ground or of open water, 0-1; 0 where there is neither.
    pub(crate) ground: Vec<f32>,
}

impl WetShares {
    /// The shares under a shelter map of the rain's direction; `None` to ignore what stands above.
    #[must_use]
    pub fn of(surfaces: &WetSurfaces, rain: &SlantedRain, shelter: Option<&Shelter>, site: &Site) -> Self {
        let looks = map(surfaces.len(), |index| {
            let splat = &surfaces.splats[index];
            let class = surfaces.class(splat, rain, shelter, site);
            let is_steep = (RAIN_SHARE_BIN_COUNT as u8..2 * RAIN_SHARE_BIN_COUNT as u8).contains(&class);
            let mirrors = if is_steep && splat.skyline != NO_SKY { MIRRORS } else { 0 };
            let in_pond = if splat.pond != NO_BASIN { IN_POND } else { 0 };
            WetLook { class, lower: splat.lower, albedo: splat.albedo, flags: mirrors | in_pond }
        });
        let map_of_ground = &surfaces.ground;
        let ground = map(map_of_ground.ground.len(), |at| {
            let height = map_of_ground.surface(at, map_of_ground.ground[at]);
            if height.is_nan() {
                return 0.0;
            }
            let point = map_of_ground
                .point(map_of_ground.places.middle(at), f64::from(height + SHELTER_HEIGHT_M))
                .map(|v| v as f32);
            shelter.map_or(1.0, |shelter| shelter.exposure(point, SHELTER_RADII_M[1]))
        });
        Self { rain: *rain, looks, ground }
    }
}
