//! Pictures in linear light that are looked into at any fineness, and the way there and back from
//! display-referred ones.

use rayon::prelude::*;
use wm_render::hooks::GROUP;
use wm_render::simd::{self, Lanes, SimdPath};
use wm_render::{Frame, dispatch};

/// A picture in linear light, one level of a pyramid.
#[derive(Clone, Debug, Default)]
pub(crate) struct LinearPicture {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Red, green, blue, and a number of its user's.
    pub(crate) pixels: Vec<[f32; 4]>,
}

impl LinearPicture {
    /// The colours of a drawn picture, with 0 as the fourth number.
    pub(crate) fn new(path: SimdPath, frame: &Frame) -> Self {
        let (width, height) = (frame.width as usize, frame.height as usize);
        let mut pixels = vec![[0.0; 4]; width * height];
        let rows = pixels.par_chunks_mut(width).zip(frame.rgb.par_chunks(3 * width));
        rows.for_each(|(line, rgb)| dispatch!(path, s => decode_row(s, rgb, line)));
        Self { width, height, pixels }
    }

    /// Mixes the four pixels about a point of the finest level, px; beyond the picture's edge its
    /// last pixels go on.
    #[inline(always)]
    pub(crate) fn at(&self, x: f32, y: f32, level: usize) -> [f32; 4] {
        let scale = 1.0 / (1u32 << level) as f32;
        let u = (x * scale - 0.5).clamp(0.0, (self.width - 1) as f32);
        let v = (y * scale - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (u as usize, v as usize);
        between(&self.pixels, [self.width, self.height], [left, top], [u - left as f32, v - top as f32])
    }
}

/// Mixes a pixel with the next ones to the right and below, by the parts of the way to them. `size`
/// is the width and height of the picture; beyond its edge the last pixels go on.
#[inline(always)]
pub(crate) fn between<const N: usize>(
    pixels: &[[f32; N]],
    size: [usize; 2],
    place: [usize; 2],
    parts: [f32; 2],
) -> [f32; N] {
    let ([width, height], [left, top]) = (size, place);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let row = |y: usize| mix(&pixels[y * width + left], &pixels[y * width + right], parts[0]);
    mix(&row(top), &row(bottom), parts[1])
}

/// Returns the mix of two pixels, a part of the way from the first to the second.
#[inline(always)]
pub(crate) fn mix<const N: usize>(a: &[f32; N], b: &[f32; N], part: f32) -> [f32; N] {
    std::array::from_fn(|k| a[k] + part * (b[k] - a[k]))
}

/// Returns the width and the pixels of a picture with half as many pixels along both sides.
pub(crate) fn halved<const N: usize>(width: usize, pixels: &[[f32; N]]) -> (usize, Vec<[f32; N]>) {
    let height = pixels.len() / width;
    let (across, down) = (width.div_ceil(2), height.div_ceil(2));
    let mut half = Vec::with_capacity(across * down);
    for (y, x) in (0..down).flat_map(|y| (0..across).map(move |x| (y, x))) {
        let (right, below) = ((2 * x + 1).min(width - 1), (2 * y + 1).min(height - 1));
        let four = [(2 * x, 2 * y), (right, 2 * y), (2 * x, below), (right, below)];
        let four = four.map(|(x, y)| pixels[y * width + x]);
        half.push(std::array::from_fn(|k| 0.25 * four.iter().map(|pixel| pixel[k]).sum::<f32>()));
    }
    (across, half)
}

/// Display-referred pixels of a row in linear light.
#[inline(always)]
fn decode_row<S: Lanes>(simd: S, rgb: &[f32], line: &mut [[f32; 4]]) {
    for (pixels, line) in rgb.chunks(3 * GROUP).zip(line.chunks_mut(GROUP)) {
        let mut channels = [[0.0f32; GROUP]; 3];
        for (i, pixel) in pixels.as_chunks::<3>().0.iter().enumerate() {
            (0..3).for_each(|k| channels[k][i] = pixel[k].max(0.0));
        }
        convert::<S, false>(simd, &mut channels);
        for (i, pixel) in line.iter_mut().enumerate() {
            *pixel = [channels[0][i], channels[1][i], channels[2][i], 0.0];
        }
    }
}

/// Display-referred colours in linear light, in place; the other way round if `ENCODES`.
#[inline(always)]
pub(crate) fn convert<S: Lanes, const ENCODES: bool>(simd: S, channels: &mut [[f32; GROUP]; 3]) {
    for first in (0..GROUP).step_by(S::N) {
        let mut light = [simd.set(0.0); 3];
        (0..3).for_each(|k| light[k] = simd.load(&channels[k][first..]));
        light = if ENCODES { simd::srgb_encode(simd, light) } else { simd::srgb_decode(simd, light) };
        (0..3).for_each(|k| {
            fearless_simd::SimdBase::store_slice(&light[k], &mut channels[k][first..first + S::N]);
        });
    }
}
