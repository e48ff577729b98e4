//! Applies pixel effects to a finished picture. The CPU renderer applies them itself while it
//! finishes patches; the GPU back end and picture passes call this.

use crate::hooks::{PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use crate::simd::SimdPath;
use rayon::prelude::*;

/// Applies effects to a finished picture of `width` px: `rgb` is `[H, W, 3]`, coverage and expected
/// depth (view z, scene units) are `[H, W]`.
pub fn apply_pixel_effects(
    path: SimdPath,
    effects: &[&dyn PixelEffect],
    width: usize,
    rgb: &mut [f32],
    alpha: &[f32],
    depth: &[f32],
) {
    if effects.is_empty() {
        return;
    }
    rgb.par_chunks_mut(3 * width * PATCH).enumerate().for_each(|(row, band)| {
        for left in (0..width).step_by(PATCH) {
            let mut patch = ([[0.0; PATCH_PIXELS]; 3], [0.0; PATCH_PIXELS], [0.0; PATCH_PIXELS]);
            let columns = PATCH.min(width - left);
            let pixels = |y: usize| y * width + left..y * width + left + columns;
            for (y, line) in band.chunks_exact(3 * width).enumerate() {
                let line = &line.as_chunks::<3>().0[left..left + columns];
                let range = pixels(row * PATCH + y);
                for (x, ((pixel, alpha), depth)) in
                    line.iter().zip(&alpha[range.clone()]).zip(&depth[range]).enumerate()
                {
                    let at = y * PATCH + x;
                    (0..3).for_each(|k| patch.0[k][at] = pixel[k]);
                    (patch.1[at], patch.2[at]) = (*alpha, depth * alpha);
                }
            }
            for effect in effects {
                let (x, y) = (left as u32, (row * PATCH) as u32);
                let (rgb, alpha, depth_sum) = (&mut patch.0, &patch.1, &patch.2);
                effect.apply(path, &mut PixelBatch { x, y, rgb, alpha, depth_sum });
            }
            for (y, line) in band.chunks_exact_mut(3 * width).enumerate() {
                let line = &mut line.as_chunks_mut::<3>().0[left..left + columns];
                for (x, pixel) in line.iter_mut().enumerate() {
                    *pixel = patch.0.each_ref().map(|channel| channel[y * PATCH + x]);
                }
            }
        }
    });
}
