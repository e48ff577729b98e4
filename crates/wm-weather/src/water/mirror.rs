//! The scene from the eye that a water plane mirrors.

use super::map::WaterMap;
use super::surface::WaterSurface;
use super::tile::{Kept, Whole, bilinear, fineness};
use crate::linear_picture::LinearPicture;
use fearless_simd::{SimdBase, SimdFloat, f32x4};
use rayon::prelude::*;
use wm_render::simd::{Lanes, SimdPath, log2};
use wm_render::{CutPlane, Frame, dispatch};
use wm_scene::Camera;

/// Picture beyond the sides of the view that waves look into, as a share of its height.
const MARGIN: f64 = 0.06;
/// Splats whose centre is no higher above the water than this are not mirrored, m: those of a waterline are on both sides.
const WATERLINE: f64 = 0.01;
/// Width of a box over that of a pixel of a halved picture with the same variance: binomial weights reach farther.
const SMOOTH: f32 = 0.58;

/// A camera at the mirrored eye.
///
/// A mirrored picture is no picture of any camera: left and right change places. So a proper camera draws it the wrong way
/// round, and look-ups count its columns from the right. Points of the world are projected with it as with any other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorView {
    /// The camera, at half size; at a quarter where only films mirror.
    pub camera: Camera,
    /// The water plane: nothing below it is mirrored.
    pub cut: CutPlane,
}

impl MirrorView {
    /// The mirrored view of the water in a camera's picture.
    #[must_use]
    pub fn new(map: &WaterMap, surface: &WaterSurface, camera: &Camera) -> Self {
        let up = glam::DVec3::from_array(map.axes[2]);
        let height = surface.level / map.metres_per_unit;
        // p -> p - 2 (up . p - height) up, then x -> -x in the view, so that it is a rotation again.
        let turned = |v: glam::DVec3| v - 2.0 * up.dot(v) * up;
        let rotation = camera.rotation();
        let [x, y, z] = [0, 1, 2].map(|k| turned(rotation.row(k)));
        let rotation = glam::DMat3::from_cols(-x, y, z).transpose();
        let eye = camera.center();
        let eye = eye - 2.0 * (up.dot(eye) - height) * up;
        let margin = (MARGIN * f64::from(camera.height)).ceil();
        let (first, last) = (f64::from(surface.rows.start) - margin, f64::from(surface.rows.end) + margin);
        let (width, rows) = (f64::from(camera.width) + 2.0 * margin, last - first);
        let whole = Camera {
            width: width as u32,
            height: rows as u32,
            cx: f64::from(camera.width) - camera.cx + margin,
            cy: camera.cy - first,
            viewmat: Camera::posed((1, 1), 50.0, eye, rotation).viewmat,
            ..*camera
        };
        let finer = if surface.is_film { 4 } else { 2 };
        let small = whole.resized(whole.width.div_ceil(finer), whole.height.div_ceil(finer));
        let cut = CutPlane { normal: map.axes[2], height: height + WATERLINE / map.metres_per_unit };
        Self { camera: small, cut }
    }
}

/// A mirrored picture in linear light at every fineness, with the reciprocal of its depth.
///
/// Each row ends with its last pixel once more, and each level with its last row, so that look-ups need no edges.
#[derive(Clone, Debug, Default)]
pub struct MirroredPicture {
    /// Width and height of the finest level, px.
    size: [f32; 2],
    /// First pixel and length of a row of each level, finest first.
    levels: Vec<(usize, usize)>,
    /// Red, green, blue, and the reciprocal of the view z.
    pixels: Vec<[f32; 4]>,
    /// The last of these of the finest level.
    inverse: Vec<f32>,
}

impl MirroredPicture {
    /// Makes all levels of a drawn picture with depth. What is brighter than `white`, linear, counts as that.
    #[must_use]
    pub fn new(path: SimdPath, frame: &Frame, white: f32) -> Self {
        let mut last = LinearPicture::of(path, frame);
        for (pixel, (depth, alpha)) in last.pixels.iter_mut().zip(frame.depth.iter().zip(&frame.alpha)) {
            (0..3).for_each(|k| pixel[k] = pixel[k].min(white));
            // Sky shines through where splats are thin: it is as far as what is seen of it.
            pixel[3] = if *depth > 0.0 { alpha / depth } else { 0.0 };
        }
        let size = [last.width as f32, last.height as f32];
        let (mut levels, mut pixels) = (Vec::new(), Vec::new());
        pixels.reserve(2 * (last.width + 2) * (last.height + 2));
        let mut inverse = Vec::new();
        loop {
            levels.push((pixels.len(), last.width + 1));
            for y in (0..last.height).chain([last.height - 1]) {
                let row = &last.pixels[y * last.width..(y + 1) * last.width];
                pixels.extend_from_slice(row);
                pixels.push(row[last.width - 1]);
            }
            if inverse.is_empty() {
                inverse = pixels.iter().map(|pixel| pixel[3]).collect();
            }
            if last.width.min(last.height) <= 2 {
                return Self { size, levels, pixels, inverse };
            }
            last = halved(path, &last);
        }
    }

    /// The fineness for pieces of the picture so many px wide: the levels between which it is, and its share of the coarser one.
    #[inline(always)]
    #[must_use]
    pub(super) fn fineness<S: Lanes>(&self, simd: S, width: S::F) -> Fineness<S> {
        let last = simd.set((self.levels.len() - 1) as f32);
        let level = log2(simd, [(width * SMOOTH).max(simd.set(1.0))])[0].max(simd.set(0.0)).min(last);
        let whole = level.floor();
        let coarse = (whole + 1.0).min(last);
        let (first, stride) = self.places(simd, whole);
        let (coarse_first, coarse_stride) = self.places(simd, coarse);
        Fineness {
            scales: [fineness(simd, whole), fineness(simd, coarse)],
            first: [first, coarse_first],
            stride: [stride, coarse_stride],
            part: Kept::of(simd, level - whole),
        }
    }

    /// First pixels and lengths of rows of levels.
    #[inline(always)]
    fn places<S: Lanes>(&self, simd: S, level: S::F) -> ([u32; 16], [u32; 16]) {
        let level = Whole::of(simd, level);
        let (mut first, mut stride) = ([0; 16], [0; 16]);
        for i in 0..S::N {
            let (own_first, own_stride) = self.levels[level.0[i] as usize];
            (first[i], stride[i]) = (own_first as u32, own_stride as u32);
        }
        (first, stride)
    }

    /// Adds the colours at points of the picture, px, times weights, to `sums`, for the lanes that have a bit in `wanted`.
    #[inline(always)]
    pub(super) fn add<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        fineness: &Fineness<S>,
        (weights, wanted): (S::F, u32),
        sums: &mut [[f32; 4]; 16],
    ) {
        let mut within = points;
        for k in 0..2 {
            within[k] = points[k].max(simd.set(0.0)).min(simd.set(self.size[k]));
        }
        let Fineness { scales, first, stride, part } = fineness;
        let fine = Spots::new(simd, within, scales[0], &first[0], &stride[0]);
        let coarse = Spots::new(simd, within, scales[1], &first[1], &stride[1]);
        let weights = Kept::of(simd, weights);
        let mut todo = wanted;
        while todo != 0 {
            let i = (todo.trailing_zeros() & 15) as usize;
            todo &= todo - 1;
            let (fine, coarse) = (
                fine.look(simd, i, stride[0][i], &self.pixels),
                coarse.look(simd, i, stride[1][i], &self.pixels),
            );
            let sum = f32x4::from_slice(simd, &sums[i]);
            (((coarse - fine) * part.0[i] + fine) * weights.0[i] + sum).store_slice(&mut sums[i]);
        }
    }

    /// The mean reciprocals of the view z in pieces of the picture about points, px, for the lanes that have a bit in `wanted`; 0 for others.
    #[inline(always)]
    pub(super) fn mean_inverse_depth<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        fineness: &Fineness<S>,
        wanted: u32,
    ) -> S::F {
        let (mut sums, mut found) = ([[0.0; 4]; 16], [0.0; 16]);
        self.add(simd, points, fineness, (simd.set(1.0), wanted), &mut sums);
        for (found, sum) in found.iter_mut().zip(&sums) {
            *found = sum[3];
        }
        simd.load(&found)
    }

    /// The reciprocals of the view z at points of the picture, px: those of the pixels that hold them; 0 for lanes without a bit in `wanted`.
    #[inline(always)]
    pub(super) fn inverse_depth<S: Lanes>(&self, simd: S, points: [S::F; 2], wanted: u32) -> S::F {
        let mut within = points;
        for k in 0..2 {
            within[k] = points[k].max(simd.set(0.0)).min(simd.set(self.size[k])).floor();
        }
        let (column, row) = (Whole::of(simd, within[0]), Whole::of(simd, within[1]));
        let stride = self.size[0] as usize + 1;
        let mut found = [0.0; 16];
        let mut todo = wanted;
        while todo != 0 {
            let i = (todo.trailing_zeros() & 15) as usize;
            todo &= todo - 1;
            found[i] = self.inverse[row.0[i] as usize * stride + column.0[i] as usize];
        }
        simd.load(&found)
    }
}

/// A fineness of a mirrored picture for each lane.
pub(super) struct Fineness<S: Lanes> {
    scales: [S::F; 2],
    first: [[u32; 16]; 2],
    stride: [[u32; 16]; 2],
    part: Kept,
}

/// The pixels about points.
struct Spots {
    at: [u32; 16],
    right: Kept,
    down: Kept,
}

impl Spots {
    /// About points of the finest level, px.
    #[inline(always)]
    fn new<S: Lanes>(simd: S, points: [S::F; 2], scale: S::F, first: &[u32; 16], stride: &[u32; 16]) -> Self {
        let (mut whole, mut part) = (points, points);
        for k in 0..2 {
            let at = points[k].mul_add(scale, simd.set(-0.5)).max(simd.set(0.0));
            whole[k] = at.floor();
            part[k] = at - whole[k];
        }
        let [column, row] = [Whole::of(simd, whole[0]), Whole::of(simd, whole[1])];
        let mut at = [0; 16];
        for i in 0..16 {
            at[i] = first[i].wrapping_add(row.0[i].wrapping_mul(stride[i])).wrapping_add(column.0[i]);
        }
        Self { at, right: Kept::of(simd, part[0]), down: Kept::of(simd, part[1]) }
    }

    /// Between the pixels about point `i`, of a picture with rows of `stride` pixels.
    #[inline(always)]
    fn look<S: Lanes>(&self, simd: S, i: usize, stride: u32, pixels: &[[f32; 4]]) -> f32x4<S> {
        bilinear(simd, pixels, (self.at[i] as usize, stride as usize), (self.right.0[i], self.down.0[i]))
    }
}

/// A mirrored picture half as fine, by binomial weights: the lamps of a night are so bright that the corners of a box would show.
fn halved(path: SimdPath, of: &LinearPicture) -> LinearPicture {
    let (width, height) = (of.width.div_ceil(2), of.height.div_ceil(2));
    let mut pixels = vec![[0.0; 4]; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, line)| {
        let rows: [&[[f32; 4]]; 4] =
            std::array::from_fn(|k| &of.pixels[near(y, k, of.height) * of.width..][..of.width]);
        dispatch!(path, s => halve_row(s, rows, line));
    });
    LinearPicture { width, height, pixels }
}

/// Pixel `k` of the four about pixel `i` of a picture half as fine, along a side of so many.
#[inline(always)]
fn near(i: usize, k: usize, size: usize) -> usize {
    (2 * i + k).saturating_sub(1).min(size - 1)
}

#[inline(always)]
fn halve_row<S: Lanes>(simd: S, rows: [&[[f32; 4]]; 4], line: &mut [[f32; 4]]) {
    const WEIGHTS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
    let size = rows[0].len();
    for (x, pixel) in line.iter_mut().enumerate() {
        let mut sum = f32x4::splat(simd, 0.0);
        for (i, right) in WEIGHTS.iter().enumerate() {
            let column = near(x, i, size);
            let mut own = f32x4::splat(simd, 0.0);
            for (row, down) in rows.iter().zip(WEIGHTS) {
                own = f32x4::from_slice(simd, &row[column]) * down + own;
            }
            sum = own * *right + sum;
        }
        sum.store_slice(pixel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sky_that_a_training_left_too_bright_is_mirrored_white() {
        let frame = Frame {
            width: 4,
            height: 4,
            rgb: [1.0, 1.3, 1.2].repeat(16),
            alpha: vec![1.0; 16],
            depth: vec![0.0; 16],
            ..Frame::default()
        };
        let path = SimdPath::available()[0];
        let [white, bright] = [1.0, f32::INFINITY].map(|white| MirroredPicture::new(path, &frame, white));
        assert!(white.pixels.iter().all(|pixel| pixel[..3].iter().all(|v| (v - 1.0).abs() < 1e-5)));
        assert!(bright.pixels.iter().all(|pixel| pixel[1] > 1.5));
    }
}
