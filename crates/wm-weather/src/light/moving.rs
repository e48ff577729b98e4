//! Light that changes from frame to frame: headlamps of the camera's own car, flashes of lightning,
//! and the shadows of clouds that drift.

use super::clouds::CloudShadows;
use super::flash::FlashLight;
use super::headlamps::Headlamps;
use glam::Vec3;

/// The light of one frame.
#[derive(Clone, Debug, Default)]
pub struct MovingLight {
    /// The headlamps.
    pub headlamps: Option<Headlamps>,
    /// Lightning.
    pub(crate) flash: Option<FlashLight>,
    /// Shadows of clouds on the beam of the sun.
    pub(crate) clouds: Option<CloudShadows>,
}

impl MovingLight {
    /// Returns true if it changes nothing.
    pub(crate) fn is_nothing(&self) -> bool {
        self.headlamps.is_none() && self.flash.is_none() && self.clouds.is_none()
    }

    /// The change of a splat's gain, by channel.
    #[inline]
    pub(super) fn change(&self, splat: &MovingSplat) -> [f32; 3] {
        let (point, normal) = (Vec3::from_array(splat.point), splat.normal());
        let mut light = Vec3::ZERO;
        if let Some(headlamps) = &self.headlamps {
            light += headlamps.irradiance(point, normal);
        }
        if let Some(flash) = &self.flash {
            light += flash.irradiance(normal, f32::from(splat.open) / 255.0);
        }
        let mut change = (light * Vec3::from_array(splat.per_unit)).to_array();
        if let Some(clouds) = &self.clouds {
            let shade = 1.0 - clouds.open(point);
            (0..3).for_each(|k| change[k] -= shade * splat.beam[k]);
        }
        change
    }
}

/// A splat that such light acts on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MovingSplat {
    point: [f32; 3],
    /// Times 127; zero of leaves.
    normal: [i8; 3],
    open: u8,
    /// Gain by an irradiance of 1, by channel.
    per_unit: [f32; 3],
    /// The part of its gain that is the sun's beam.
    beam: [f32; 3],
}

impl MovingSplat {
    /// `per_unit` is the gain by an irradiance of 1, and `beam` the irradiance by the sun's.
    pub(super) fn new(point: [f32; 3], normal: Vec3, open: f64, per_unit: [f64; 3], beam: [f64; 3]) -> Self {
        Self {
            point,
            normal: normal.to_array().map(|v| (127.0 * v).round() as i8),
            open: (255.0 * open).round() as u8,
            per_unit: per_unit.map(|v| v as f32),
            beam: std::array::from_fn(|k| (per_unit[k] * beam[k]) as f32),
        }
    }

    /// Length 1; zero of leaves.
    fn normal(&self) -> Vec3 {
        Vec3::from_array(self.normal.map(|v| f32::from(v) / 127.0)).normalize_or_zero()
    }
}
