//! The ground under a walk, which is parallel to it.
//!
//! The ground at one's feet is in one or two photos and has few marks, so that a training may leave it at any depth: it
//! looks right in its photo from however far below. But where cameras were carried at one height the ground is that
//! far below them, and nothing is seen below it.

use super::Sight;
use glam::{DMat3, DVec3};

/// How far from the camera its floor is known, camera heights.
const REACH: f64 = 6.0;
/// How far about a camera the path tells its slope, and what the path wavers by, camera heights.
const ABOUT: f64 = 4.0;
const WAVERS: f64 = 0.5;
/// How far from a camera floors are looked at, in those.
const SEEN: f64 = 5.0;
/// What is seen less than this above the floor is of it, camera heights: kerbs and cobbles, and what depth is off by.
const SLAB: f64 = 0.15;

/// A plane below a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor {
    /// Straight below the camera, world, scene units.
    pub point: DVec3,
    /// Length 1.
    pub normal: DVec3,
    /// How far from `point` it is known, scene units.
    pub reach: f64,
}

impl Floor {
    /// Below a camera of a walk at `center`, by the places of all of its cameras (world, scene units), which were carried
    /// at a `height` over the ground.
    #[must_use]
    pub fn below(center: DVec3, cameras: &[DVec3], up: DVec3, height: f64) -> Self {
        let axes = [up.any_orthonormal_vector(), up.cross(up.any_orthonormal_vector())];
        let (mut moments, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for camera in cameras {
            let off = *camera - center;
            let at = DVec3::new(1.0, off.dot(axes[0]), off.dot(axes[1]));
            let far = at.y * at.y + at.z * at.z;
            let weight = (-0.5 * far / (ABOUT * height).powi(2)).exp();
            let weighted = weight * at;
            moments += DMat3::from_cols(weighted * at.x, weighted * at.y, weighted * at.z);
            // Level across the path: what its sides say of the slope is arms up and down.
            let wavers = weight * (WAVERS * height).powi(2);
            moments += DMat3::from_diagonal(DVec3::new(0.0, wavers, wavers));
            right += weighted * off.dot(up);
        }
        let plane = moments.inverse() * right;
        let normal = (up - plane.y * axes[0] - plane.z * axes[1]).normalize();
        Self { point: center + (plane.x - height) * up, normal, reach: REACH * height }
    }

    /// How far along a ray (of length 1) it is met, and the share of that over which the ray is in its slab; `None` if it is
    /// not met, or where it is not known.
    fn met(&self, from: DVec3, ray: DVec3) -> Option<(f64, f64)> {
        let (above, falls) = ((from - self.point).dot(self.normal), -ray.dot(self.normal));
        let way = above / falls;
        let is_met = above > 0.0 && falls > 0.0 && (from + way * ray).distance(self.point) < self.reach;
        is_met.then(|| (way, SLAB * self.reach / (REACH * above)))
    }
}

impl Sight {
    /// Brings what is seen below the floors of a walk onto them, along its ray, what is not there at all, and what is a
    /// little above.
    pub fn stop_at(&mut self, floors: &[Floor]) {
        let (center, forward) = (self.camera.center(), self.camera.forward());
        let is_near = |floor: &&Floor| {
            let off = floor.point - center;
            off.length() < SEEN * floor.reach && off.dot(forward) > -floor.reach
        };
        let near: Vec<Floor> = floors.iter().filter(is_near).copied().collect();
        for y in 0..self.camera.height {
            for x in 0..self.camera.width {
                let ray = self.camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let stops = near.iter().filter_map(|floor| floor.met(center, ray));
                let Some((way, slab)) = stops.min_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
                let (depth, stop) =
                    (&mut self.depth[(y * self.camera.width + x) as usize], way * ray.dot(forward));
                if *depth == 0.0 || f64::from(*depth) > stop * (1.0 - slab) {
                    *depth = stop as f32;
                }
            }
        }
    }
}
