//! Poses of sensors, fixed and over time.

use glam::{DMat3, DVec3};

/// The place and the attitude of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPose {
    /// The origin, world axes, scene units.
    pub origin: DVec3,
    /// The axes in the world: columns are x forward, y left and z up, length 1.
    pub world_from_sensor: DMat3,
}

impl SensorPose {
    /// A sensor at `origin` that stands upright: z is `up`, x the level part of `forward`. With
    /// `forward` along `up` it looks anywhere.
    #[must_use]
    pub fn upright(origin: DVec3, forward: DVec3, up: DVec3) -> Self {
        let z = up.normalize_or(DVec3::Z);
        let level = forward.reject_from_normalized(z);
        let x = level.try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
        Self { origin, world_from_sensor: DMat3::from_cols(x, z.cross(x), z) }
    }

    /// A direction of the sensor in world axes.
    pub(crate) fn to_world(self, direction: DVec3) -> DVec3 {
        self.world_from_sensor * direction
    }

    /// A direction of the world in the sensor's axes.
    pub(crate) fn to_sensor(self, direction: DVec3) -> DVec3 {
        self.world_from_sensor.transpose() * direction
    }
}

/// A direction in a sensor's axes.
pub(crate) fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    let ([sin, cos], [up, level]) = ([azimuth.sin(), azimuth.cos()], [elevation.sin(), elevation.cos()]);
    DVec3::new(level * cos, level * sin, up)
}

/// A sensor's pose as a function of time.
pub trait SensorMotion: Sync {
    /// The pose at a time, s.
    fn pose(&self, time: f64) -> SensorPose;
}

impl SensorMotion for SensorPose {
    fn pose(&self, _: f64) -> SensorPose {
        *self
    }
}

/// A sensor that moves evenly and does not turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvenMotion {
    /// The pose at time 0.
    pub start: SensorPose,
    /// Scene units a second, world axes.
    pub velocity: DVec3,
}

impl SensorMotion for EvenMotion {
    fn pose(&self, time: f64) -> SensorPose {
        SensorPose { origin: self.start.origin + self.velocity * time, ..self.start }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_sensor_has_its_left_on_the_left() {
        let pose = SensorPose::upright(DVec3::ZERO, DVec3::new(0.0, 3.0, -1.0), DVec3::Z);
        assert!((pose.to_world(DVec3::X) - DVec3::Y).length() < 1e-12);
        // Looking north, west is on the left.
        assert!((pose.to_world(DVec3::Y) + DVec3::X).length() < 1e-12);
        assert!((pose.to_sensor(DVec3::Z) - DVec3::Z).length() < 1e-12);
        let down = SensorPose::upright(DVec3::ZERO, -DVec3::Z, DVec3::Z);
        assert!((down.world_from_sensor.determinant() - 1.0).abs() < 1e-12);
    }
}
