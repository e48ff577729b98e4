//! The water that a camera sees: where each pixel's ray meets it.

use super::map::{WaterMap, WaterSample, WaterView};
use crate::level::dot;
use rayon::prelude::*;
use std::ops::Range;
use wm_scene::Camera;

/// Largest view z of a surface, scene units: beyond it waves and mirrors are the horizon's.
const MAX_VIEW_Z: f64 = 1e6;
/// Least height of the eye over a puddle, m.
const MIN_EYE_HEIGHT_M: f64 = 0.05;
/// Height by which a ray misses the water at the last of its steps, m, from which it met none.
const MAX_MISS_M: f64 = 0.05;
/// Steps by which a ray finds the level of the place that it hits, and its error at which it has
/// found it, m.
const MAX_RAY_STEP_COUNT: usize = 12;
const LEVEL_ERROR_M: f64 = 1e-4;
/// Pixels from node to node along which rays are followed.
pub(super) const NODE_SPACING_PX: usize = 4;
/// Steps of the water's grid between nodes of the picture, and differences of cover and of
/// roughness, up to which both are interpolated between nodes too.
const MAX_GRID_STEPS: f32 = 1.0;
const MAX_LOOK_DIFFERENCE: [f32; 2] = [0.02, 0.01];
/// Difference of the levels of nodes from which there is a step between them, m, and how much more
/// that is a metre of their distance.
const LEVEL_STEP_LIMITS: [f32; 2] = [0.02, 0.08];
/// Weight of a film in the level of the mirror, of which it shows nothing sharply, over that of
/// still water.
const MIN_FILM_WEIGHT: f32 = 0.02;
/// Slopes that do not move, rms along one axis, above which nothing in the mirror has an edge.
const BLURRING_SLOPE_RMS: f32 = 0.1;
/// Slopes that do not move, rms along one axis, above which water is a film in which no wave runs.
pub(super) const FILM_SLOPE_RMS: f32 = 0.03;

/// The water in one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaterSurface {
    /// View z of the surface at each pixel, scene units, `[H, W]`; NaN where there is none.
    pub depth: Vec<f32>,
    /// Share of what lies behind that the water hides, 0-1, `[H, W]`; empty if it is 1 everywhere.
    pub cover: Vec<f32>,
    /// Slopes that do not move, rms along one axis, `[H, W]`; empty if they are 0 everywhere.
    pub(crate) roughness: Vec<f32>,
    /// Rows that hold water.
    pub(crate) rows: Range<u32>,
    /// Height of most of the water along up from the world's origin, m: that of the mirror.
    pub(crate) level: f64,
    /// Least of the slopes that do not move, rms along one axis: 0 where water stands.
    stillest: f32,
}

impl WaterSurface {
    /// Returns true if all of it is a film on rough ground, in which nothing is mirrored sharply.
    pub(crate) fn is_film(&self) -> bool {
        self.stillest > BLURRING_SLOPE_RMS
    }

    /// Returns true if all of it is a film, rough enough to blur what it mirrors.
    #[must_use]
    pub fn is_blurred(&self) -> bool {
        self.stillest > FILM_SLOPE_RMS
    }

    /// The water of a map in a camera's picture; `None` if the picture shows none, or the eye is
    /// not above it.
    #[must_use]
    pub fn of(map: &WaterMap, camera: &Camera) -> Option<Self> {
        let metres = map.metres_per_unit;
        let eye = map.axes.map(|axis| metres * dot(axis, camera.center().to_array()));
        let [low, high] = map.heights()?;
        let typical = map.typical_height(eye[2]).unwrap_or(high);
        // Puddles above the eye are not seen.
        let high = map.plane().unwrap_or_else(|| high.min(eye[2] - MIN_EYE_HEIGHT_M));
        if eye[2] <= high || eye[2] <= low {
            return None;
        }
        let [right, down, corner] = ray_axes(map, camera);
        let ray = |x: usize, y: usize| -> [f64; 3] {
            let (x, y) = (x as f64 + 0.5, y as f64 + 0.5);
            std::array::from_fn(|k| right[k] * x + down[k] * y + corner[k])
        };
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut found = match map.is_endless() {
            true => Self::of_plane(eye[2] - high, ray, width, height),
            false => Self::of_ground(map, eye, typical, ray, width, height),
        };
        let wet = |y: &usize| found.depth[y * width..(y + 1) * width].iter().any(|z| !z.is_nan());
        let first = (0..height).find(wet)?;
        let last = (0..height).rev().find(wet)?;
        found.rows = first as u32..last as u32 + 1;
        if map.is_endless() {
            found.level = high;
        }
        Some(found)
    }

    /// A level surface, `below` metres below the eye. The camera's near plane does not cut water:
    /// it may lie closer.
    fn of_plane(
        below: f64,
        ray: impl Fn(usize, usize) -> [f64; 3] + Sync,
        width: usize,
        height: usize,
    ) -> Self {
        let mut depth = vec![f32::NAN; width * height];
        depth.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            // Along a row in single precision: what is left of the fall is as exact as a ray in it.
            let (start, next) = (ray(0, y)[2], ray(1, y)[2]);
            let (start, step) = (-start as f32, (start - next) as f32);
            let below = below as f32;
            for (x, depth) in row.iter_mut().enumerate() {
                let fall = start + step * x as f32;
                let z = below / fall;
                *depth = if fall > 0.0 { z.min(MAX_VIEW_Z as f32) } else { f32::NAN };
            }
        });
        Self { depth, ..Self::default() }
    }

    /// The water on ground that is not level. Rays are followed at nodes every few pixels; between
    /// four that meet the ground its reciprocal depth is interpolated, which is exact on planes.
    fn of_ground(
        map: &WaterMap,
        eye: [f64; 3],
        typical: f64,
        ray: impl Fn(usize, usize) -> [f64; 3] + Sync,
        width: usize,
        height: usize,
    ) -> Self {
        let view = WaterView::new(map, [eye[0], eye[1]]);
        // Next to a pixel the ground is about as high.
        let follow = |x: usize, y: usize, level: f64| hit(&view, eye[2], ray(x, y), level);
        let (columns, rows) = (width.div_ceil(NODE_SPACING_PX) + 1, height.div_ceil(NODE_SPACING_PX) + 1);
        let place = |node: usize, size: usize| (node * NODE_SPACING_PX).min(size - 1);
        let mut nodes = vec![Node::default(); columns * rows];
        nodes.par_chunks_mut(columns).enumerate().for_each(|(row, nodes)| {
            let mut level = typical;
            for (column, node) in nodes.iter_mut().enumerate() {
                let (x, y) = (place(column, width), place(row, height));
                let found = follow(x, y, level);
                level = found.map_or(typical, |(_, sample)| sample.level);
                if let Some((z, sample)) = found {
                    let ray = ray(x, y);
                    *node = Node {
                        inverse: 1.0 / z,
                        place: [ray[0] as f32 * z, ray[1] as f32 * z],
                        level: sample.level as f32,
                        look: [sample.cover, sample.roughness],
                    };
                }
            }
        });
        let mut depth = vec![f32::NAN; width * height];
        let (mut cover, mut roughness) = (vec![0.0; width * height], vec![0.0; width * height]);
        let band = NODE_SPACING_PX * width;
        let bands = depth.par_chunks_mut(band).zip(cover.par_chunks_mut(band));
        bands.zip(roughness.par_chunks_mut(band)).enumerate().for_each(
            |(row, ((depth, cover), roughness))| {
                let [upper, lower] = [row, row + 1].map(|row| &nodes[row * columns..(row + 1) * columns]);
                let top = row * NODE_SPACING_PX;
                // Rays of the rows: their starts, and their change along them.
                let step = [ray(0, 0), ray(1, 0)];
                let step: [f32; 2] = std::array::from_fn(|k| (step[1][k] - step[0][k]) as f32);
                let starts: [[f32; 2]; NODE_SPACING_PX] = std::array::from_fn(|y| {
                    let ray = ray(0, top + y);
                    [ray[0] as f32, ray[1] as f32]
                });
                for column in 0..columns - 1 {
                    let left = column * NODE_SPACING_PX;
                    let corners = [upper[column], upper[column + 1], lower[column], lower[column + 1]];
                    // Nodes at the last pixels are nearer to each other.
                    let is_whole = left + NODE_SPACING_PX < width && top + NODE_SPACING_PX < height;
                    let mut met = 0;
                    for node in &corners {
                        met += usize::from(node.inverse > 0.0);
                    }
                    if is_whole && met == 0 {
                        continue;
                    }
                    let start =
                        if upper[column].inverse > 0.0 { upper[column].level.into() } else { typical };
                    let is_ground = is_whole && met == corners.len() && Node::are_plane(&corners);
                    let is_even = is_ground && Node::are_even(&corners, &view);
                    for y in 0..depth.len() / width {
                        let down = y as f32 / NODE_SPACING_PX as f32;
                        let own = y * width + left..y * width + (left + NODE_SPACING_PX).min(width);
                        let (depth, cover) = (&mut depth[own.clone()], &mut cover[own.clone()]);
                        let roughness = &mut roughness[own];
                        let [a, b, c, d] = corners;
                        let inverse = between([a.inverse, b.inverse, c.inverse, d.inverse], down);
                        if is_even {
                            let covers = between([a.look[0], b.look[0], c.look[0], d.look[0]], down);
                            let rough = between([a.look[1], b.look[1], c.look[1], d.look[1]], down);
                            for i in 0..NODE_SPACING_PX {
                                let z = (1.0 / inverse[i]).min(MAX_VIEW_Z as f32);
                                let is_wet = covers[i] > 0.0;
                                depth[i] = if is_wet { z } else { f32::NAN };
                                (cover[i], roughness[i]) = (covers[i], rough[i]);
                            }
                            continue;
                        }
                        for i in 0..depth.len() {
                            let x = left + i;
                            let found = if is_ground {
                                let z = 1.0 / inverse[i];
                                let along = (starts[y][0] + step[0] * x as f32) * z;
                                let aside = (starts[y][1] + step[1] * x as f32) * z;
                                view.at(along, aside).map(|sample| (z, sample))
                            } else {
                                follow(x, top + y, start)
                            };
                            if let Some((z, sample)) = found
                                && sample.cover > 0.0
                            {
                                depth[i] = z.min(MAX_VIEW_Z as f32);
                                (cover[i], roughness[i]) = (sample.cover, sample.roughness);
                            }
                        }
                    }
                }
            },
        );
        // The mirror is that of most of the water in which something is seen.
        let weight = |[cover, roughness]: [f32; 2]| {
            cover * (1.0 - roughness * (1.0 / FILM_SLOPE_RMS)).max(MIN_FILM_WEIGHT)
        };
        let wet = nodes.iter().filter(|node| node.inverse > 0.0 && node.look[0] > 0.0);
        let level = weighted_median(wet.map(|node| (node.level, weight(node.look))).collect());
        let level = level.map_or(typical, f64::from);
        let seen = depth.iter().zip(&roughness).filter(|(z, _)| !z.is_nan()).map(|(_, roughness)| *roughness);
        let stillest = seen.fold(f32::INFINITY, f32::min);
        Self { depth, cover, roughness, level, rows: 0..0, stillest }
    }
}

/// The rays of pixels, level axes, m: x times the first axis, y times the second, and the third.
pub(super) fn ray_axes(map: &WaterMap, camera: &Camera) -> [[f64; 3]; 3] {
    let world_from_camera = camera.rotation().transpose();
    let (right, down) = (world_from_camera.x_axis / camera.fx, world_from_camera.y_axis / camera.fy);
    let corner = world_from_camera.z_axis - right * camera.cx - down * camera.cy;
    let along = |axis: [f64; 3]| map.axes.map(|level| map.metres_per_unit * dot(level, axis));
    [right, down, corner].map(|axis| along(axis.to_array()))
}

/// The number below which half of the weight is; `None` of nothing.
fn weighted_median(mut all: Vec<(f32, f32)>) -> Option<f32> {
    all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * all.iter().map(|(_, weight)| f64::from(*weight)).sum::<f64>();
    let mut below = 0.0;
    let middle = all.iter().find(|(_, weight)| {
        below += f64::from(*weight);
        below >= half
    });
    middle.map(|(level, _)| *level)
}

/// Numbers at the pixels of a row between four nodes, which is so much of their distance below the
/// upper ones.
#[inline(always)]
fn between(corners: [f32; 4], down: f32) -> [f32; NODE_SPACING_PX] {
    let [a, b, c, d] = corners;
    let (left, right) = (a + down * (c - a), b + down * (d - b));
    let step = (right - left) * (1.0 / NODE_SPACING_PX as f32);
    [left, left + step, left + 2.0 * step, left + 3.0 * step]
}

/// The ground at a pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    /// Reciprocal of the view z at which it is met; 0 where it is not.
    inverse: f32,
    /// The place there, metres along the level axes from the eye.
    place: [f32; 2],
    /// Height of the water, m.
    level: f32,
    /// Cover and roughness.
    look: [f32; 2],
}

impl Node {
    /// Returns true if there is no step of the ground, such as a kerb, between nodes.
    fn are_plane(corners: &[Self; 4]) -> bool {
        let [a, b, c, d] = corners;
        let apart = |k: usize| spread([a.place[k], b.place[k], c.place[k], d.place[k]]);
        spread([a.level, b.level, c.level, d.level])
            < LEVEL_STEP_LIMITS[0] + LEVEL_STEP_LIMITS[1] * (apart(0) + apart(1))
    }

    /// Returns true if the water between nodes is told by theirs.
    fn are_even(corners: &[Self; 4], view: &WaterView<'_>) -> bool {
        let [a, b, c, d] = corners;
        let mut is_even = true;
        for k in 0..2 {
            is_even &= spread([a.look[k], b.look[k], c.look[k], d.look[k]]) < MAX_LOOK_DIFFERENCE[k];
            is_even &=
                view.steps_in(spread([a.place[k], b.place[k], c.place[k], d.place[k]])) < MAX_GRID_STEPS;
        }
        is_even
    }
}

/// The difference of the greatest and the least of four numbers.
#[inline(always)]
fn spread(corners: [f32; 4]) -> f32 {
    let [a, b, c, d] = corners;
    a.max(b).max(c.max(d)) - a.min(b).min(c.min(d))
}

/// The point at which a ray meets the ground: its view z, scene units, and the water there, which
/// may hide nothing. `ray` is a view z of 1, in metres along level axes from an eye of height
/// `eye`; the search begins at the height `start`.
fn hit(view: &WaterView<'_>, eye: f64, ray: [f64; 3], start: f64) -> Option<(f32, WaterSample)> {
    if ray[2] >= 0.0 {
        return None;
    }
    let [x, y] = [ray[0] as f32, ray[1] as f32];
    let fall = -1.0 / ray[2];
    let mut level = start;
    let mut found = None;
    // The ray is over the water at one of two heights, and under it at the other, each with how
    // far.
    let (mut over, mut under) = (None, None);
    for step in 0..MAX_RAY_STEP_COUNT {
        let z = ((eye - level) * fall) as f32;
        let sample = view.at(z * x, z * y)?;
        found = Some((z, sample));
        let gap = sample.level - level;
        if gap.abs() < LEVEL_ERROR_M {
            break;
        }
        *(if gap < 0.0 { &mut over } else { &mut under }) = Some((level, gap));
        level = match (over, under) {
            // Where the ground is steeper than the ray, going to its height leads away from where
            // they meet: between is by turns the middle, and where the line through both meets it.
            (Some((high, above)), Some((low, below))) if step % 2 == 0 => {
                low + (high - low) * below / (below - above)
            }
            (Some((high, _)), Some((low, _))) => 0.5 * (low + high),
            _ => sample.level.min(eye - MIN_EYE_HEIGHT_M),
        };
    }
    found.filter(|(z, sample)| (eye + f64::from(*z) * ray[2] - sample.level).abs() < MAX_MISS_M)
}
