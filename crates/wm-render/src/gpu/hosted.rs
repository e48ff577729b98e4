//! What the CPU does of a GPU's frame: factors of visibility, backgrounds that are no single colour, gathering what
//! falls, and pixel effects on the picture that came back.

use crate::frame::Frame;
use crate::hooks::{PATCH, PATCH_PIXELS, PixelBatch, Visibility};
use crate::renderer::Job;
use crate::simd::SimdPath;
use crate::stages::composite::background::{BackgroundScratch, BackgroundView};
use rayon::prelude::*;

/// The factors of splats with these indices in the loaded set.
pub(crate) fn factors(visibility: &dyn Visibility, source: &[u32]) -> Vec<f32> {
    const PART: usize = 4096;
    let mut factors = vec![1.0; source.len()];
    let parts = factors.par_chunks_mut(PART).zip(source.par_chunks(PART));
    parts.for_each(|(factors, source)| visibility.factors(source, factors));
    factors
}

/// What stands behind the splats, through the air: one colour, or `[H, W, 3]`.
pub(crate) fn background(path: SimdPath, job: &Job<'_>) -> Vec<f32> {
    let backdrop = job.hooks.background.unwrap_or(&job.config.background);
    let view = BackgroundView::new(backdrop, job.hooks.medium, job.camera, path);
    if let Some(color) = view.uniform() {
        return color.to_vec();
    }
    let (width, height) = (job.camera.width as usize, job.camera.height as usize);
    let mut picture = vec![0.0; 3 * width * height];
    picture.par_chunks_mut(3 * width * PATCH).enumerate().for_each(|(row, pixels)| {
        let (mut scratch, mut patch) = (BackgroundScratch::default(), [[0.0; PATCH_PIXELS]; 3]);
        for column in 0..width.div_ceil(PATCH) {
            view.fill((column, row), &mut scratch, &mut patch);
            for (y, line) in pixels.chunks_exact_mut(3 * width).enumerate() {
                let line = &mut line.as_chunks_mut::<3>().0[column * PATCH..];
                for (x, pixel) in line.iter_mut().take(PATCH).enumerate() {
                    *pixel = patch.each_ref().map(|channel| channel[y * PATCH + x]);
                }
            }
        }
    });
    picture
}

/// Applies the pixel effects to a finished picture; `hidden` is the depth where the frame has none.
pub(crate) fn pixel_effects(path: SimdPath, job: &Job<'_>, frame: &mut Frame, hidden: &[f32]) {
    if job.hooks.pixels.is_empty() {
        return;
    }
    let width = frame.width as usize;
    let depth = if frame.depth.is_empty() { hidden } else { &frame.depth };
    let alpha = &frame.alpha;
    frame.rgb.par_chunks_mut(3 * width * PATCH).enumerate().for_each(|(row, band)| {
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
            for effect in job.hooks.pixels {
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
