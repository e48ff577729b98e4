//! Snow as splats: flat, opaque, on the snow's own surface.

use super::ground::Ground;
use super::settle::EDGE;
use crate::particles::random::Draws;
use glam::{DMat3, DQuat, DVec3};
use wm_scene::color::srgb_encode;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Group, Splats};

/// Depth below which the ground shows between flakes, m.
const DUSTING: f32 = 0.006;
/// Standard deviation of a surfel across, in cells, and through, m.
const WIDTH: f64 = 0.62;
const THICKNESS: f64 = 0.004;
/// Opacity of a surfel of deep snow.
const OPAQUE: f64 = 0.985;
/// Least depth that is drawn, m.
const LEAST: f32 = 0.000_5;
/// How far above the ground it is drawn where it covers it, m.
const LIFT: f64 = 0.012;
/// Unevenness of the surface, m and as a slope, at most.
const ROUGH: f64 = 0.004;
const TILT: f64 = 0.06;

/// What lies, as it is lit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matter {
    /// Linear RGB of it in the open.
    pub color: [f64; 3],
    /// The same where nothing but the sky shines on it.
    pub shade: [f64; 3],
}

/// How much of the ground a depth covers, 0-1.
#[must_use]
pub fn coverage(depth: f32) -> f32 {
    1.0 - (-depth.max(0.0) / DUSTING).exp()
}

/// The surface of what lies: height of its top at each node, m; smoother than the ground the deeper it is.
#[must_use]
pub fn surface(ground: &Ground, depth: &[f32]) -> Vec<f32> {
    let mut top: Vec<f32> = ground.height.iter().zip(depth).map(|(height, depth)| height + depth).collect();
    for _ in 0..2 {
        let mut next = top.clone();
        for (node, next) in next.iter_mut().enumerate() {
            if depth[node] <= LEAST {
                continue;
            }
            // Never below the ground, and level only as far as there is snow to level.
            let [level] = ground.mean_about(node, |other| (depth[other] > LEAST).then(|| [top[other]]));
            *next = level.clamp(top[node] - 0.5 * depth[node], top[node] + 0.5 * depth[node]);
        }
        top = next;
    }
    top
}

/// Adds the splats of what lies on a ground: its depth and the height of its top at each node, m.
pub fn add(
    ground: &Ground,
    (depth, top): (&[f32], &[f32]),
    metres_per_unit: f64,
    matter: &Matter,
    splats: &mut Splats,
) {
    let axes = ground.places.axes().map(DVec3::from_array);
    let cell = f64::from(ground.cell);
    for node in 0..depth.len() {
        if depth[node] <= LEAST || !top[node].is_finite() || ground.is_elsewhere(node) {
            continue;
        }
        let [column, row] = ground.place(node);
        let level = |dx: i64, dy: i64| {
            let other = ground.level_with(node, column + dx, row + dy, EDGE);
            other.filter(|other| depth[*other] > LEAST).map(|other| f64::from(top[other]))
        };
        let here = f64::from(top[node]);
        let slope = |low: Option<f64>, high: Option<f64>| match (low, high) {
            (Some(low), Some(high)) => (high - low) / (2.0 * cell),
            (Some(low), None) => (here - low) / cell,
            (None, Some(high)) => (high - here) / cell,
            (None, None) => 0.0,
        };
        let mut draws = Draws::new(node as u64 ^ 0x5e0f_0000_0000);
        let mut off = |most: f64| most * (2.0 * draws.uniform() - 1.0);
        let dx = slope(level(-1, 0), level(1, 0)).clamp(-1.7, 1.7) + off(TILT);
        let dy = slope(level(0, -1), level(0, 1)).clamp(-1.7, 1.7) + off(TILT);
        let (place, lift) = ([column as f64 + 0.5 + off(0.2), row as f64 + 0.5 + off(0.2)], off(ROUGH));
        // Splats are rough: what covers the ground must be above what they show of it.
        let lift = lift.min(f64::from(depth[node]) * 0.3) + LIFT * f64::from(coverage(depth[node]));
        let normal = (axes[2] - axes[0] * dx - axes[1] * dy).normalize();
        let shade = f64::from(ground.shade[node]) * (0.7 + 0.3 * normal.dot(axes[2]));
        let color: [f64; 3] =
            std::array::from_fn(|k| matter.shade[k] + (matter.color[k] - matter.shade[k]) * shade);
        let speckle = 1.0 + off(0.025);
        let rgb = color.map(|v| srgb_encode((v * speckle).max(0.0)) as f32);
        let unit = |metres: f64| ((metres / metres_per_unit).ln()) as f32;
        let cover = f64::from(coverage(depth[node]));
        let mut put = |at: [f64; 3], normal: DVec3, scales: [f64; 3], rgb: [f32; 3], opacity: f64| {
            splats.push(&Splat {
                mean: at.map(|v| v as f32),
                quat: facing(normal, axes[2]),
                log_scale: scales.map(unit),
                logit_opacity: logit(opacity) as f32,
                rgb,
                group: Group::Snow,
            });
        };
        let wide = WIDTH * cell * (1.0 + dx * dx + dy * dy).sqrt().min(1.6);
        put(ground.places.point(place, here + lift), normal, [wide, wide, THICKNESS], rgb, OPAQUE * cover);
        // The sides of deep snow, where its surface ends.
        let own = f64::from(depth[node]);
        if own < 0.5 * cell {
            continue;
        }
        for (x, y) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
            // Beyond the grid's end it goes on.
            let goes_on = ground.node(0, column + x, row + y).is_none_or(|other| ground.is_elsewhere(other));
            if goes_on || level(x, y).is_some_and(|other| here - other < 0.7 * own) {
                continue;
            }
            let outward = axes[0] * x as f64 + axes[1] * y as f64;
            let edge = [column as f64 + 0.5 + 0.4 * x as f64, row as f64 + 0.5 + 0.4 * y as f64];
            let side = color.map(|v| srgb_encode(0.93 * v) as f32);
            let at = ground.places.point(edge, here - 0.45 * own);
            put(at, outward, [WIDTH * cell, 0.4 * own, THICKNESS], side, OPAQUE * cover);
        }
    }
}

/// The turn of a splat whose third axis is `normal`, and whose first lies level.
fn facing(normal: DVec3, up: DVec3) -> [f32; 4] {
    let first = up.cross(normal);
    let first = if first.length() > 1e-6 { first.normalize() } else { normal.any_orthonormal_vector() };
    let turn = DQuat::from_mat3(&DMat3::from_cols(first, normal.cross(first), normal));
    [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32)
}

/// How lit each node is, 0 in the shade to 1 in the open: by the sky that it sees, and by how bright the scene is about it
/// beside what is as open.
pub(super) fn shades(ground: &Ground) -> Vec<f32> {
    // Of some metre about each node, so that what is painted dark is not taken for shade.
    let mut light = ground.light.clone();
    for _ in 0..6 {
        let mut next = light.clone();
        for (node, next) in next.iter_mut().enumerate() {
            [*next] = ground.mean_about(node, |other| (!light[other].is_nan()).then(|| [light[other]]));
        }
        light = next;
    }
    let mut known: Vec<f32> = light
        .iter()
        .zip(&ground.open)
        .filter(|(v, open)| !v.is_nan() && **open > 0.9)
        .map(|(v, _)| *v)
        .collect();
    known.sort_by(f32::total_cmp);
    let bright = known.get(known.len() * 3 / 5).copied().unwrap_or(1.0).max(1e-3);
    let shade = |(light, open): (&f32, &f32)| {
        let scene = if light.is_nan() { 1.0 } else { (light / bright).clamp(0.0, 1.0).powf(0.35) };
        scene * (0.35 + 0.65 * open)
    };
    light.iter().zip(&ground.open).map(shade).collect()
}
