//! The ground under a walk, which is parallel to it.
//!
//! The ground at one's feet is in one or two photos and has few marks, so that a training may leave
//! it at any depth: it looks right in its photo from however far below. But where cameras were
//! carried at one height the ground is that far below them, and nothing is seen below it. Where the
//! photos do not tell that height, but the scene has a ground over which all cameras are as high,
//! and most of what they see of it is not there, that is the floor.

use super::PhotoView;
use crate::threads::map;
use glam::{DVec2, DVec3};
use wm_scene::Camera;

/// Distance from the camera to which its floor is known, camera heights.
const REACH: f64 = 6.0;
/// How far about a camera the path tells its slope, camera heights, and the spreads of the cameras
/// along a direction at which they tell nothing of its slope, and all of it.
const ABOUT: f64 = 4.0;
const WAVERS: [f64; 2] = [0.75, 1.5];
/// Distance from a camera to which floors are examined, in those.
const EXAMINED_REACH: f64 = 5.0;
/// Distance to which that of the whole place is known, camera heights: a court.
const PLACE_REACH: f64 = 40.0;
/// Largest spread of the cameras' heights above it, as a share, and largest sine of the pitch of
/// most cameras: more is no walk but a flight.
const MAX_HEIGHT_SPREAD: f64 = 0.2;
const PITCHED: f64 = 0.26;
/// Share of the pixels that should show the floor but show what is below it, above which a training
/// has lost the floor.
const LOST_FLOOR_SHARE: f64 = 0.4;
/// Height above the floor, camera heights, below which points belong to it: kerbs, cobbles and
/// errors of depth.
const FLOOR_THICKNESS: f64 = 0.15;
/// Height above the floor, camera heights, below which points belong to the ground of a whole place
/// that a training has lost: what it left instead stands off it.
const LOST_FLOOR_THICKNESS: f64 = 0.25;

/// A plane below a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorPlane {
    /// Straight below the camera, world, scene units.
    pub(crate) point: DVec3,
    /// Length 1.
    pub(crate) normal: DVec3,
    /// Distance from `point` to which it is known, scene units.
    pub(crate) reach: f64,
    /// Half of how thick it is taken for, scene units.
    pub(crate) slab: f64,
}

impl FloorPlane {
    /// Below a camera of a walk at `center`, by the places of all of its cameras (world, scene
    /// units), which were carried at a `height` over the ground.
    #[must_use]
    pub fn below(center: DVec3, cameras: &[DVec3], up: DVec3, height: f64) -> Self {
        let axis = up.any_orthonormal_vector();
        let axes = [axis, up.cross(axis)];
        let weight = |offset: DVec2| (-0.5 * offset.length_squared() / (ABOUT * height).powi(2)).exp();
        let (mut all, mut sum) = (0.0, DVec3::ZERO);
        let offset = |camera: &DVec3| {
            let off = *camera - center;
            DVec3::new(off.dot(axes[0]), off.dot(axes[1]), off.dot(up))
        };
        for off in cameras.iter().map(offset) {
            let weight = weight(off.truncate());
            all += weight;
            sum += weight * off;
        }
        let mean = sum / all.max(f64::MIN_POSITIVE);
        // Squares of the offsets across up, and their products with the rise.
        let (mut xx, mut xy, mut yy, mut rises) = (0.0, 0.0, 0.0, DVec2::ZERO);
        for off in cameras.iter().map(offset) {
            let share = weight(off.truncate()) / all.max(f64::MIN_POSITIVE);
            let DVec3 { x, y, z } = off - mean;
            (xx, xy, yy) = (xx + share * x * x, xy + share * x * y, yy + share * y * y);
            rises += share * z * DVec2::new(x, y);
        }
        // Along the path and across it, each on its own: how far arms reach says nothing of a
        // slope.
        let along = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
        let slope = [along, along.perp()].iter().fold(DVec2::ZERO, |slope, way| {
            let spread = way.x * way.x * xx + 2.0 * way.x * way.y * xy + way.y * way.y * yy;
            let [low, high] = WAVERS.map(|wavers| (wavers * height).powi(2));
            let belief = ((spread - low) / (high - low)).clamp(0.0, 1.0);
            if belief > 0.0 { slope + *way * (belief * way.dot(rises) / spread) } else { slope }
        });
        let rise = mean.z - slope.dot(mean.truncate());
        let normal = (up - slope.x * axes[0] - slope.y * axes[1]).normalize();
        Self {
            point: center + (rise - height) * up,
            normal,
            reach: REACH * height,
            slab: FLOOR_THICKNESS * height,
        }
    }

    /// Builds the floor of a whole place from its photos' `cameras` and the height of its `ground`
    /// along `up` (scene units); `None` where those were not carried over it by a person.
    #[must_use]
    pub fn under(cameras: &[Camera], up: DVec3, ground: f64) -> Option<Self> {
        let middle = |values: &mut Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied()
        };
        let mut heights: Vec<f64> = cameras.iter().map(|camera| camera.center().dot(up) - ground).collect();
        let height = middle(&mut heights).filter(|height| *height > 0.0)?;
        let is_even = heights.iter().all(|other| (other - height).abs() < MAX_HEIGHT_SPREAD * height);
        let mut pitches: Vec<f64> = cameras.iter().map(|camera| camera.forward().dot(up)).collect();
        let is_level = middle(&mut pitches)?.abs() < PITCHED;
        let center = cameras.iter().map(Camera::center).sum::<DVec3>() / cameras.len() as f64;
        let point = center - (center.dot(up) - ground) * up;
        (is_even && is_level).then_some(Self {
            point,
            normal: up,
            reach: PLACE_REACH * height,
            slab: LOST_FLOOR_THICKNESS * height,
        })
    }

    /// Returns true if most of `views` that should show it see through it: a training has lost it.
    #[must_use]
    pub fn is_lost(&self, views: &[PhotoView]) -> bool {
        let (mut there, mut below) = (0, 0);
        for view in views {
            let (center, forward) = (view.camera.center(), view.camera.forward());
            for (ray, depth) in view.rays().zip(&view.depth) {
                let Some((way, _)) = self.met(center, ray) else { continue };
                let off = f64::from(*depth) / (way * ray.dot(forward)) - 1.0;
                below += u64::from(off > FLOOR_THICKNESS || *depth == 0.0);
                there += u64::from(off.abs() <= FLOOR_THICKNESS && *depth > 0.0);
            }
        }
        below as f64 > LOST_FLOOR_SHARE * (there + below) as f64
    }

    /// Returns the distance along a ray (of length 1) to it, and the share of that over which the
    /// ray is in its slab; `None` if it is not met, or where it is not known.
    pub(super) fn met(&self, from: DVec3, ray: DVec3) -> Option<(f64, f64)> {
        let (above, falls) = ((from - self.point).dot(self.normal), -ray.dot(self.normal));
        let way = above / falls;
        let is_met = above > 0.0 && falls > 0.0 && (from + way * ray).distance(self.point) < self.reach;
        is_met.then_some((way, self.slab / above))
    }
}

impl PhotoView {
    /// [`PhotoView::stop_at`] of all views.
    #[must_use]
    pub fn stopped_at(views: &[Self], floors: &[FloorPlane]) -> Vec<Self> {
        map(views.len(), |index| {
            let mut view = views[index].clone();
            view.stop_at(floors);
            view
        })
    }

    /// Brings what is seen below the floors of a walk onto them, along its ray, what is not there
    /// at all, and what is a little above.
    pub(crate) fn stop_at(&mut self, floors: &[FloorPlane]) {
        let (center, forward) = (self.camera.center(), self.camera.forward());
        let is_near = |floor: &&FloorPlane| {
            let off = floor.point - center;
            off.length() < EXAMINED_REACH * floor.reach && off.dot(forward) > -floor.reach
        };
        self.floors = floors.iter().filter(is_near).copied().collect();
        self.on = vec![0; self.depth.len()];
        if self.floors.is_empty() {
            return;
        }
        let rays: Vec<DVec3> = self.rays().collect();
        for (pixel, ray) in rays.into_iter().enumerate() {
            let stops = (1..).zip(&self.floors).filter_map(|(k, floor)| Some((k, floor.met(center, ray)?)));
            let Some((k, (way, slab))) = stops.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { continue };
            let (depth, stop) = (&mut self.depth[pixel], way * ray.dot(forward));
            if *depth == 0.0 || f64::from(*depth) > stop * (1.0 - slab) {
                *depth = stop as f32;
                self.on[pixel] = k;
            }
        }
    }
}
