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
/// Pixels from node to node along which rays are followed.
pub(super) const NODES: usize = 4;
/// Slopes that do not move, rms along one axis, above which water is a film in which no wave runs.
pub(super) const FILM: f32 = 0.1;

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
    /// True if all of it is a film on rough ground, in which nothing is mirrored sharply.
    pub is_film: bool,
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
        let ray = |x: usize, y: usize| -> [f64; 3] {
            let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
            std::array::from_fn(|k| right[k] * x + down[k] * y + corner[k])
        };
        let size = (camera.width as usize, camera.height as usize);
        let mut found = match map.is_endless() {
            true => Self::of_plane(eye[2] - high, ray, (size, camera.near)),
            false => Self::of_ground(map, (eye, typical), ray, (size, camera.near)),
        };
        let wet = |y: usize| found.depth[y * size.0..(y + 1) * size.0].iter().any(|z| !z.is_nan());
        let first = (0..size.1).find(|y| wet(*y))?;
        let last = (0..size.1).rev().find(|y| wet(*y))?;
        found.rows = first as u32..last as u32 + 1;
        if map.is_endless() {
            found.level = high;
        }
        Some(found)
    }

    /// A level surface, `below` metres below the eye.
    fn of_plane(
        below: f64,
        ray: impl Fn(usize, usize) -> [f64; 3] + Sync,
        ((width, height), near): ((usize, usize), f64),
    ) -> Self {
        let mut depth = vec![f32::NAN; width * height];
        depth.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, depth) in row.iter_mut().enumerate() {
                let fall = -ray(x, y)[2];
                let z = below / fall;
                if fall > 0.0 && z > near {
                    *depth = z.min(FARTHEST) as f32;
                }
            }
        });
        Self { depth, ..Self::default() }
    }

    /// The water on ground that is not level. Rays are followed at nodes every few pixels; between four that meet the ground its
    /// reciprocal depth is interpolated, which is exact on planes.
    fn of_ground(
        map: &WaterMap,
        (eye, typical): ([f64; 3], f64),
        ray: impl Fn(usize, usize) -> [f64; 3] + Sync,
        ((width, height), near): ((usize, usize), f64),
    ) -> Self {
        let follow = |x: usize, y: usize| hit(map, eye, ray(x, y), typical).filter(|(z, _)| *z > near);
        let (columns, rows) = (width.div_ceil(NODES) + 1, height.div_ceil(NODES) + 1);
        let place = |node: usize, size: usize| (node * NODES).min(size - 1);
        // Reciprocal depth, 0 where the ground is not met; and the level of water, NaN where there is none.
        let mut nodes = vec![(0.0, f32::NAN); columns * rows];
        nodes.par_chunks_mut(columns).enumerate().for_each(|(row, nodes)| {
            for (column, node) in nodes.iter_mut().enumerate() {
                if let Some((z, sample)) = follow(place(column, width), place(row, height)) {
                    let level = if sample.cover > 0.0 { sample.level as f32 } else { f32::NAN };
                    *node = (1.0 / z, level);
                }
            }
        });
        let mut depth = vec![f32::NAN; width * height];
        let (mut cover, mut roughness) = (vec![0.0; width * height], vec![0.0; width * height]);
        let lines = depth.par_chunks_mut(width).zip(cover.par_chunks_mut(width));
        lines.zip(roughness.par_chunks_mut(width)).enumerate().for_each(
            |(y, ((depth, cover), roughness))| {
                let (row, down) = (y / NODES, (y % NODES) as f64 / NODES as f64);
                let [upper, lower] = [row, row + 1].map(|row| &nodes[row * columns..(row + 1) * columns]);
                for x in 0..width {
                    let (column, right) = (x / NODES, (x % NODES) as f64 / NODES as f64);
                    let corners = [upper[column], upper[column + 1], lower[column], lower[column + 1]];
                    let [a, b, c, d] = corners.map(|(inverse, _)| inverse);
                    // Nodes at the last pixels are nearer to each other.
                    let is_whole = (column + 1) * NODES < width && (row + 1) * NODES < height;
                    let met = if is_whole && a * b * c * d > 0.0 {
                        let (above, below) = (a + right * (b - a), c + right * (d - c));
                        let z = 1.0 / (above + down * (below - above));
                        let way = ray(x, y);
                        map.at(eye[0] + z * way[0], eye[1] + z * way[1]).map(|sample| (z, sample))
                    } else if is_whole && corners.iter().all(|(inverse, _)| *inverse == 0.0) {
                        None
                    } else {
                        follow(x, y)
                    };
                    if let Some((z, sample)) = met.filter(|(_, sample)| sample.cover > 0.0) {
                        depth[x] = z.min(FARTHEST) as f32;
                        cover[x] = sample.cover;
                        roughness[x] = sample.roughness;
                    }
                }
            },
        );
        let mut levels: Vec<f32> = nodes.iter().map(|(_, level)| *level).filter(|v| !v.is_nan()).collect();
        let middle = levels.len() / 2;
        let level = match levels.is_empty() {
            true => typical,
            false => f64::from(*levels.select_nth_unstable_by(middle, f32::total_cmp).1),
        };
        let mut seen = depth.iter().zip(&roughness).filter(|(z, _)| !z.is_nan());
        let is_film = seen.all(|(_, roughness)| *roughness > FILM);
        Self { depth, cover, roughness, level, rows: 0..0, is_film }
    }
}

/// The point at which a ray meets the ground: its view z, scene units, and the water there, which may hide nothing. `ray` is a view z of 1, in
/// metres along level axes; the search begins at the height `typical`.
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
    found.filter(|(z, sample)| (eye[2] + z * ray[2] - sample.level).abs() < MISSED)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
