//! Headlamps of the car that carries the camera: low beams, whose light falls from beside the
//! viewer, so that rain and fog are lit from there and shadows hardly show.

use super::lamps::{LampKind, LampLight, black_body};
use crate::optics::Site;
use glam::{DVec3, Vec3};
use wm_scene::Camera;

/// Luminous intensity of both in the middle of the beam, cd; a car's low beams have some 10,000 to
/// 15,000 each there.
const INTENSITY: f64 = 22_000.0;
/// Colour, K.
const KELVIN: f64 = 5_000.0;
/// Standard deviations of the beam to the sides and downwards, and where it is brightest, as
/// tangents.
const BEAM_WIDTH: f32 = 0.33;
const BEAM_HEIGHT: f32 = 0.11;
const BEAM_DIP: f32 = -0.02;
/// Width of the cut-off above the horizon, as a tangent, and the share of stray light above it.
const CUT_OFF: f32 = 0.008;
const STRAY: f32 = 0.012;
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
    /// On a car that heads where the camera looks. `display` is the value of a lux in the unit of
    /// the light.
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
            intensity: DVec3::from_array(black_body(KELVIN).map(|v| v * INTENSITY)).as_vec3(),
            display: display as f32,
        }
    }

    /// The share of the intensity that goes along an offset, by its part forwards, to the right and
    /// up.
    #[inline]
    fn share(forward: f32, right: f32, up: f32) -> f32 {
        if forward <= 0.0 {
            return 0.0;
        }
        let (side, rise) = (right / forward, up / forward);
        let below = ((rise - BEAM_DIP) / BEAM_HEIGHT).powi(2);
        // The beam ends at the horizon, softly.
        let cut = 1.0 / (1.0 + ((rise / CUT_OFF).clamp(-30.0, 30.0)).exp());
        let wide = (-0.5 * (side / BEAM_WIDTH).powi(2)).exp();
        wide * (cut * (-0.5 * below).exp() + STRAY * (-2.0 * rise.abs()).exp())
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
        let share = Self::share(along(self.forward), along(self.right), along(self.up));
        self.intensity * (self.display * share * incidence / squared)
    }

    /// As a source for the light in the air and on what falls.
    #[must_use]
    pub fn source(&self) -> LampLight {
        LampLight {
            at: self.at.to_array(),
            intensity: self.intensity.to_array(),
            axis: self.forward.to_array(),
            up: self.up.to_array(),
            exponent: 1.0,
            // The air before the car is seen over its bonnet, not in the lamps.
            radius: 1.0,
            kind: LampKind::Headlamps,
        }
    }

    /// The share of [`LampKind::Headlamps`] in a direction of length 1, with `up` of length 1.
    #[inline]
    pub(super) fn share_towards(direction: Vec3, forward: Vec3, up: Vec3) -> f32 {
        Self::share(direction.dot(forward), direction.dot(forward.cross(up)), direction.dot(up))
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
