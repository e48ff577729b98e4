//! Cameras that move.

use crate::frame::MovingCamera;
use crate::view::path::CameraPath;
use wm_scene::Camera;

/// Half of the time over which the velocity of a path is taken, s: as long as an exposure.
const MOMENT: f64 = 0.01;

/// A camera as a function of time.
#[derive(Clone, Debug)]
pub enum CameraMotion {
    /// A camera that stays where it is. With a speed, rain is streaked as it is from a car that drives.
    Still {
        /// The camera.
        camera: Box<Camera>,
        /// m/s, ahead.
        speed: f64,
    },
    /// A camera on a path.
    Along {
        /// The path.
        path: CameraPath,
        /// Width and height of the pictures, px.
        size: (u32, u32),
    },
}

impl From<Camera> for CameraMotion {
    fn from(camera: Camera) -> Self {
        Self::Still { camera: Box::new(camera), speed: 0.0 }
    }
}

impl CameraMotion {
    /// The camera `time` seconds after the start.
    #[must_use]
    pub fn camera(&self, time: f64) -> Camera {
        match self {
            Self::Still { camera, .. } => **camera,
            Self::Along { path, size } => path.at(path.start() + time, *size),
        }
    }

    /// The camera `time` seconds after the start and its velocity, in a scene of this scale.
    #[must_use]
    pub fn at(&self, time: f64, metres_per_unit: f64) -> MovingCamera {
        let camera = self.camera(time);
        let velocity = match self {
            Self::Still { speed, .. } => camera.forward() * *speed,
            Self::Along { .. } => {
                let at = |time: f64| self.camera(time).center() * metres_per_unit;
                (at(time + MOMENT) - at(time - MOMENT)) / (2.0 * MOMENT)
            }
        };
        MovingCamera { camera, velocity: velocity.to_array() }
    }

    /// Seconds from the first key of the path to its last; 0 for a camera that stays.
    #[must_use]
    pub fn duration(&self) -> f64 {
        match self {
            Self::Still { .. } => 0.0,
            Self::Along { path, .. } => path.duration(),
        }
    }

    /// Everything that the cameras depend on, as text that tells one motion from another.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        match self {
            Self::Still { camera, .. } => format!("{camera:?}"),
            Self::Along { path, size } => format!("{:?} {size:?} {}", path.keys(), path.near()),
        }
    }
}
