//! The sky: a gradient, a glow around the sun and broken clouds, linear radiance.
//!
//! Units are the place's own: the tone curve's exposure turns them into display values.

use super::hash::{octaves2, smoothstep};
use super::paint::rgb;
use glam::{DVec2, DVec3};

/// Towards the sun: from the right and a little behind somebody who walks along +y, 47 degrees high.
pub(super) fn sun() -> DVec3 {
    DVec3::new(0.60, -0.33, 0.73).normalize()
}

/// Irradiance of a surface that faces the sun.
pub(super) const SUN: DVec3 = DVec3::new(4.75, 4.25, 3.45);

/// Sky radiance without clouds; what light gathered from the sky uses, for it is smooth.
pub(super) fn clear(direction: DVec3) -> DVec3 {
    let (horizon, middle, zenith) =
        (DVec3::new(0.92, 0.95, 0.97), DVec3::new(0.42, 0.60, 0.86), DVec3::new(0.20, 0.36, 0.68));
    let height = direction.z.max(0.0);
    let low = (-height * 6.5).exp();
    let base = middle.lerp(zenith, smoothstep(0.1, 1.0, height)).lerp(horizon, low);
    let toward = direction.dot(sun()).max(0.0);
    let glow = 0.22 * toward.powi(6) + 0.9 * toward.powi(60);
    base + DVec3::new(1.0, 0.93, 0.80) * glow
}

/// Sky radiance with clouds, `seed` shaping them. Below the horizon it stays that of the horizon.
pub(super) fn radiance(direction: DVec3, seed: u32) -> DVec3 {
    let clear = clear(direction);
    if direction.z <= 0.0 {
        return clear;
    }
    // A cloud deck seen from below, bent down to the horizon.
    let flat = DVec2::new(direction.x, direction.y) / (direction.z + 0.13);
    let cover = density(flat, seed);
    let amount = smoothstep(0.02, 0.42, cover) * smoothstep(0.015, 0.14, direction.z);
    if amount <= 0.0 {
        return clear;
    }
    let to_sun = DVec2::new(sun().x, sun().y).normalize();
    let lit = smoothstep(-0.25, 0.35, cover - density(flat + to_sun * 0.22, seed) + 0.1);
    let (shade, bright) = (DVec3::new(0.62, 0.67, 0.74), DVec3::new(1.22, 1.19, 1.13));
    let cloud = shade.lerp(bright, (0.25 + 0.75 * lit) * (1.0 - 0.35 * smoothstep(0.3, 0.8, cover)));
    // Far clouds drown in the haze of the horizon.
    let cloud = cloud.lerp(rgb(0xF4F4F2) * 1.02, (-direction.z * 9.0).exp());
    clear.lerp(cloud, amount * 0.92)
}

fn density(flat: DVec2, seed: u32) -> f64 {
    let p = flat * DVec2::new(0.8, 1.0) + DVec2::new(3.1, 1.7);
    let warp =
        DVec2::new(octaves2(p * 0.9, 1.0, 2, 0.01, seed ^ 11), octaves2(p * 0.9, 1.0, 2, 0.01, seed ^ 23));
    octaves2(p + warp * 0.35, 1.7, 5, 0.02, seed) + 0.02
}
