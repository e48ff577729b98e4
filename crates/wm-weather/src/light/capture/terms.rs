//! The sun of a capture, and the terms by which its light falls on a surface.

use crate::level::dot;
use crate::light::irradiance::{SceneLight, SkyGradation, SurfaceLight};
use crate::light::openness;
use crate::optics::Site;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Cosine of the sun's incidence on leaves, which turn to all sides.
const LEAF_INCIDENCE: f64 = 0.5;
/// Least height of the sun that casts shadows by which the light is split, as a sine: 3 degrees.
pub(super) const LOWEST_SUN: f64 = 0.05;

/// The sun of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureSun {
    /// Towards it, world axes, length 1.
    pub direction: [f64; 3],
    /// Irradiance of a surface that faces it, over that of level ground under the whole sky, by
    /// channel.
    pub(crate) ratio: [f64; 3],
    /// The share of the surfaces that look at it which see it.
    pub(crate) lit: f64,
    /// Contrast left across shadow edges after the split, of that before, 0-1.
    pub(crate) contrast_left: f64,
}

/// Sums over all surfaces, so that their mean irradiance under any light is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct MeanSurface {
    pub(super) even: f64,
    pub(super) rising: f64,
    pub(super) sun: f64,
}

impl MeanSurface {
    /// Computes the mean over surfaces, of which there is at least one.
    pub(super) fn new(surfaces: impl Iterator<Item = SurfaceLight>) -> Self {
        let unit = [1.0, 0.0, 0.0];
        let light = |sun: [f64; 3], level, rise| SceneLight { sun, sky: SkyGradation { level, rise } };
        let zero = [0.0; 3];
        let (mut sum, mut count) = (Self::default(), 0.0f64);
        for surface in surfaces {
            sum.even += surface.direct(&light(zero, unit, zero))[0];
            sum.rising += surface.direct(&light(zero, zero, unit))[0];
            sum.sun += surface.direct(&light(unit, zero, zero))[0];
            count += 1.0;
        }
        let count = count.max(1.0);
        Self { even: sum.even / count, rising: sum.rising / count, sun: sum.sun / count }
    }

    /// The irradiance of the mean surface under a light.
    pub(super) fn under(&self, light: &SceneLight) -> [f64; 3] {
        std::array::from_fn(|k| {
            self.even * light.sky.level[k] + self.rising * light.sky.rise[k] + self.sun * light.sun[k]
        })
    }
}

/// The geometry of a surface in the light of a sun.
pub(super) fn surface_of(
    normal: Vec3,
    open: [f32; 2],
    seen: f32,
    up: Vec3,
    sun: Option<[f64; 3]>,
) -> SurfaceLight {
    let base = openness::under_sky(normal, open, up);
    let Some(sun) = sun else { return base };
    let facing = f64::from(normal.dot(Vec3::from_array(sun.map(|v| v as f32))));
    let incidence = if normal == Vec3::ZERO { LEAF_INCIDENCE } else { facing.max(0.0) };
    SurfaceLight { incidence, sun: f64::from(seen), ..base }
}

/// The captured light: white on level ground in the open, since cameras balance white for what they
/// see.
pub(super) fn captured_light(sun: Option<&CaptureSun>, site: &Site) -> SceneLight {
    let Some(sun) = sun else {
        return SceneLight { sun: [0.0; 3], sky: SkyGradation::overcast([1.0; 3]) };
    };
    let sin = dot(sun.direction, site.up).max(LOWEST_SUN);
    let sky = sun.ratio.map(|ratio| 1.0 / (1.0 + ratio * sin));
    SceneLight { sun: std::array::from_fn(|k| sky[k] * sun.ratio[k]), sky: SkyGradation::even(sky) }
}
