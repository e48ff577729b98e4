//! The ground under a walk, which is parallel to it.
//!
//! The ground at one's feet is in one or two photos and has few marks, so that a training may leave
//! it at any depth: it looks right in its photo from however far below. But where cameras were
//! carried at one height the ground is that far below them, and nothing is seen below it. Where the
//! photos do not tell that height, but the scene has a ground over which all cameras are as high,
//! and most of what they see of it is not there, that is the floor.

use glam::{DVec2, DVec3};
use wm_scene::Camera;

/// Distance from the camera to which its floor is known, camera heights.
const FLOOR_REACH_HEIGHTS: f64 = 6.0;
/// Radius about a camera within which the path tells the slope, and the spreads of the cameras
/// along a direction at which they tell nothing of that slope and all of it; in camera heights.
const SLOPE_RADIUS_HEIGHTS: f64 = 4.0;
const PATH_SPREADS_HEIGHTS: [f64; 2] = [0.75, 1.5];
/// Distance to which that of the whole place is known, camera heights: a court.
const PLACE_REACH: f64 = 40.0;
/// Largest spread of the cameras' heights above it, as a share, and largest sine of the pitch of
/// most cameras: more is no walk but a flight.
const MAX_HEIGHT_SPREAD: f64 = 0.2;
const MAX_PITCH_SINE: f64 = 0.26;
/// Height above the floor, camera heights, below which points belong to it: kerbs, cobbles and
/// errors of depth.
pub(super) const FLOOR_THICKNESS: f64 = 0.15;
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
        let weight =
            |offset: DVec2| (-0.5 * offset.length_squared() / (SLOPE_RADIUS_HEIGHTS * height).powi(2)).exp();
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
            let [low, high] = PATH_SPREADS_HEIGHTS.map(|wavers| (wavers * height).powi(2));
            let belief = ((spread - low) / (high - low)).clamp(0.0, 1.0);
            if belief > 0.0 { slope + *way * (belief * way.dot(rises) / spread) } else { slope }
        });
        let rise = mean.z - slope.dot(mean.truncate());
        let normal = (up - slope.x * axes[0] - slope.y * axes[1]).normalize();
        Self {
            point: center + (rise - height) * up,
            normal,
            reach: FLOOR_REACH_HEIGHTS * height,
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
        let is_level = middle(&mut pitches)?.abs() < MAX_PITCH_SINE;
        let center = cameras.iter().map(Camera::center).sum::<DVec3>() / cameras.len() as f64;
        let point = center - (center.dot(up) - ground) * up;
        (is_even && is_level).then_some(Self {
            point,
            normal: up,
            reach: PLACE_REACH * height,
            slab: LOST_FLOOR_THICKNESS * height,
        })
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
