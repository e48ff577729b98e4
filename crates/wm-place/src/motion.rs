//! Cameras that move.

use crate::MovingCamera;
use crate::view::path::{CameraPath, PathKey};
use glam::{DMat3, DMat4, DVec3};
use wm_scene::Camera;
use wm_scene::camera::viewmat_of;
use wm_sensors::SensorPose;

/// Half of the time over which the velocity of a path is taken, s: as long as an exposure.
const VELOCITY_HALF_STEP_S: f64 = 0.01;

/// The pose of a sensor on a rig. Axes of both are x forward, y left and z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// The place of the sensor, m, axes of the rig.
    pub position: DVec3,
    /// The attitude of the sensor: its axes in those of the rig are the columns.
    pub rig_from_sensor: DMat3,
}

/// A camera as a function of time.
#[derive(Clone, Debug)]
pub enum CameraMotion {
    /// A camera that stays where it is. With a speed, rain is streaked as it is from a car that
    /// drives.
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
    /// A motion that begins later.
    Delayed {
        /// The motion.
        base: Box<CameraMotion>,
        /// Seconds.
        by: f64,
    },
    /// A camera or another sensor on a rig, whose origin is where a camera is: ahead is the way
    /// that it looks.
    Mounted {
        /// The camera that the rig moves with.
        base: Box<CameraMotion>,
        /// The pose on the rig.
        mount: Mount,
        /// The size, the focal lengths and the principal point of its pictures.
        intrinsics: Box<Camera>,
        /// The scale of the scene.
        metres_per_unit: f64,
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
            Self::Delayed { base, by } => base.camera(time - by),
            Self::Mounted { base, intrinsics, .. } => {
                let SensorPose { origin, world_from_sensor } = self.sensor_pose(time);
                let [ahead, left, up] = world_from_sensor.to_cols_array_2d().map(DVec3::from_array);
                let rotation = DMat3::from_cols(-left, -up, ahead).transpose();
                let viewmat = viewmat_of(rotation, -(rotation * origin));
                Camera { viewmat, near: base.camera(time).near, ..**intrinsics }
            }
        }
    }

    /// The pose `time` seconds after the start, x forward, y left and z up: of a sensor on a rig,
    /// or of the camera itself.
    #[must_use]
    pub fn sensor_pose(&self, time: f64) -> SensorPose {
        if let Self::Delayed { base, by } = self {
            return base.sensor_pose(time - by);
        }
        let Self::Mounted { base, mount, metres_per_unit, .. } = self else {
            let camera = self.camera(time);
            let (ahead, up) = (camera.forward(), camera.up());
            return SensorPose {
                origin: camera.center(),
                world_from_sensor: DMat3::from_cols(ahead, up.cross(ahead), up),
            };
        };
        let rig = base.sensor_pose(time);
        SensorPose {
            origin: rig.origin + rig.world_from_sensor * mount.position / *metres_per_unit,
            world_from_sensor: rig.world_from_sensor * mount.rig_from_sensor,
        }
    }

    /// The motion of a rig: a camera that stays with a speed drives ahead for so many seconds.
    ///
    /// # Errors
    /// [`crate::Error::View`] if its keys make no path.
    pub fn driven(self, seconds: f64, metres_per_unit: f64) -> crate::Result<Self> {
        let Self::Still { camera, speed } = &self else { return Ok(self) };
        if *speed == 0.0 {
            return Ok(self);
        }
        let start = PathKey::of(camera, 0.0);
        let way = camera.forward() * (speed * seconds / metres_per_unit);
        let end = PathKey { time: seconds, eye: start.eye + way, ..start };
        let path = CameraPath::new(vec![start, end], camera.near)?;
        Ok(Self::Along { path, size: (camera.width, camera.height) })
    }

    /// The camera `time` seconds after the start and its velocity, in a scene of this scale.
    #[must_use]
    pub fn at(&self, time: f64, metres_per_unit: f64) -> MovingCamera {
        let camera = self.camera(time);
        let velocity = match self {
            Self::Still { speed, .. } => camera.forward() * *speed,
            Self::Delayed { base, by } => return base.at(time - by, metres_per_unit),
            Self::Along { .. } | Self::Mounted { .. } => {
                let at = |time: f64| self.camera(time).center() * metres_per_unit;
                (at(time + VELOCITY_HALF_STEP_S) - at(time - VELOCITY_HALF_STEP_S))
                    / (2.0 * VELOCITY_HALF_STEP_S)
            }
        };
        MovingCamera { camera, velocity: velocity.to_array() }
    }

    /// The camera `time` seconds after the start; one that stays with a speed has driven ahead
    /// since `since`.
    #[must_use]
    pub fn driven_since(&self, since: f64, time: f64, metres_per_unit: f64) -> MovingCamera {
        let mut moving = self.at(time, metres_per_unit);
        if let Self::Still { speed, .. } = self {
            let way = moving.camera.forward() * (speed * (time - since) / metres_per_unit);
            moving.camera.viewmat *= DMat4::from_translation(-way);
        }
        moving
    }

    /// Seconds from the first key of the path to its last; 0 for a camera that stays.
    #[must_use]
    pub fn duration(&self) -> f64 {
        match self {
            Self::Still { .. } => 0.0,
            Self::Along { path, .. } => path.duration(),
            Self::Delayed { base, .. } | Self::Mounted { base, .. } => base.duration(),
        }
    }

    /// Everything that the cameras depend on, as text that tells one motion from another.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        match self {
            Self::Still { camera, .. } => format!("{camera:?}"),
            Self::Along { path, size } => format!("{:?} {size:?} {}", path.keys(), path.near()),
            Self::Delayed { base, by } => format!("{} later by {by}", base.fingerprint()),
            Self::Mounted { base, mount, intrinsics, .. } => {
                format!("{} {mount:?} {intrinsics:?}", base.fingerprint())
            }
        }
    }
}
