//! The wide view that drops show.

use crate::water::decode;
use rayon::prelude::*;
use wm_render::hooks::GROUP;
use wm_render::simd::SimdPath;
use wm_render::{Frame, dispatch};
use wm_scene::Camera;

/// Side of the wide picture, px.
pub(super) const SIDE: u32 = 256;
/// Its focal length, px: it shows 76 degrees to all sides.
const FOCAL: f64 = 32.0;
/// Greatest tangent of an angle from the axis in the picture.
const EDGE: f32 = (SIDE as f64 / 2.0 / FOCAL) as f32 - 0.03;

/// The camera of the wide view: at the eye of the picture's camera, along its view.
#[must_use]
pub fn wide_camera(camera: &Camera) -> Camera {
    let middle = f64::from(SIDE) / 2.0;
    Camera { width: SIDE, height: SIDE, fx: FOCAL, fy: FOCAL, cx: middle, cy: middle, ..*camera }
}

/// A wide picture in linear light at every fineness.
#[derive(Clone, Debug)]
pub struct WideView {
    levels: Vec<(usize, Vec<[f32; 4]>)>,
}

impl WideView {
    /// Makes all levels of a drawn picture, which must be of [`wide_camera`].
    #[must_use]
    pub fn new(path: SimdPath, frame: &Frame) -> Self {
        let side = SIDE as usize;
        let mut finest = vec![[0.0; 4]; side * side];
        finest.par_chunks_mut(side).zip(frame.rgb.par_chunks(3 * side)).for_each(|(line, rgb)| {
            for (line, rgb) in line.chunks_mut(GROUP).zip(rgb.chunks(3 * GROUP)) {
                let mut channels = [[0.0f32; GROUP]; 3];
                for (i, pixel) in rgb.as_chunks::<3>().0.iter().enumerate() {
                    (0..3).for_each(|k| channels[k][i] = pixel[k].max(0.0));
                }
                dispatch!(path, s => decode(s, &mut channels));
                for (i, pixel) in line.iter_mut().enumerate() {
                    *pixel = [channels[0][i], channels[1][i], channels[2][i], 0.0];
                }
            }
        });
        let mut levels = vec![(side, finest)];
        while let Some((side, last)) = levels.last().filter(|(side, _)| *side > 2) {
            let half = side / 2;
            let mut next = Vec::with_capacity(half * half);
            for y in 0..half {
                for x in 0..half {
                    let from = 2 * y * side + 2 * x;
                    let four = [from, from + 1, from + side, from + side + 1].map(|i| last[i]);
                    next.push(std::array::from_fn(|k| {
                        0.25 * (four[0][k] + four[1][k] + four[2][k] + four[3][k])
                    }));
                }
            }
            levels.push((half, next));
        }
        Self { levels }
    }

    /// The mean light of the whole view.
    #[must_use]
    pub fn mean(&self) -> [f32; 3] {
        let (_, four) = &self.levels[self.levels.len() - 1];
        std::array::from_fn(|k| four.iter().map(|pixel| pixel[k]).sum::<f32>() / four.len() as f32)
    }

    /// The light from a direction of the camera's axes, x right, y down, z ahead, of a cone `angle` radians wide.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, [x, y, z]: [f32; 3], angle: f32) -> [f32; 4] {
        let inverse = 1.0 / z.max(0.05);
        let (u, v) = ((x * inverse).clamp(-EDGE, EDGE), (y * inverse).clamp(-EDGE, EDGE));
        // Pixels of the edge are narrower angles.
        let wide = angle * FOCAL as f32 * (1.0 + u * u + v * v).sqrt();
        let level = ((wide.max(1.0).to_bits() >> 23) as usize - 127).min(self.levels.len() - 1);
        let (side, pixels) = &self.levels[level];
        let scale = 1.0 / (1u32 << level) as f32;
        let most = (*side - 1) as f32;
        let u = ((u * FOCAL as f32 + 0.5 * SIDE as f32) * scale - 0.5).clamp(0.0, most);
        let v = ((v * FOCAL as f32 + 0.5 * SIDE as f32) * scale - 0.5).clamp(0.0, most);
        let (left, top) = (u as usize, v as usize);
        let (fx, fy) = (u - left as f32, v - top as f32);
        let (right, below) = (usize::from(left + 1 < *side), if top + 1 < *side { *side } else { 0 });
        let from = top * side + left;
        let [a, b, c, d] = [from, from + right, from + below, from + right + below].map(|i| &pixels[i]);
        std::array::from_fn(|k| {
            let upper = a[k] + fx * (b[k] - a[k]);
            let lower = c[k] + fx * (d[k] - c[k]);
            upper + fy * (lower - upper)
        })
    }
}
