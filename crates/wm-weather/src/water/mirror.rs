//! The scene from the eye that a water plane mirrors.

use super::map::WaterMap;
use super::surface::WaterSurface;
use crate::linear_picture::LinearPicture;
use rayon::prelude::*;
use wm_render::simd::SimdPath;
use wm_render::{CutPlane, Frame};
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
#[derive(Clone, Debug, Default)]
pub struct MirroredPicture {
    levels: Vec<LinearPicture>,
}

impl MirroredPicture {
    /// Makes all levels of a drawn picture with depth.
    #[must_use]
    pub fn new(path: SimdPath, frame: &Frame) -> Self {
        let mut finest = LinearPicture::of(path, frame);
        for (pixel, (depth, alpha)) in finest.pixels.iter_mut().zip(frame.depth.iter().zip(&frame.alpha)) {
            // Sky shines through where splats are thin: it is as far as what is seen of it.
            pixel[3] = if *depth > 0.0 { alpha / depth } else { 0.0 };
        }
        let mut levels = vec![finest];
        while let Some(last) = levels.last().filter(|last| last.width.min(last.height) > 2) {
            let next = halved(last);
            levels.push(next);
        }
        Self { levels }
    }

    /// The colour at a point of the picture, px, of a piece `width` px wide; and the reciprocal of its view z.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, x: f32, y: f32, width: f32) -> [f32; 4] {
        let level = (SMOOTH * width).max(1.0).log2().min((self.levels.len() - 1) as f32);
        let (whole, part) = (level as usize, level.fract());
        let fine = self.levels[whole].at(x, y, whole);
        if part == 0.0 {
            return fine;
        }
        let coarse = self.levels[whole + 1].at(x, y, whole + 1);
        std::array::from_fn(|k| fine[k] + part * (coarse[k] - fine[k]))
    }
}

/// A mirrored picture half as fine, by binomial weights: the lamps of a night are so bright that the corners of a box would show.
fn halved(of: &LinearPicture) -> LinearPicture {
    const WEIGHTS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];
    let (width, height) = (of.width.div_ceil(2), of.height.div_ceil(2));
    let near = |i: usize, k: usize, size: usize| (2 * i + k).saturating_sub(1).min(size - 1);
    let mut pixels = vec![[0.0; 4]; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(y, line)| {
        for (x, pixel) in line.iter_mut().enumerate() {
            for (j, down) in WEIGHTS.iter().enumerate() {
                let row = &of.pixels[near(y, j, of.height) * of.width..];
                for (i, right) in WEIGHTS.iter().enumerate() {
                    let from = row[near(x, i, of.width)];
                    (0..4).for_each(|k| pixel[k] += down * right * from[k]);
                }
            }
        }
    });
    LinearPicture { width, height, pixels }
}
