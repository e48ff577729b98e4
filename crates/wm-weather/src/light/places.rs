//! The surfaces whose light is split, and what is near each.

use crate::fused_surfaces::FusedSurfaces;
use crate::point_grid::{PlaceMap, median_spacing};
use glam::{IVec3, Vec3};
use wm_base::color::srgb_decode;
use wm_scene::splats::shortest_axis;
use wm_scene::{Group, Splats, quat};

/// Largest thickness of a flat splat, as a share of either width.
const MAX_THICKNESS_RATIO: f64 = 0.4;

/// Small surfaces with their normals and colours.
pub(super) struct Surfaces {
    /// World axes, scene units.
    pub(crate) points: Vec<Vec3>,
    /// Length 1; zero of what is no surface, such as leaves.
    pub(crate) normals: Vec<Vec3>,
    /// The first so many normals look to where the surfaces were seen from; of the others either
    /// side may be outside.
    pub(crate) oriented: usize,
    /// Linear RGB, as captured.
    pub(crate) light: Vec<Vec3>,
}

impl Surfaces {
    /// Takes the surfaces that the cameras of a place see; without photos its splats, flat ones
    /// with their normals.
    pub(crate) fn new(found: &FusedSurfaces<'_>) -> Self {
        let splats: &Splats = &found.splats;
        let known = if found.oriented > 0 { found.oriented } else { splats.len() };
        let drawn = (0..known).filter(|i| splats.groups[*i] != Group::Sky);
        let (mut points, mut normals, mut light) = (Vec::new(), Vec::new(), Vec::new());
        for index in drawn {
            points.push(Vec3::from_array(splats.means[index]));
            let scales = splats.scales(index);
            let thin = shortest_axis(splats.log_scales[index]);
            let (axis, is_flat) = if index < found.oriented {
                (2, true)
            } else {
                (thin, (0..3).all(|k| k == thin || scales[thin] < MAX_THICKNESS_RATIO * scales[k]))
            };
            let turn = quat::to_matrix(splats.quats[index].map(f64::from));
            let normal = Vec3::from_array([0, 1, 2].map(|k| turn[k][axis] as f32));
            normals.push(if is_flat { normal } else { Vec3::ZERO });
            light.push(light_of(splats, index));
        }
        Self { points, normals, oriented: found.oriented, light }
    }

    /// The first of those in each cube of this width (scene units) whose normals look the same way.
    pub(crate) fn thinned(&self, width: f32) -> Self {
        let mut taken: PlaceMap<(IVec3, u32), ()> = PlaceMap::default();
        let cube = |point: Vec3| (point / width).floor().as_ivec3();
        let kept: Vec<usize> = (0..self.len())
            .filter(|i| taken.insert((cube(self.points[*i]), octant(self.normals[*i])), ()).is_none())
            .collect();
        let of = |all: &[Vec3]| kept.iter().map(|i| all[*i]).collect();
        Self {
            points: of(&self.points),
            normals: of(&self.normals),
            oriented: kept.partition_point(|i| *i < self.oriented),
            light: of(&self.light),
        }
    }

    /// The longest side of the box about all of them, scene units.
    pub(crate) fn extent(&self) -> f32 {
        let low = self.points.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = self.points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        (high - low).max_element()
    }

    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// Median distance from a surface to the nearest other, as far as `most`, scene units: what is
    /// finer is not known.
    pub(crate) fn spacing(&self, most: f32) -> f32 {
        median_spacing(&self.points, most)
    }
}

/// The signs of a direction, of which opposite ones differ; 8 for none.
fn octant(direction: Vec3) -> u32 {
    if direction == Vec3::ZERO { 8 } else { direction.is_negative_bitmask() }
}

/// The captured light of a splat as all directions see it, linear RGB.
pub(super) fn light_of(splats: &Splats, index: usize) -> Vec3 {
    Vec3::from_array(splats.base_color(index).map(|v| srgb_decode(v.max(0.0)) as f32))
}
