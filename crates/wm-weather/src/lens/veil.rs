//! Dirt on the glass, and the veil of bright sources, on a coarse grid over the picture.

use super::geometry::GlassView;
use super::glass::Glass;
use super::wide::WideView;
use crate::linear_picture::{between, halved, mix};
use crate::wetness::between_corners;
use rayon::prelude::*;
use wm_base::random::bits;
use wm_render::Frame;
use wm_scene::Camera;

/// Rings at which the veil is looked up: from 1 degree on, each twice as far as the one before.
const RING_COUNT: usize = 5;
/// Radius of the first ring, degrees: the middle of 1 to 2.
const FIRST_RING_DEGREES: f64 = std::f64::consts::SQRT_2;
/// Directions of a ring.
const RING_DIRECTIONS: usize = 12;
/// Radius of a ring, cells of its own grid.
const RING_RADIUS_CELLS: f64 = 2.5;
/// Share of light that each ring scatters: the integral of `10 / angle^2` a degree over an octave
/// of angles.
const RING_SCATTER_SHARE: f64 = 20.0 * std::f64::consts::PI * std::f64::consts::LN_2 / (180.0 * 180.0)
    * std::f64::consts::PI
    * std::f64::consts::PI;
/// Part of the last ring that is within 30 degrees.
const LAST_RING_SHARE: f64 = 0.907;
/// Sizes of the patches of dirt, m, and their weights.
const DIRT_PATCHES: [(f64, f64); 3] = [(0.03, 0.45), (0.009, 0.35), (0.003, 0.2)];
/// Cone of the light that dirt scatters.
const SCATTER_CONE_RAD: f32 = 0.5;

/// Light that is kept and light that is added, linear, on a grid over the picture.
pub(super) struct Haze {
    cell: usize,
    width: usize,
    height: usize,
    /// Red, green, blue that are added, and the share that is kept.
    nodes: Vec<[f32; 4]>,
}

impl Haze {
    /// Computes the veil of a glass before a finished picture; `None` if it adds nothing.
    pub(crate) fn new(
        glass: &Glass,
        view: &GlassView,
        camera: &Camera,
        picture: &Frame,
        wide: &WideView,
    ) -> Option<Self> {
        if glass.dirt <= 0.0 && glass.veil <= 0.0 {
            return None;
        }
        let focal = (camera.fx * camera.fy).sqrt();
        let cell = ((FIRST_RING_DEGREES.to_radians() * focal / RING_RADIUS_CELLS) as usize).clamp(2, 32);
        let (width, height) =
            ((camera.width as usize).div_ceil(cell), (camera.height as usize).div_ceil(cell));
        let mut haze = Self { cell, width, height, nodes: vec![[0.0, 0.0, 0.0, 1.0]; width * height] };
        if glass.dirt > 0.0 {
            haze.add_dirt(glass, view, camera, wide);
        }
        if glass.veil > 0.0 {
            let (columns, light) = light_of_cells(picture, cell, width);
            let veil = veil(columns, light);
            for (node, veil) in haze.nodes.iter_mut().zip(veil) {
                (0..3).for_each(|k| node[k] += glass.veil as f32 * veil[k]);
            }
        }
        Some(haze)
    }

    fn add_dirt(&mut self, glass: &Glass, view: &GlassView, camera: &Camera, wide: &WideView) {
        let (cell, width) = (self.cell, self.width);
        self.nodes.par_chunks_mut(width).enumerate().for_each(|(row, nodes)| {
            for (column, node) in nodes.iter_mut().enumerate() {
                let [x, y] = [column, row].map(|v| (v as f64 + 0.5) * cell as f64);
                let at = view.point(x, y);
                let mut sum = 0.5;
                for (i, (size, weight)) in DIRT_PATCHES.into_iter().enumerate() {
                    // The aperture blurs what is finer.
                    if size > 1.5 * glass.aperture {
                        sum += weight * (noise(glass.seed ^ i as u64, at.map(|v| v / size)) - 0.5);
                    }
                }
                let cover = (2.0 * glass.dirt * sum * sum * 1.7).clamp(0.0, 1.0) as f32;
                let way = [(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0].map(|v| v as f32);
                let light = wide.at(way, SCATTER_CONE_RAD);
                let scatter = cover * glass.dirt_scatter as f32;
                (0..3).for_each(|k| node[k] += scatter * light[k]);
                node[3] *= 1.0 - cover * (1.0 - glass.dirt_transmittance as f32);
            }
        });
    }

    /// Writes what is added and kept along a row of the picture, a number for each column.
    pub(crate) fn row(&self, y: usize, line: &mut Vec<[f32; 4]>) {
        let (top, below, part) = cells_about(y, self.cell, self.height);
        let [top, below] = [top, below].map(|row| &self.nodes[row * self.width..][..self.width]);
        line.clear();
        line.extend(top.iter().zip(below).map(|(a, b)| mix(a, b, part)));
    }

    /// Veil at a column, from the line that [`Self::row`] wrote.
    #[inline(always)]
    pub(crate) fn column(&self, line: &[[f32; 4]], x: usize) -> [f32; 4] {
        let (left, right, part) = cells_about(x, self.cell, self.width);
        mix(&line[left], &line[right], part)
    }
}

/// The cells around the middle of a pixel, and its place between their middles.
#[inline(always)]
fn cells_about(x: usize, cell: usize, count: usize) -> (usize, usize, f32) {
    let at = ((x as f32 + 0.5) / cell as f32 - 0.5).clamp(0.0, (count - 1) as f32);
    let first = at as usize;
    (first, (first + 1).min(count - 1), at - first as f32)
}

/// Even noise between nodes at whole numbers, 0-1.
fn noise(seed: u64, at: [f64; 2]) -> f64 {
    between_corners(
        at,
        |v| v * v * (3.0 - 2.0 * v),
        |key| bits(seed ^ 0x6469_7274, key) as f64 / 2f64.powi(64),
    )
}

/// Mean light of the cells of a picture, linear.
fn light_of_cells(picture: &Frame, cell: usize, width: usize) -> (usize, Vec<[f32; 3]>) {
    let across = picture.width as usize;
    let rows: Vec<Vec<[f32; 3]>> = picture
        .rgb
        .par_chunks(3 * across * cell)
        .map(|band| {
            let mut sums = vec![[0.0f32; 3]; width];
            for line in band.chunks(3 * across) {
                for (sum, pixels) in sums.iter_mut().zip(line.chunks(3 * cell)) {
                    for pixel in pixels.as_chunks::<3>().0 {
                        // Squares are near enough to linear light to add up, and far faster.
                        (0..3).for_each(|k| sum[k] += pixel[k] * pixel[k]);
                    }
                }
            }
            let rows = band.len() / (3 * across);
            for (x, sum) in sums.iter_mut().enumerate() {
                let count = rows * cell.min(across - x * cell);
                *sum = sum.map(|v| (v / count as f32).powf(1.1));
            }
            sums
        })
        .collect();
    (width, rows.concat())
}

/// The veil over each cell of a picture by the light of all, from rings about it on ever coarser
/// grids.
fn veil(width: usize, light: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let mut levels = vec![(width, light)];
    while levels.len() < RING_COUNT {
        let (width, last) = &levels[levels.len() - 1];
        levels.push(halved(*width, last));
    }
    let ring: Vec<[f64; 2]> = (0..RING_DIRECTIONS)
        .map(|k| std::f64::consts::TAU * (k as f64 + 0.5) / RING_DIRECTIONS as f64)
        .map(|angle| [RING_RADIUS_CELLS * angle.cos(), RING_RADIUS_CELLS * angle.sin()])
        .collect();
    let mut sum: Option<(usize, Vec<[f32; 3]>)> = None;
    for (level, (width, light)) in levels.iter().enumerate().rev() {
        let size = [*width, light.len() / width];
        let weight = RING_SCATTER_SHARE * if level + 1 == RING_COUNT { LAST_RING_SHARE } else { 1.0 }
            / RING_DIRECTIONS as f64;
        let mut own = vec![[0.0f32; 3]; light.len()];
        own.par_chunks_mut(*width).enumerate().for_each(|(y, line)| {
            for (x, out) in line.iter_mut().enumerate() {
                for [dx, dy] in &ring {
                    let seen = look_up(light, size, x as f64 + dx, y as f64 + dy);
                    (0..3).for_each(|k| out[k] += weight as f32 * seen[k]);
                }
                if let Some((coarse_width, coarse)) = &sum {
                    let coarse_size = [*coarse_width, coarse.len() / coarse_width];
                    let at = |v: usize| 0.5 * v as f64 - 0.25;
                    let seen = look_up(coarse, coarse_size, at(x), at(y));
                    (0..3).for_each(|k| out[k] += seen[k]);
                }
            }
        });
        sum = Some((*width, own));
    }
    sum.map(|(_, veil)| veil).unwrap_or_default()
}

/// Mixes the cells about a point; beyond the edge the last cells go on.
#[inline(always)]
fn look_up(light: &[[f32; 3]], size: [usize; 2], x: f64, y: f64) -> [f32; 3] {
    let last = size.map(|count| (count - 1) as f64);
    let (x, y) = (x.clamp(0.0, last[0]), y.clamp(0.0, last[1]));
    let (left, top) = (x as usize, y as usize);
    between(light, size, [left, top], [x - left as f64, y - top as f64].map(|part| part as f32))
}
