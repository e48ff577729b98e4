//! Viewpoints, and where a place is looked at from.

use glam::DVec3;
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

/// Viewers for whom splats are made: people on a line along y.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Audience {
    pub(crate) x: f64,
    /// The ends of their line, m.
    pub(crate) y: (f64, f64),
    /// Height of their eyes, m.
    pub(crate) z: f64,
    /// The way that they look: a point is seen from this much before it, as a share of its distance
    /// from the line. At 0 they look around; above 0 nobody looks back beyond the line's beginning.
    pub(crate) lead: f64,
}

impl Audience {
    /// From where on the line a point is seen nearest.
    pub(super) fn viewer(&self, point: DVec3) -> DVec3 {
        let aside = (point.x - self.x).hypot(point.z - self.z);
        DVec3::new(self.x, (point.y - self.lead * aside).clamp(self.y.0, self.y.1), self.z)
    }
}
