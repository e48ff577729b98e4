//! The lamps that shine in a frame, and their light on small particles.

use crate::light::lamp_shadows::DepthCube;
use crate::light::lamps::LampLight;
use glam::Vec3;
use std::f64::consts::PI;

/// Least distance of a ray from a lamp, m.
pub(super) const MIN_RAY_DISTANCE_M: f32 = 0.05;
/// Light of a lamp that is left out, in units of display white.
pub(super) const MIN_LIGHT: f32 = 2e-4;

/// A light, and the surfaces that it sees first, if it casts shadows.
pub type ShadowedLight<'a> = (LampLight, Option<&'a DepthCube>);

/// The lamps of a place that shine in a frame.
#[derive(Clone, Copy, Debug)]
pub struct LampsOn<'a> {
    /// The lamps, with the shadows that they cast.
    pub lights: &'a [ShadowedLight<'a>],
    /// Display units of a lux: an irradiance of that brings a white surface to display white.
    pub display: f32,
}

impl LampsOn<'_> {
    /// Radiance of a small particle of albedo 1 at an offset from the eye at `center` (world axes,
    /// scene units), averaged over its face, linear RGB as it is displayed. `asymmetry` is that of
    /// Henyey and Greenstein's phase function.
    pub(crate) fn scattered(&self, center: Vec3, offset: Vec3, asymmetry: f32, metres_per_unit: f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        let to_eye = -offset.normalize_or_zero();
        for (light, cube) in self.lights {
            let from_lamp = center + offset - Vec3::from_array(light.at);
            let metres = from_lamp * metres_per_unit;
            let squared = metres
                .length_squared()
                .max(MIN_RAY_DISTANCE_M * MIN_RAY_DISTANCE_M + light.radius * light.radius);
            let intensity = Vec3::from_array(light.intensity) * (PI as f32 * self.display);
            // At most some three times an even spread, but for what is nearly in front of the lamp.
            if intensity.max_element() < MIN_LIGHT * squared {
                continue;
            }
            let direction = metres / squared.sqrt();
            let cos = direction.dot(to_eye);
            let denominator = 1.0 + asymmetry * asymmetry - 2.0 * asymmetry * cos;
            let phase = (1.0 - asymmetry * asymmetry) / (4.0 * PI as f32 * denominator * denominator.sqrt());
            let share = light.share(direction) * phase / squared;
            if share > 0.0 && cube.is_none_or(|cube| cube.is_open(from_lamp)) {
                sum += intensity * share;
            }
        }
        sum
    }
}
