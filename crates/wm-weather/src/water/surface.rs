//! The water that a camera sees: where each pixel's ray meets it.

use super::map::WaterMap;
use rayon::prelude::*;
use std::ops::Range;
use wm_scene::Camera;

/// Largest view z of a surface, scene units: beyond it waves and mirrors are the horizon's.
const FARTHEST: f64 = 1e6;
/// Least height of the eye over a puddle, m.
const ABOVE: f64 = 0.05;
/// Height by which a ray misses the water at the last of its steps, m, from which on it met none.
const MISSED: f64 = 0.05;
/// Steps by which a ray finds the level of the place that it hits.
const STEPS: usize = 6;

/// The water in one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaterSurface {
    /// View z of the surface at each pixel, scene units, `[H, W]`; NaN where there is none.
    pub depth: Vec<f32>,
    /// Share of what lies behind that the water hides, 0-1, `[H, W]`; empty if it is 1 everywhere.
    pub cover: Vec<f32>,
    /// Slopes that do not move, rms along one axis, `[H, W]`; empty if they are 0 everywhere.
    pub roughness: Vec<f32>,
    /// Rows that hold water.
    pub rows: Range<u32>,
    /// Height of most of the water along up from the world's origin, m: that of the mirror.
    pub level: f64,
}

impl WaterSurface {
    /// The water of a map in a camera's picture; `None` if the picture shows none, or the eye is not above it.
    #[must_use]
    pub fn of(map: &WaterMap, camera: &Camera) -> Option<Self> {
        let metres = map.metres_per_unit;
        let eye = map.axes.map(|axis| metres * dot(axis, camera.center().to_array()));
        let [low, high] = map.heights()?;
        let typical = map.typical_height(eye[2]).unwrap_or(high);
        // Puddles above the eye are not seen.
        let high = map.plane().unwrap_or_else(|| high.min(eye[2] - ABOVE));
        if eye[2] <= high || eye[2] <= low {
            return None;
        }
        let world_from_camera = camera.rotation().transpose();
        let (right, down) = (world_from_camera.x_axis / camera.fx, world_from_camera.y_axis / camera.fy);
        let corner = world_from_camera.z_axis - right * camera.cx - down * camera.cy;
        let along = |axis: glam::DVec3| map.axes.map(|level| metres * dot(level, axis.to_array()));
        let (right, down, corner) = (along(right), along(down), along(corner));
        let (width, is_flat) = (camera.width as usize, map.is_endless());
        let pixels = width * camera.height as usize;
        let mut depth = vec![f32::NAN; pixels];
        let mut others = if is_flat { Vec::new() } else { vec![[0.0f32; 3]; pixels] };
        let ray = |x: usize, y: usize| -> [f64; 3] {
            let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
            std::array::from_fn(|k| right[k] * x + down[k] * y + corner[k])
        };
        if is_flat {
            depth.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (x, depth) in row.iter_mut().enumerate() {
                    let fall = -ray(x, y)[2];
                    let z = (eye[2] - high) / fall;
                    if fall > 0.0 && z > camera.near {
                        *depth = z.min(FARTHEST) as f32;
                    }
                }
            });
        } else {
            depth.par_chunks_mut(width).zip(others.par_chunks_mut(width)).enumerate().for_each(
                |(y, (row, others))| {
                    for (x, (depth, other)) in row.iter_mut().zip(others).enumerate() {
                        if let Some((z, sample)) = hit(map, eye, ray(x, y), typical)
                            && z > camera.near
                        {
                            *depth = z.min(FARTHEST) as f32;
                            *other = [sample.cover, sample.roughness, sample.level as f32];
                        }
                    }
                },
            );
        }
        let wet = |y: usize| depth[y * width..(y + 1) * width].iter().any(|z| !z.is_nan());
        let first = (0..camera.height as usize).find(|y| wet(*y))?;
        let last = (0..camera.height as usize).rev().find(|y| wet(*y))?;
        let level = if is_flat { high } else { most_seen(&depth, &others) };
        let column = |k: usize| others.iter().map(|other| other[k]).collect();
        Some(Self {
            depth,
            cover: column(0),
            roughness: column(1),
            rows: first as u32..last as u32 + 1,
            level,
        })
    }
}

/// The level that most pixels show, m.
fn most_seen(depth: &[f32], others: &[[f32; 3]]) -> f64 {
    let mut levels: Vec<f32> =
        depth.iter().zip(others).filter(|(z, _)| !z.is_nan()).map(|(_, other)| other[2]).collect();
    let middle = levels.len() / 2;
    f64::from(*levels.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// The point at which a ray meets water: its view z, scene units, and the water there. `ray` is a view z of 1, in metres along level axes; the search
/// begins at the height `typical`.
fn hit(map: &WaterMap, eye: [f64; 3], ray: [f64; 3], typical: f64) -> Option<(f64, super::map::WaterSample)> {
    if ray[2] >= 0.0 {
        return None;
    }
    let mut level = typical;
    let mut found = None;
    for _ in 0..STEPS {
        let z = (eye[2] - level) / -ray[2];
        let sample = map.at(eye[0] + z * ray[0], eye[1] + z * ray[1])?;
        found = Some((z, sample));
        if (sample.level - level).abs() < 1e-4 {
            break;
        }
        level = sample.level;
    }
    found.filter(|(z, sample)| sample.cover > 0.0 && (eye[2] + z * ray[2] - sample.level).abs() < MISSED)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
