//! The light of a place, and the irradiance of its surfaces.
//!
//! The sky's radiance goes linearly with the sine of the elevation `z`, `L = level + rise z`: exact
//! for an even sky and for the CIE's overcast one. A plane at the angle `b` to the level receives
//! of it, where nothing stands in the way,
//!
//! `level pi (1 + cos b) / 2 + rise (2/3) (sin b + (pi - b) cos b)`,
//!
//! of which a surface gets the two shares of [`SurfaceLight::open`]. What it does not see of the
//! sky are other surfaces; they return a quarter of their mean irradiance. To that comes the sun,
//! if it sees it.

use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use wm_base::color::luminance;

/// Share of the light that surfaces return, on average.
const MEAN_REFLECTANCE: f64 = 0.25;
/// Cosine of the sun's incidence on what faces it by half.
const HALF_FACING_COSINE: f64 = 0.5;

/// Radiance of a sky by the sine of the elevation, linear RGB: `level + rise z`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SkyGradation {
    /// At the horizon.
    pub(crate) level: [f64; 3],
    /// The excess of the zenith over that.
    pub(crate) rise: [f64; 3],
}

impl SkyGradation {
    /// A sky of even radiance, with this irradiance on level ground.
    pub(crate) fn even(irradiance: [f64; 3]) -> Self {
        Self { level: irradiance.map(|v| v / PI), rise: [0.0; 3] }
    }

    /// The CIE's overcast sky, `L = Z (1 + 2 z) / 3`, with this irradiance on level ground:
    /// `(7 pi / 9) Z`.
    pub(crate) fn overcast(irradiance: [f64; 3]) -> Self {
        let third = irradiance.map(|v| 3.0 * v / (7.0 * PI));
        Self { level: third, rise: third.map(|v| 2.0 * v) }
    }

    /// Irradiance of level ground in the open.
    pub(crate) fn irradiance(&self) -> [f64; 3] {
        std::array::from_fn(|k| PI * self.level[k] + 2.0 * PI / 3.0 * self.rise[k])
    }

    /// The sum of a share of one sky and the rest of another.
    pub(crate) fn mixed(&self, other: &Self, share: f64) -> Self {
        let mix = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share);
        Self { level: mix(self.level, other.level), rise: mix(self.rise, other.rise) }
    }
}

/// The light over a place. Its unit is free: only ratios count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneLight {
    /// Irradiance of a surface that faces the sun, linear RGB; 0 for none.
    pub(crate) sun: [f64; 3],
    /// The sky.
    pub(crate) sky: SkyGradation,
}

impl SceneLight {
    /// Irradiance of level ground in the open with the sun at this sine of elevation.
    pub(crate) fn irradiance(&self, sin_sun: f64) -> [f64; 3] {
        let sky = self.sky.irradiance();
        std::array::from_fn(|k| sky[k] + self.sun[k] * sin_sun.max(0.0))
    }

    /// Irradiance of level ground, in the tint of surfaces that face the sun by half, or under a
    /// high sun of the ground itself. It is for places whose parts are not told apart: a low sun
    /// lights little ground, but much of what a picture shows.
    pub(crate) fn irradiance_as_seen(&self, sin_sun: f64) -> [f64; 3] {
        let level = self.irradiance(sin_sun);
        let facing = self.irradiance(sin_sun.max(HALF_FACING_COSINE));
        let scale = luminance(level) / luminance(facing).max(f64::MIN_POSITIVE);
        facing.map(|v| v * scale)
    }

    /// Multiplies the light by a factor.
    pub(crate) fn times(&self, factor: f64) -> Self {
        let scaled = |v: [f64; 3]| v.map(|v| v * factor);
        let sky = SkyGradation { level: scaled(self.sky.level), rise: scaled(self.sky.rise) };
        Self { sun: scaled(self.sun), sky }
    }
}

/// The geometry of the light on a small surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLight {
    /// Cosine of the angle between its normal and up.
    pub(crate) upright: f64,
    /// The shares that it gets of the light of an even sky, and of one that is as bright as the
    /// sine of the elevation.
    pub(crate) open: [f64; 2],
    /// Cosine of the sun's incidence, 0 or more.
    pub(crate) incidence: f64,
    /// The share of the sun that it sees.
    pub(crate) sun: f64,
}

impl SurfaceLight {
    /// The share of the whole view that is sky, weighted with the cosine.
    fn sky_view(&self) -> f64 {
        self.open[0] * 0.5 * (1.0 + self.upright)
    }

    /// Irradiance without what other surfaces return, linear RGB.
    pub(crate) fn direct(&self, light: &SceneLight) -> [f64; 3] {
        let angle = self.upright.clamp(-1.0, 1.0).acos();
        let even = self.open[0] * 0.5 * PI * (1.0 + self.upright);
        let rising = self.open[1] * (2.0 / 3.0) * (angle.sin() + (PI - angle) * self.upright);
        let sun = self.incidence * self.sun;
        std::array::from_fn(|k| light.sun[k] * sun + light.sky.level[k] * even + light.sky.rise[k] * rising)
    }

    /// Irradiance, where the surfaces of the place have the mean `mean` of [`Self::direct`].
    #[must_use]
    pub fn irradiance(&self, light: &SceneLight, mean: [f64; 3]) -> [f64; 3] {
        let (direct, returned) = (self.direct(light), self.returned());
        std::array::from_fn(|k| direct[k] + returned * mean[k])
    }

    /// The share of the mean irradiance of other surfaces that they return to this one.
    pub(crate) fn returned(&self) -> f64 {
        MEAN_REFLECTANCE * (1.0 - self.sky_view())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(upright: f64) -> SurfaceLight {
        SurfaceLight { upright, open: [1.0; 2], incidence: 0.0, sun: 0.0 }
    }

    /// Published: an upright plane under the CIE's overcast sky gets 0.396 of the light of a level
    /// one.
    #[test]
    fn planes_under_the_overcast_sky_get_the_published_shares() {
        let sky = SkyGradation::overcast([1.0; 3]);
        assert!((sky.irradiance()[1] - 1.0).abs() < 1e-12);
        let light = SceneLight { sun: [0.0; 3], sky };
        assert!((board(1.0).direct(&light)[0] - 1.0).abs() < 1e-12);
        assert!((board(0.0).direct(&light)[0] - 0.396).abs() < 5e-4);
        assert!(board(-1.0).direct(&light)[0].abs() < 1e-12);
    }

    /// The closed form against a sum over directions, for tilted planes.
    #[test]
    fn tilted_planes_get_what_a_sum_over_the_sky_gives() {
        let light = SceneLight { sun: [0.0; 3], sky: SkyGradation { level: [0.7; 3], rise: [0.4; 3] } };
        for tilt in [0.3f64, 0.9, 1.4, 2.0, 2.8] {
            let (rows, columns, mut sum) = (400, 400, 0.0);
            for row in 0..rows {
                let z = (f64::from(row) + 0.5) / f64::from(rows);
                for column in 0..columns {
                    let turn = 2.0 * PI * (f64::from(column) + 0.5) / f64::from(columns);
                    let facing = (1.0 - z * z).sqrt() * turn.cos() * tilt.sin() + z * tilt.cos();
                    sum += facing.max(0.0) * (0.7 + 0.4 * z);
                }
            }
            let sum = sum * 2.0 * PI / f64::from(rows * columns);
            let got = board(tilt.cos()).direct(&light)[2];
            assert!((got - sum).abs() < 1e-3, "{tilt}: {got}, want {sum}");
        }
    }

    /// A low sun tints a place as its lit walls, and changes nothing in how bright it is.
    #[test]
    fn the_light_as_seen_has_the_tint_of_what_faces_the_sun() {
        let light = SceneLight { sun: [3.0, 2.0, 0.8], sky: SkyGradation::even([0.2, 0.3, 0.5]) };
        let [level, seen] = [light.irradiance(0.1), light.irradiance_as_seen(0.1)];
        assert!((luminance(level) - luminance(seen)).abs() < 1e-12);
        assert!(seen[0] / seen[2] > 1.5 * level[0] / level[2], "{level:?} {seen:?}");
        assert_eq!(light.irradiance(0.8), light.irradiance_as_seen(0.8));
    }

    #[test]
    fn a_surface_without_sky_gets_a_quarter_of_the_mean() {
        let hidden = SurfaceLight { open: [0.0; 2], ..board(1.0) };
        let light = SceneLight { sun: [1.0; 3], sky: SkyGradation::even([1.0; 3]) };
        assert_eq!(hidden.irradiance(&light, [2.0; 3]), [0.5; 3]);
    }
}
