//! A splat that is a piece of a surface.

use glam::{DMat3, DQuat, DVec3};
use wm_scene::Group;
use wm_scene::splats::{Splat, logit};

/// A splat on a surface: at a place, with standard deviations along the surface and across it
/// (world, scene units).
pub(crate) fn surfel(
    at: [f64; 3],
    normal: DVec3,
    up: DVec3,
    scales: [f64; 3],
    rgb: [f32; 3],
    opacity: f64,
) -> Splat {
    Splat {
        mean: at.map(|v| v as f32),
        quat: facing(normal, up),
        log_scale: scales.map(|scale| scale.ln() as f32),
        logit_opacity: logit(opacity) as f32,
        rgb,
        group: Group::Snow,
    }
}

/// The turn of a splat whose third axis is `normal`, and whose first lies level.
fn facing(normal: DVec3, up: DVec3) -> [f32; 4] {
    let first = up.cross(normal);
    let first = if first.length() > 1e-6 { first.normalize() } else { normal.any_orthonormal_vector() };
    let turn = DQuat::from_mat3(&DMat3::from_cols(first, normal.cross(first), normal));
    [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32)
}
