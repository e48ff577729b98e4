//! Exposure, white balance, saturation and contrast of the finished picture: the formulas are those
//! of the effect `look`.

use fearless_simd::{Select, SimdBase, SimdFloat};
use wm_base::color::luminance;
use wm_render::dispatch;
use wm_render::hooks::{PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::{Lanes, SimdPath, exp2, log2};

/// Light that contrast leaves as it is: a surface that reflects 18 %, in the middle between black
/// and white to the eye.
const MID_GREY: f64 = 0.18;

/// Gains of red, green and blue for a temperature of -1 to 1; grey keeps its luminance, and 0 gives
/// exactly 1.
fn balance(temperature: f64) -> [f64; 3] {
    if temperature == 0.0 {
        return [1.0; 3];
    }
    let gains = [(temperature / 2.0).exp2(), 1.0, (-temperature / 2.0).exp2()];
    gains.map(|gain| gain / luminance(gains))
}

/// A look at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ColorGrade {
    /// Factors on linear red, green and blue: exposure and temperature.
    pub(crate) gains: [f64; 3],
    /// Factor on the distance from grey.
    pub(crate) saturation: f64,
    /// Factor on log2 of the light about mid grey.
    pub(crate) contrast: f64,
}

impl ColorGrade {
    /// A look by the parameters of the effect `look`.
    pub(crate) fn new(exposure: f64, saturation: f64, contrast: f64, temperature: f64) -> Self {
        Self { gains: balance(temperature).map(|gain| gain * exposure.exp2()), saturation, contrast }
    }

    /// Returns true if it changes nothing.
    pub(crate) fn is_neutral(&self) -> bool {
        self.gains == [1.0; 3] && self.saturation == 1.0 && self.contrast == 1.0
    }

    #[inline(always)]
    fn change<S: Lanes>(&self, simd: S, rgb: &mut [[f32; PATCH_PIXELS]; 3]) {
        let gains = self.gains.map(|gain| gain as f32);
        let weights = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|unit| luminance(unit) as f32);
        for first in (0..PATCH_PIXELS).step_by(S::N) {
            let mut color = [simd.set(0.0); 3];
            for k in 0..3 {
                color[k] = simd.load(&rgb[k][first..]).max(simd.set(0.0));
            }
            let mut light = wm_render::simd::srgb_decode(simd, color);
            for k in 0..3 {
                light[k] *= gains[k];
            }
            if self.saturation != 1.0 {
                let grey = light[0].mul_add(
                    simd.set(weights[0]),
                    light[1].mul_add(simd.set(weights[1]), light[2] * weights[2]),
                );
                for k in 0..3 {
                    let kept = (light[k] - grey).mul_add(simd.set(self.saturation as f32), grey);
                    light[k] = kept.max(simd.set(0.0));
                }
            }
            if self.contrast != 1.0 {
                light = about_grey(simd, light, self.contrast as f32);
            }
            let shown = wm_render::simd::srgb_encode(simd, light);
            for k in 0..3 {
                shown[k].store_slice(&mut rgb[k][first..first + S::N]);
            }
        }
    }
}

/// `0.18 (c / 0.18)^contrast`; 0 where c is below 1e-30, and no more than 2^120.
#[inline(always)]
fn about_grey<S: Lanes>(simd: S, light: [S::F; 3], contrast: f32) -> [S::F; 3] {
    let tiny = simd.set(1e-30);
    let offset = (1.0 - contrast) * MID_GREY.log2() as f32;
    let mut result = light;
    for k in 0..3 {
        result[k] = light[k].max(tiny);
    }
    result = log2(simd, result);
    for k in 0..3 {
        let exponent = result[k].mul_add(simd.set(contrast), simd.set(offset));
        result[k] = exponent.max(simd.set(-126.0)).min(simd.set(120.0));
    }
    result = exp2(simd, result);
    for k in 0..3 {
        result[k] = light[k].simd_gt(tiny).select(result[k], simd.set(0.0));
    }
    result
}

impl PixelEffect for ColorGrade {
    fn apply(&self, path: SimdPath, pixels: &mut PixelBatch<'_>) {
        let rgb = &mut *pixels.rgb;
        dispatch!(path, simd => self.change(simd, rgb));
    }
}

#[cfg(test)]
mod tests;
