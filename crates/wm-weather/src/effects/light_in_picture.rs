//! Light that an effect adds to the pixels of a picture.

use glam::DVec2;
use wm_base::color::{srgb_decode, srgb_encode};
use wm_render::hooks::{PATCH, PATCH_PIXELS, PixelBatch};

/// Adds light to each pixel, in units of display white; `light` gets the number of a pixel in the
/// batch and the place of its middle in the picture, px.
pub(super) fn add_light(
    pixels: &mut PixelBatch<'_>,
    light: impl Fn(&PixelBatch<'_>, usize, DVec2) -> Option<[f64; 3]>,
) {
    for at in 0..PATCH_PIXELS {
        let [column, row] = [at % PATCH, at / PATCH].map(|v| v as f64);
        let (x, y) = (f64::from(pixels.x) + column + 0.5, f64::from(pixels.y) + row + 0.5);
        let Some(light) = light(pixels, at, DVec2::new(x, y)) else { continue };
        for k in 0..3 {
            let value = &mut pixels.rgb[k][at];
            *value = srgb_encode(srgb_decode(f64::from(*value)) + light[k]) as f32;
        }
    }
}

/// The linear light that an effect adds to the red of a mid-grey pixel with nothing behind it.
#[cfg(test)]
pub(super) fn gain(effect: &dyn wm_render::hooks::PixelEffect, pixel: [u32; 2]) -> f64 {
    let (mut rgb, none) = ([[0.5f32; PATCH_PIXELS]; 3], [0.0; PATCH_PIXELS]);
    let side = PATCH as u32;
    let [x, y] = pixel.map(|v| v / side * side);
    let mut batch = PixelBatch { x, y, rgb: &mut rgb, alpha: &none, depth_sum: &none };
    effect.apply(wm_render::simd::SimdPath::widest(), &mut batch);
    srgb_decode(f64::from(rgb[0][((pixel[1] - y) * side + pixel[0] - x) as usize])) - srgb_decode(0.5)
}
