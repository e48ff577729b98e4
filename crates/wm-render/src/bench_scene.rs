//! A scene of any size for measuring speed: made of numbers, and as hard as a trained one.

use glam::DVec3;
use wm_base::random::uniform;
use wm_scene::{Camera, Group, Splats, splats::logit};

/// A scene like a trained one of any size: flat splats on surfaces all round the origin, 2 to 40
/// units away, about `cover` of them over each direction, opacities many and few, sizes log-normal.
/// About a tenth is in the view of [`shell_camera`].
#[must_use]
pub fn shell_splats(count: usize, cover: f64, sh_degree: u8, seed: u64) -> Splats {
    let mut splats = Splats::with_capacity(count, sh_degree);
    // Solid angle of the ring, shared out among the splats; 2.6 standard deviations count as their
    // rim.
    let side = (cover * 7.1 / count as f64 / std::f64::consts::PI).sqrt() / 2.6;
    for i in 0..count as u64 {
        let u = |k: u64| uniform(seed, i * 64 + k);
        let normal = |k: u64| (-2.0 * u(k).max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * u(k + 1)).cos();
        let (azimuth, elevation) = (u(0) * std::f64::consts::TAU, (u(1) - 0.5) * 1.2);
        let distance = 2.0 * 20f64.powf(u(2));
        let (sin, cos) = azimuth.sin_cos();
        let direction = [cos * elevation.cos(), sin * elevation.cos(), elevation.sin()];
        let size = side * distance * (0.45 * normal(3)).exp();
        let stretch = (0.4 * normal(5)).exp();
        let opacity = if u(7) < 0.45 { 0.03 + 0.3 * u(8) } else { 0.35 + 0.64 * u(8) };
        splats.means.push(direction.map(|v| (v * distance) as f32));
        splats.log_scales.push([size * stretch, size / stretch, 0.15 * size].map(|v| v.ln() as f32));
        splats.quats.push([9, 11, 13, 15].map(|k| normal(k) as f32));
        splats.logit_opacities.push(logit(opacity) as f32);
        splats.sh.extend((0..splats.sh_stride() as u64).map(|k| {
            let size = if k < 3 { 3.4 } else { 0.2 };
            ((u(17 + k % 46) - 0.5) * size) as f32
        }));
        splats.groups.push(Group::Scene);
    }
    splats
}

/// The camera for [`shell_splats`]: at the origin, along x.
///
/// # Panics
/// Never for a size that a picture can have.
#[must_use]
pub fn shell_camera(width: u32, height: u32) -> Camera {
    let focal = 0.9 * f64::from(width);
    let camera = Camera::looking((width, height), 50.0, DVec3::ZERO, DVec3::X, DVec3::Z).expect("a camera");
    Camera { fx: focal, fy: focal, ..camera }
}
