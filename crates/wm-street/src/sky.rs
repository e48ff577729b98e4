//! The sky: a gradient, a glow around the sun and broken clouds, linear radiance.
//!
//! Units are the place's own: the tone curve's exposure turns them into display values.

use super::hash::{octaves2, smoothstep};
use glam::{DVec2, DVec3};

/// Towards the sun: from the right and a little behind somebody who walks along +y, 47 degrees
/// high.
pub(super) fn sun() -> DVec3 {
    DVec3::new(0.60, -0.33, 0.73).normalize()
}

/// The time at which the sun stands there for places near 52 degrees north, 5 degrees east: 30 May
/// 2024, 8:56 UTC, seconds since 1970.
pub(super) const SUN_TIME_S: i64 = 1_717_059_360;

/// Irradiance of a surface that faces the sun.
const SUN_IRRADIANCE: DVec3 = DVec3::new(4.30, 3.95, 3.30);
/// Zenith radiance of the overcast sky: level ground is 0.3 EV darker than in the sun, as a camera
/// that follows the light would have it.
const OVERCAST_ZENITH_RADIANCE: DVec3 = DVec3::new(1.73, 1.77, 1.84);

/// The light of a built-in place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lighting {
    /// A summer sun with broken clouds.
    #[default]
    Sunny,
    /// The CIE's overcast sky, `L = Z (1 + 2 sin g) / 3`, without a sun: the truth that relit
    /// pictures are compared with.
    Overcast,
}

impl Lighting {
    /// Irradiance of a surface that faces the sun.
    pub(super) fn sun(self) -> DVec3 {
        match self {
            Self::Sunny => SUN_IRRADIANCE,
            Self::Overcast => DVec3::ZERO,
        }
    }

    /// Mean radiance of the sky; what light gathered from it uses, for it is smooth.
    pub(super) fn smooth(self, direction: DVec3) -> DVec3 {
        match self {
            Self::Sunny => smooth(direction),
            Self::Overcast => overcast(direction),
        }
    }

    /// Radiance of the sky, with clouds of `seed` where there are some.
    pub(super) fn radiance(self, direction: DVec3, seed: u32) -> DVec3 {
        match self {
            Self::Sunny => radiance(direction, seed),
            Self::Overcast => overcast(direction),
        }
    }
}

fn overcast(direction: DVec3) -> DVec3 {
    OVERCAST_ZENITH_RADIANCE * ((1.0 + 2.0 * direction.z.max(0.0)) / 3.0)
}

/// Sky radiance without clouds.
fn clear(direction: DVec3) -> DVec3 {
    let (horizon, middle, zenith) =
        (DVec3::new(1.02, 1.03, 1.02), DVec3::new(0.56, 0.72, 0.93), DVec3::new(0.27, 0.44, 0.74));
    let height = direction.z.max(0.0);
    let low = (-height * 5.0).exp();
    let base = middle.lerp(zenith, smoothstep(0.1, 1.0, height)).lerp(horizon, low);
    let toward = direction.dot(sun()).max(0.0);
    let glow = 0.22 * toward.powi(6) + 0.9 * toward.powi(60);
    base + DVec3::new(1.0, 0.93, 0.80) * glow
}

/// Mean sky radiance, a third of it clouds.
fn smooth(direction: DVec3) -> DVec3 {
    clear(direction).lerp(DVec3::new(0.98, 0.98, 0.97), 0.38)
}

/// Sky radiance with clouds, `seed` shaping them. Below the horizon it is constant.
fn radiance(direction: DVec3, seed: u32) -> DVec3 {
    let clear = clear(direction);
    if direction.z <= 0.0 {
        return clear;
    }
    // A cloud deck seen from below, bent down to the horizon.
    let flat = DVec2::new(direction.x, direction.y) / (direction.z + 0.17);
    let cover = density(flat, 6, seed);
    let amount = smoothstep(0.0, 0.24, cover) * smoothstep(0.0, 0.10, direction.z);
    if amount <= 0.0 {
        return clear;
    }
    // The side towards the sun is bright, thick middles are grey.
    let to_sun = DVec2::new(sun().x, sun().y).normalize();
    let lit = smoothstep(-0.16, 0.20, cover - density(flat + to_sun * 0.16, 4, seed));
    let (shade, bright) = (DVec3::new(0.70, 0.74, 0.80), DVec3::new(1.30, 1.27, 1.21));
    let thick = smoothstep(0.15, 0.60, cover);
    let cloud = shade.lerp(bright, (0.30 + 0.70 * lit) * (1.0 - 0.45 * thick));
    // Far clouds drown in the haze of the horizon.
    let cloud = cloud.lerp(DVec3::splat(1.03), (-direction.z * 8.0).exp());
    clear.lerp(cloud, amount * 0.94)
}

/// The density of the clouds over a point of the deck: lumps, warped, gathered into fields.
fn density(flat: DVec2, octaves: u32, seed: u32) -> f64 {
    let p = flat * DVec2::new(0.85, 1.15) + DVec2::new(3.1, 1.7);
    let warp = DVec2::new(octaves2(p, 0.9, 2, 0.01, seed ^ 11), octaves2(p, 0.9, 2, 0.01, seed ^ 23));
    let field = octaves2(p, 2.6, 2, 0.02, seed ^ 5);
    let (mut lumps, mut weight, mut size) = (0.0, 0.5, 1.0);
    for octave in 0..octaves {
        let value = super::hash::noise2((p + warp * 0.30) / size, seed ^ (77 * (octave + 1)));
        lumps += weight * (0.55 - 1.6 * value * value.abs().sqrt()).min(value + 0.6);
        weight *= 0.52;
        size *= 0.48;
    }
    0.62 * field + 0.50 * lumps + 0.06
}
