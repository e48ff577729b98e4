//! Viewpoints, and where a place is looked at from.

use crate::Place;
use crate::sampling::Audience;
use glam::{DVec2, DVec3};
use wm_scene::Gps;
use wm_scene::{Camera, CameraError};

/// A named eye and what it looks at, metres, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// A short name, as on a command line.
    pub name: &'static str,
    /// The position of the camera.
    pub eye: DVec3,
    /// The point in the middle of the picture.
    pub target: DVec3,
    /// Vertical field of view, degrees.
    pub fov_y: f64,
}

impl Viewpoint {
    pub(crate) const fn new(name: &'static str, eye: [f64; 3], target: [f64; 3], fov_y: f64) -> Self {
        Self { name, eye: DVec3::from_array(eye), target: DVec3::from_array(target), fov_y }
    }

    /// The camera of this view for a picture of `size` (width, height), px.
    ///
    /// # Errors
    /// [`CameraError`] if the size makes no camera.
    pub fn camera(&self, size: (u32, u32)) -> Result<Camera, CameraError> {
        Camera::looking(size, self.fov_y, self.eye, self.target, DVec3::Z)
    }
}

/// Where a place is looked at from.
#[derive(Clone, Debug)]
pub(crate) struct Sights {
    pub(crate) views: Vec<Viewpoint>,
    /// A walk at eye level by the share of its time, 0-1.
    pub(crate) dolly: fn(&Place, f64) -> Viewpoint,
    /// The path that somebody with a camera walks.
    pub(crate) path: Vec<DVec2>,
    /// The lane that a car drives along, in a straight line.
    pub(crate) road: (DVec2, DVec2),
    /// Target of flights.
    pub(crate) middle: DVec3,
    /// Radius of a flight around that, m.
    pub(crate) orbit: f64,
    /// Viewers for whom splats are made.
    pub(crate) audience: Audience,
    /// Splats lower than this, m, are inside of the ground.
    pub(crate) lowest: f64,
    /// The place on Earth of its origin.
    pub(crate) home: Gps,
}
