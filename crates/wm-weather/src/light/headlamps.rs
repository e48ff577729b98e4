//! Headlamps of the car that carries the camera: low beams, whose light falls from beside the
//! viewer, so that rain and fog are lit from there and shadows hardly show.

use super::lamps::{LampKind, LampLight, black_body, headlamp_beam};
use crate::optics::Site;
use glam::{DVec3, Vec3};
use wm_scene::Camera;

/// Luminous intensity of both in the middle of the beam, cd; a car's low beams have some 10,000 to
/// 15,000 each there.
const BEAM_INTENSITY_CD: f64 = 22_000.0;
const HEADLAMP_KELVIN: f64 = 5_000.0;
/// Place from the camera: ahead and below, m.
const LAMP_AHEAD_M: f64 = 1.2;
const LAMP_BELOW_M: f64 = 0.6;
/// Nearest that they shine on, m.
const MIN_DISTANCE_M: f32 = 0.5;

/// Both headlamps as one source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Headlamps {
    /// World axes, scene units.
    at: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    metres_per_unit: f32,
    /// cd.
    intensity: Vec3,
    /// A lux in the unit of the scene's light.
    display: f32,
}

impl Headlamps {
    /// The headlamps of a car that heads where the camera looks. `display` is the value of a lux in
    /// the unit of the light.
    pub(crate) fn new(camera: &Camera, display: f64, site: &Site) -> Self {
        let up = DVec3::from_array(site.up);
        let ahead = camera.forward();
        let level = ahead - up * up.dot(ahead);
        // A camera that looks straight down has no heading but that of its picture's upper side.
        let forward = level.try_normalize().unwrap_or_else(|| camera.up());
        let metre = 1.0 / site.metres_per_unit;
        let at = camera.center() + (forward * LAMP_AHEAD_M - up * LAMP_BELOW_M) * metre;
        Self {
            at: at.as_vec3(),
            forward: forward.as_vec3(),
            right: forward.cross(up).as_vec3(),
            up: up.as_vec3(),
            metres_per_unit: site.metres_per_unit as f32,
            intensity: DVec3::from_array(black_body(HEADLAMP_KELVIN).map(|v| v * BEAM_INTENSITY_CD))
                .as_vec3(),
            display: display as f32,
        }
    }

    /// Irradiance of a surface (world axes, scene units), in the unit of the light. A normal of
    /// zero is that of leaves.
    #[inline]
    pub(crate) fn irradiance(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let offset = (point - self.at) * self.metres_per_unit;
        let squared = offset.length_squared().max(MIN_DISTANCE_M * MIN_DISTANCE_M);
        let along = |axis: Vec3| offset.dot(axis);
        let incidence = if normal == Vec3::ZERO { 0.5 } else { -normal.dot(offset) / squared.sqrt() };
        if incidence <= 0.0 {
            return Vec3::ZERO;
        }
        let share = headlamp_beam(along(self.forward), along(self.right), along(self.up));
        self.intensity * (self.display * share * incidence / squared)
    }

    /// The source of the light in the air and on what falls.
    #[must_use]
    pub fn source(&self) -> LampLight {
        LampLight {
            at: self.at.to_array(),
            intensity: self.intensity.to_array(),
            axis: self.forward.to_array(),
            up: self.up.to_array(),
            // The air before the car is seen over its bonnet, not in the lamps.
            radius: 1.0,
            kind: LampKind::Headlamps,
            ..LampLight::DARK
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_road_ahead_is_lit_and_not_what_is_above_or_behind() {
        let camera =
            Camera::looking((300, 200), 50.0, DVec3::new(0.0, 0.0, 1.2), DVec3::new(9.0, 0.0, 1.0), DVec3::Z)
                .unwrap();
        let lamps = Headlamps::new(&camera, 1.0, &Site::PLAIN);
        let on = |x: f32, y: f32| lamps.irradiance(Vec3::new(x, y, 0.0), Vec3::Z).y;
        // Tens of lux on an upright board 20 m ahead, few on the road, and next to nothing above
        // the horizon.
        let board = |z: f32| lamps.irradiance(Vec3::new(21.2, 0.0, z), Vec3::NEG_X).y;
        assert!((20.0..70.0).contains(&board(0.2)), "{}", board(0.2));
        assert!(board(2.0) < 0.1 * board(0.2), "{}", board(2.0));
        assert!((0.3..5.0).contains(&on(21.2, 0.0)) && on(-3.0, 0.0) == 0.0, "{}", on(21.2, 0.0));
        assert!(on(10.0, 5.0) < on(10.0, 0.0));
    }
}
