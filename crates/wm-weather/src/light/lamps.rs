//! Lamps and lit windows as sources of light.
//!
//! Intensities are candela by channel with luminance in cd, irradiances lux. A camera at night is
//! balanced for the lamps about it: colours are those of black bodies beside one of
//! [`LAMP_WHITE_KELVIN`].

use crate::level::dot;
use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use wm_base::color::luminance;
use wm_scene::{Camera, Lamp, LitWindow};

/// Colour temperature that is shown as white by lamplight.
const LAMP_WHITE_KELVIN: f64 = 4_000.0;
/// Reflectance of the ground that returns light.
const GROUND_REFLECTANCE: f64 = 0.2;
/// Height above the ground from which it returns the light of a lamp, m.
const ABOVE_GROUND: f64 = 0.3;
/// Distance between windows that are one source of light, m.
const ONE_ROOM: f64 = 4.0;
/// Lowest and highest lamps whose light the ground returns.
const RETURNED_LAMP_HEIGHTS_M: [f64; 2] = [1.0, 30.0];
/// Standard deviations of the beam of headlamps to the sides and downwards, and where it is
/// brightest, as tangents.
const BEAM_WIDTH: f32 = 0.33;
const BEAM_HEIGHT: f32 = 0.11;
const BEAM_DIP: f32 = -0.02;
/// Width of the cut-off above the horizon, as a tangent, and the share of stray light above it.
const CUT_OFF_WIDTH: f32 = 0.008;
const STRAY_LIGHT_SHARE: f32 = 0.012;

/// A small source of light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LampLight {
    /// Position, world axes, scene units.
    pub at: [f32; 3],
    /// Luminous intensity along the axis, linear RGB, cd.
    pub intensity: [f32; 3],
    /// The axis, length 1; zero of a lamp that shines to all sides.
    pub axis: [f32; 3],
    /// Up for the beam of headlamps, length 1; zero of the others.
    pub up: [f32; 3],
    /// The intensity at the angle `t` from the axis is `cos^exponent t` of that along it.
    pub exponent: f32,
    /// Radius of a ball, or of a disc of the same area as a window, m.
    pub radius: f32,
    /// Kind of lamp.
    pub kind: LampKind,
}

/// The kinds of sources of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LampKind {
    /// A lamp, which is seen as a ball.
    Ball,
    /// A window, which is drawn as a surface.
    Window,
    /// Lit ground under a lamp: it lights what is around, and is not seen itself.
    Ground,
    /// The headlamps of the camera's car, with a beam of their own.
    Headlamps,
}

/// A light as a camera sees it.
pub(crate) struct SeenLight {
    /// Position in camera axes, scene units.
    pub(crate) view: DVec3,
    /// Position in the picture, px.
    pub(crate) pixel: DVec2,
    /// The way from the light to the camera, world axes, scene units, and its length.
    pub(crate) to_eye: DVec3,
    pub(crate) length: f64,
}

impl LampLight {
    /// A light to all sides that is off.
    pub(crate) const DARK: Self = Self {
        at: [0.0; 3],
        intensity: [0.0; 3],
        axis: [0.0; 3],
        up: [0.0; 3],
        exponent: 1.0,
        radius: 1.0,
        kind: LampKind::Ball,
    };

    /// Returns the light as a camera sees it; `None` if it is no deeper than `near`, scene units.
    pub(crate) fn seen_by(&self, camera: &Camera, near: f64) -> Option<SeenLight> {
        let (at, Camera { fx, fy, cx, cy, .. }) = (Vec3::from_array(self.at).as_dvec3(), *camera);
        let view = camera.rotation() * (at - camera.center());
        let pixel = DVec2::new(fx * view.x / view.z + cx, fy * view.y / view.z + cy);
        let (to_eye, length) = (camera.center() - at, view.length());
        (view.z > near).then_some(SeenLight { view, pixel, to_eye, length })
    }

    /// A lamp.
    pub(crate) fn of_lamp(lamp: &Lamp) -> Self {
        let axis = lamp.aim.map_or(DVec3::ZERO, |aim| DVec3::from_array(aim).normalize_or_zero());
        Self {
            at: lamp.at.map(|v| v as f32),
            intensity: black_body(lamp.kelvin).map(|v| (v * lamp.intensity()) as f32),
            axis: axis.as_vec3().to_array(),
            exponent: lamp.exponent() as f32,
            radius: lamp.radius as f32,
            kind: LampKind::Ball,
            ..Self::DARK
        }
    }

    /// A window, as a small surface in its middle that shines by the cosine.
    fn of_window(window: &LitWindow, metres_per_unit: f64) -> Self {
        let (middle, area) = window.middle_and_area();
        let metres = area.length() * metres_per_unit * metres_per_unit;
        let out = area.normalize_or_zero();
        // Off the wall, so that the wall does not hide it.
        let at = middle + out * (0.05 / metres_per_unit);
        Self {
            at: at.as_vec3().to_array(),
            intensity: black_body(window.kelvin).map(|v| (v * window.luminance * metres) as f32),
            axis: out.as_vec3().to_array(),
            radius: (metres / PI).sqrt() as f32,
            kind: LampKind::Window,
            ..Self::DARK
        }
    }

    /// Returns true for windows of one wall that light its surroundings as one.
    fn is_beside(&self, other: &Self, metres_per_unit: f64) -> bool {
        let [a, b] = [self, other].map(|light| Vec3::from_array(light.at));
        let [own, its] = [self, other].map(|light| Vec3::from_array(light.axis));
        f64::from(a.distance(b)) * metres_per_unit < ONE_ROOM && own.dot(its) > 0.98
    }

    /// Takes the light of a window beside it.
    fn join(&mut self, other: &Self) {
        let [own, its] = [&*self, other].map(|light| luminance(light.intensity.map(f64::from)));
        let share = (its / (own + its)) as f32;
        self.at = Vec3::from_array(self.at).lerp(Vec3::from_array(other.at), share).to_array();
        (0..3).for_each(|k| self.intensity[k] += other.intensity[k]);
        self.radius = self.radius.hypot(other.radius);
    }

    /// The ground that a lamp lights, `metres` below it; `None` where it returns next to nothing.
    pub(crate) fn ground_under(&self, metres: f64, up: DVec3, metres_per_unit: f64) -> Option<Self> {
        if self.kind != LampKind::Ball
            || !(RETURNED_LAMP_HEIGHTS_M[0]..RETURNED_LAMP_HEIGHTS_M[1]).contains(&metres)
        {
            return None;
        }
        let down = self.flux_below(-up);
        let at = Vec3::from_array(self.at).as_dvec3() - up * ((metres - ABOVE_GROUND) / metres_per_unit);
        (down > 0.0).then(|| Self {
            at: at.as_vec3().to_array(),
            // A matt surface of this flux has its share of 1 / pi straight up.
            intensity: self.intensity.map(|v| (f64::from(v) * down * GROUND_REFLECTANCE / PI) as f32),
            axis: up.as_vec3().to_array(),
            radius: (0.5 * metres) as f32,
            kind: LampKind::Ground,
            ..Self::DARK
        })
    }

    /// Flux to the side of `down` over the intensity along the axis, sr.
    fn flux_below(&self, down: DVec3) -> f64 {
        if self.axis == [0.0; 3] {
            return 2.0 * PI;
        }
        // All of it where it points down, a half of it level, and none where it points up.
        let share = 0.5 * (1.0 + down.dot(Vec3::from_array(self.axis).as_dvec3()));
        share * 2.0 * PI / (f64::from(self.exponent) + 1.0)
    }

    /// The share of the intensity along the axis that goes in a direction (world axes, length 1).
    #[inline]
    pub(crate) fn share(&self, direction: Vec3) -> f32 {
        if self.axis == [0.0; 3] {
            return 1.0;
        }
        if self.kind == LampKind::Headlamps {
            let [forward, up] = [self.axis, self.up].map(Vec3::from_array);
            return headlamp_beam(
                direction.dot(forward),
                direction.dot(forward.cross(up)),
                direction.dot(up),
            );
        }
        let cos = direction.dot(Vec3::from_array(self.axis));
        if cos <= 0.0 { 0.0 } else { cos.powf(self.exponent) }
    }

    /// Illuminance of level ground that it lights, lx: the mean over that ground, the lighter parts
    /// counting more. `height` is that of the lamp above it, m.
    fn level(&self, height: f64, down: DVec3) -> f64 {
        let straight = luminance(self.intensity.map(f64::from)) * f64::from(self.share(down.as_vec3()))
            / (height * height);
        // With E = E0 cos^(n + 3), the integral of E^2 over that of E.
        let n = f64::from(self.exponent);
        straight * (n + 1.0) / (2.0 * n + 4.0)
    }
}

/// The share of the intensity of headlamps that goes along an offset, by its part forwards, to the
/// right and up.
#[inline]
pub(super) fn headlamp_beam(forward: f32, right: f32, up: f32) -> f32 {
    if forward <= 0.0 {
        return 0.0;
    }
    let (side, rise) = (right / forward, up / forward);
    let below = ((rise - BEAM_DIP) / BEAM_HEIGHT).powi(2);
    // The beam ends at the horizon, softly.
    let cut = 1.0 / (1.0 + ((rise / CUT_OFF_WIDTH).clamp(-30.0, 30.0)).exp());
    let wide = (-0.5 * (side / BEAM_WIDTH).powi(2)).exp();
    wide * (cut * (-0.5 * below).exp() + STRAY_LIGHT_SHARE * (-2.0 * rise.abs()).exp())
}

/// All sources of light of a place.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LampLights {
    /// The sources.
    pub(crate) lights: Vec<LampLight>,
}

/// Least height that lamps are taken to stand at above the ground, m.
const LEAST_HEIGHT: f64 = 2.5;

impl LampLights {
    /// Collects the lights of lamps and windows.
    #[must_use]
    pub fn of(lamps: &[Lamp], windows: &[LitWindow], metres_per_unit: f64) -> Self {
        let mut lights: Vec<LampLight> = lamps.iter().map(LampLight::of_lamp).collect();
        let first = lights.len();
        for window in windows {
            let new = LampLight::of_window(window, metres_per_unit);
            let of_room = lights[first..].iter_mut().find(|known| known.is_beside(&new, metres_per_unit));
            match of_room {
                Some(known) => known.join(&new),
                None => lights.push(new),
            }
        }
        Self { lights }
    }

    /// Returns true if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// All of their numbers, which tell them from others.
    #[must_use]
    pub fn numbers(&self) -> Vec<f64> {
        let each = |light: &LampLight| {
            let LampLight { at, intensity, axis, up, exponent, radius, kind } = *light;
            let vectors = [at, intensity, axis, up].into_iter().flatten();
            vectors.chain([exponent, radius, f32::from(kind as u8)]).map(f64::from).collect::<Vec<_>>()
        };
        self.lights.iter().flat_map(each).collect()
    }

    /// Illuminance of the lit ground, lx, to which a camera's exposure is set: the mean over the
    /// lamps of that under each. `ground` is the height of the ground along `up`, scene units.
    #[must_use]
    pub fn level(&self, up: [f64; 3], ground: f64, metres_per_unit: f64) -> f64 {
        let up = DVec3::from_array(up);
        let balls = self.lights.iter().filter(|light| light.kind == LampKind::Ball);
        let levels: Vec<f64> = balls
            .map(|light| {
                let height = (up.dot(Vec3::from_array(light.at).as_dvec3()) - ground) * metres_per_unit;
                light.level(height.max(LEAST_HEIGHT), -up)
            })
            .collect();
        levels.iter().sum::<f64>() / levels.len().max(1) as f64
    }
}

/// The colour of a black body, linear RGB of luminance 1, in a picture that is balanced for 4,000
/// K.
pub(crate) fn black_body(kelvin: f64) -> [f64; 3] {
    let (own, white) = (unbalanced(kelvin), unbalanced(LAMP_WHITE_KELVIN));
    let rgb: [f64; 3] = std::array::from_fn(|k| own[k] / white[k]);
    let luminance = luminance(rgb);
    rgb.map(|v| v / luminance)
}

/// Linear RGB of a black body: the cubic fit of the Planckian locus of Kim et al. (2002), 1,667 to
/// 25,000 K; redder ones are taken for its end.
fn unbalanced(kelvin: f64) -> [f64; 3] {
    let t = kelvin.clamp(1_667.0, 25_000.0);
    let cubic = |[a, b, c, d]: [f64; 4], v: f64| ((a * v + b) * v + c) * v + d;
    let x = if t <= 4_000.0 {
        cubic([-0.266_123_9e9, -0.234_358_9e6, 0.877_695_6e3, 0.179_910], 1.0 / t)
    } else {
        cubic([-3.025_846_9e9, 2.107_037_9e6, 0.222_634_7e3, 0.240_390], 1.0 / t)
    };
    let y = if t <= 2_222.0 {
        cubic([-1.106_381_4, -1.348_110_2, 2.185_558_32, -0.202_196_83], x)
    } else if t <= 4_000.0 {
        cubic([-0.954_947_6, -1.374_185_93, 2.091_370_15, -0.167_488_67], x)
    } else {
        cubic([3.081_758, -5.873_386_7, 3.751_129_97, -0.370_014_83], x)
    };
    let xyz = [x / y, 1.0, (1.0 - x - y) / y];
    // To the primaries of sRGB (IEC 61966-2-1).
    let rows = [
        [3.240_97, -1.537_383, -0.498_611],
        [-0.969_244, 1.875_968, 0.041_555],
        [0.055_63, -0.203_977, 1.056_972],
    ];
    rows.map(|row| dot(row, xyz).max(0.01))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_bodies_go_from_orange_over_white_to_blue() {
        let white = black_body(LAMP_WHITE_KELVIN);
        assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-9));
        let [r, g, b] = black_body(2_000.0);
        assert!(r > 1.4 && g < 1.0 && b < 0.4, "{r} {g} {b}");
        let [r, _, b] = black_body(8_000.0);
        assert!(r < 0.9 && b > 1.3, "{r} {b}");
        // Published: a black body of 6,500 K has the chromaticity 0.3135, 0.3237 (Wyszecki and
        // Stiles).
        for (own, known) in unbalanced(6_500.0).into_iter().zip([1.0427, 0.9839, 1.0346]) {
            assert!((own / known - 1.0).abs() < 2e-3, "{own}, {known}");
        }
    }

    /// A flat lamp of 5,000 lm, 6 m high: 1,592 cd down, 44 lx under it.
    #[test]
    fn the_level_of_a_lamp_is_that_of_the_ground_under_it() {
        let lamp = Lamp { aim: Some([0.0, 0.0, -2.0]), ..Lamp::new([0.0, 0.0, 6.0]) };
        let lights = LampLights::of(&[lamp], &[], 1.0);
        let level = lights.level([0.0, 0.0, 1.0], 0.0, 1.0);
        let straight = 5_000.0 / PI / 36.0;
        assert!((level / (straight / 3.0) - 1.0).abs() < 1e-3, "{level}");
        // By a sum over rings of ground.
        let (mut square, mut sum) = (0.0, 0.0);
        for ring in 0..200_000 {
            let r = (f64::from(ring) + 0.5) * 1e-3;
            let cos = 6.0 / r.hypot(6.0);
            let e = straight * cos.powi(4);
            (square, sum) = (square + e * e * r, sum + e * r);
        }
        assert!((level / (square / sum) - 1.0).abs() < 1e-2, "{level} {}", square / sum);
        // In another unit of length the same.
        let half = LampLights::of(&[Lamp { at: [0.0, 0.0, 3.0], ..lamp }], &[], 2.0);
        assert!((half.level([0.0, 0.0, 1.0], 0.0, 2.0) / level - 1.0).abs() < 1e-6);
    }

    #[test]
    fn ground_returns_a_fifth_of_what_falls_on_it() {
        let lamp = Lamp { aim: Some([0.0, 0.0, -1.0]), ..Lamp::new([0.0, 0.0, 6.0]) };
        let light = LampLight::of_lamp(&lamp);
        let ground = light.ground_under(6.0, DVec3::Z, 1.0).unwrap();
        // The flux of a matt surface is pi times its intensity along the normal.
        let flux = PI * luminance(ground.intensity.map(f64::from));
        assert!((flux / 1_000.0 - 1.0).abs() < 1e-3, "{flux}");
        assert!((ground.at[2] - 0.3).abs() < 1e-6);
        assert_eq!(light.ground_under(50.0, DVec3::Z, 1.0), None);
    }
}
