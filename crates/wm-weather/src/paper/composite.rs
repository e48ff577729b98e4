//! The paper's overlay of rain and snow on a picture.
//!
//! For each sub-cloud, the farthest first, with the composite `C` so far, all display-referred:
//!
//! - `L = (C_R + C_G + C_B) / 3`; `f_l = exp(clamp(L_sky - L, t_min, t_max)) - 1`. The printed
//!   formula has the two bounds the wrong way round, which makes it a constant.
//! - `m = (D_ref,n < D_ref) and (D_ref,n < t_D) and (L(C_noise) > t_C)`.
//! - `C += f_l C_noise` where `m`.
//!
//! `D_ref = min(1, D_abs / d_max)` with `D_abs` the sum of weight times view z, not divided by the
//! coverage, as in the paper. Of the picture what no splat covers counts as `d_max` away, as in
//! [`PaperFog`](super::PaperFog); of the noise as nothing. So a thin part of a drop counts as
//! nearer than it is: the faint edge of one behind a wall is seen before it.
//!
//! Last comes what the paper names in passing: a light fog over the distance, a small blur, a
//! colour filter.

use super::fall::PaperFall;
use crate::grade::ColorGrade;
use wm_render::Frame;
use wm_render::hooks::{PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::SimdPath;

/// Least standard deviation of a blur, px: below it, neighbours weigh less than half a step of 8
/// bits.
const MIN_BLUR_PX: f64 = 0.25;

/// The steps of the paper's figure, `[H, W, 3]` each, display-referred: what lies between the clear
/// picture and the last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PaperStages {
    /// The noise scene alone, over black.
    pub noise: Vec<f32>,
    /// The noise scene laid over the picture as it is, by its coverage.
    pub overlay: Vec<f32>,
    /// The noise that the masks leave, over black.
    pub filtered: Vec<f32>,
}

impl PaperStages {
    /// Before any noise.
    pub fn begin(&mut self, picture: &Frame) {
        self.noise = vec![0.0; picture.rgb.len()];
        self.filtered = self.noise.clone();
        self.overlay.clone_from(&picture.rgb);
    }
}

/// The masks and the blending of noise, in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperBlend {
    /// L_sky.
    pub(crate) sky: f64,
    /// t_min and t_max.
    pub(crate) t: [f64; 2],
    /// t_D, scene units.
    pub(crate) t_d: f64,
    /// t_C.
    pub(crate) t_c: f64,
    /// Depth that counts as 1, scene units.
    pub(crate) d_max: f64,
}

impl PaperBlend {
    /// f_l where the composite has the brightness `light`.
    pub(crate) fn factor(&self, light: f64) -> f64 {
        let [least, most] = self.t;
        // Not `clamp`: bounds the wrong way round are no reason to panic.
        (self.sky - light).min(most).max(least).exp_m1()
    }

    /// m, for depths as sums of weight times view z with the coverage of the picture, and the
    /// noise's colour.
    pub(crate) fn keeps(&self, depth: f64, alpha: f64, noise_depth: f64, noise: [f32; 3]) -> bool {
        let scene = ((depth + (1.0 - alpha) * self.d_max) / self.d_max).min(1.0);
        let own = (noise_depth / self.d_max).min(1.0);
        own < scene && own < self.t_d / self.d_max && brightness(noise) > self.t_c
    }
}

/// L: the plain mean of three display-referred channels.
fn brightness(rgb: [f32; 3]) -> f64 {
    let [r, g, b] = rgb;
    (f64::from(r) + f64::from(g) + f64::from(b)) / 3.0
}

/// Lays the render of one sub-cloud over the picture.
///
/// Both need colour, alpha and depth, and the same size; the noise lies over black.
///
/// # Panics
/// If an array is missing or of another size.
pub fn add(blend: &PaperBlend, picture: &mut Frame, noise: &Frame, mut stages: Option<&mut PaperStages>) {
    let pixels = picture.pixels();
    assert!(picture.depth.len() == pixels && noise.depth.len() == pixels && noise.rgb.len() == 3 * pixels);
    for i in 0..pixels {
        let cover = noise.alpha[i];
        if cover <= 0.0 {
            continue;
        }
        let own = [0, 1, 2].map(|k| noise.rgb[3 * i + k]);
        let sum = |frame: &Frame| f64::from(frame.alpha[i]) * f64::from(frame.depth[i]);
        let keeps = blend.keeps(sum(picture), f64::from(picture.alpha[i]), sum(noise), own);
        let rgb = &mut picture.rgb[3 * i..3 * i + 3];
        if keeps {
            let factor = blend.factor(brightness([rgb[0], rgb[1], rgb[2]]));
            for k in 0..3 {
                // A negative factor may take more than there is of one channel.
                rgb[k] = (f64::from(rgb[k]) + factor * f64::from(own[k])).max(0.0) as f32;
            }
        }
        if let Some(stages) = &mut stages {
            let over = |to: &mut Vec<f32>| {
                (0..3).for_each(|k| to[3 * i + k] = own[k] + (1.0 - cover) * to[3 * i + k]);
            };
            over(&mut stages.noise);
            over(&mut stages.overlay);
            if keeps {
                over(&mut stages.filtered);
            }
        }
    }
}

/// Applies what follows the last sub-cloud: the fogs of all that falls, one blur as wide as all of
/// theirs, the colour filter of the first, and `look`. The picture needs alpha and depth.
pub(crate) fn finish(falls: &[PaperFall], look: Option<&ColorGrade>, path: SimdPath, picture: &mut Frame) {
    let fogs: Vec<&dyn PixelEffect> = falls.iter().map(|fall| &fall.fog as &dyn PixelEffect).collect();
    apply(&fogs, path, picture);
    blur(falls.iter().map(|fall| fall.blur.powi(2)).sum::<f64>().sqrt(), picture);
    let filter = falls.first().map(|fall| &fall.filter).filter(|filter| !filter.is_neutral());
    let grades: Vec<&dyn PixelEffect> =
        filter.into_iter().chain(look).map(|grade| grade as &dyn PixelEffect).collect();
    apply(&grades, path, picture);
}

/// Applies pixel effects to a finished picture, as the renderer does to its patches.
fn apply(effects: &[&dyn PixelEffect], path: SimdPath, picture: &mut Frame) {
    if effects.is_empty() {
        return;
    }
    let (width, height) = (picture.width as usize, picture.height as usize);
    for top in (0..height).step_by(PATCH) {
        for left in (0..width).step_by(PATCH) {
            let (mut rgb, mut alpha, mut depth) =
                ([[0.0; PATCH_PIXELS]; 3], [0.0; PATCH_PIXELS], [0.0; PATCH_PIXELS]);
            let inside = || {
                let columns = PATCH.min(width - left);
                (0..PATCH.min(height - top)).flat_map(move |y| (0..columns).map(move |x| (x, y)))
            };
            for (x, y) in inside() {
                let (to, from) = (y * PATCH + x, (top + y) * width + left + x);
                alpha[to] = picture.alpha[from];
                depth[to] = picture.alpha[from] * picture.depth[from];
                (0..3).for_each(|k| rgb[k][to] = picture.rgb[3 * from + k]);
            }
            for effect in effects {
                let (x, y) = (left as u32, top as u32);
                effect.apply(path, &mut PixelBatch { x, y, rgb: &mut rgb, alpha: &alpha, depth_sum: &depth });
            }
            for (x, y) in inside() {
                let (from, to) = (y * PATCH + x, (top + y) * width + left + x);
                (0..3).for_each(|k| picture.rgb[3 * to + k] = rgb[k][from]);
            }
        }
    }
}

/// A Gaussian blur of the colours as they are shown, standard deviation `sigma` px; beyond the edge
/// the last pixel goes on.
fn blur(sigma: f64, picture: &mut Frame) {
    if sigma < MIN_BLUR_PX {
        return;
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let mut weights: Vec<f32> =
        (0..=2 * reach).map(|i| (-0.5 * ((i as f64 - reach as f64) / sigma).powi(2)).exp() as f32).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    let (stride, height) = (3 * picture.width as usize, picture.height as usize);
    let at = |i: usize, most: usize| i.saturating_sub(reach).min(most);
    let mut padded = Vec::with_capacity(stride + 6 * reach);
    for row in picture.rgb.chunks_exact_mut(stride) {
        padded.clear();
        for i in 0..row.len() / 3 + 2 * reach {
            padded.extend_from_slice(&row[3 * at(i, stride / 3 - 1)..][..3]);
        }
        row.fill(0.0);
        for (tap, weight) in weights.iter().enumerate() {
            row.iter_mut().zip(&padded[3 * tap..]).for_each(|(to, from)| *to += weight * from);
        }
    }
    let level = picture.rgb.clone();
    for (y, row) in picture.rgb.chunks_exact_mut(stride).enumerate() {
        row.fill(0.0);
        for (tap, weight) in weights.iter().enumerate() {
            let from = &level[stride * at(y + tap, height - 1)..][..stride];
            row.iter_mut().zip(from).for_each(|(to, from)| *to += weight * from);
        }
    }
}

#[cfg(test)]
mod tests;
