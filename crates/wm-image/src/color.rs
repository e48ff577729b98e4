//! From display-referred floats to bytes.

use super::PictureSize;
use super::dither;

/// The quantisation of floats to bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Dither {
    /// To the nearest: slow gradients show contours.
    Off,
    /// A fixed blue-noise offset a pixel and channel. No pixel is off by a whole step, the mean
    /// over any 16x16 is right within 0.05 of a step, and a value that is a byte already stays this
    /// byte everywhere.
    #[default]
    Ordered,
}

impl Dither {
    /// The offsets added to the pixels of row `y` of `channel` (0-2) before rounding, one a pixel,
    /// to be repeated.
    pub(super) fn row(self, channel: usize, y: usize) -> &'static [f32] {
        match self {
            Self::Off => &[0.0; dither::PATTERN_SIDE_PX],
            Self::Ordered => {
                &dither::OFFSETS[channel][y % dither::PATTERN_SIDE_PX * dither::PATTERN_SIDE_PX..]
                    [..dither::PATTERN_SIDE_PX]
            }
        }
    }

    /// The offsets of [`Self::row`] for all three channels, three a pixel.
    fn row_interleaved(self, y: usize) -> &'static [f32] {
        const ROW_LENGTH: usize = 3 * dither::PATTERN_SIDE_PX;
        match self {
            Self::Off => &[0.0; ROW_LENGTH],
            Self::Ordered => &dither::INTERLEAVED[y % dither::PATTERN_SIDE_PX * ROW_LENGTH..][..ROW_LENGTH],
        }
    }
}

/// `value` within 0-1; what is no number becomes 0.
#[inline]
pub(super) fn unit(value: f32) -> f32 {
    // Comparisons with NaN are false; clamp would keep it.
    let value = if value > 0.0 { value } else { 0.0 };
    if value < 1.0 { value } else { 1.0 }
}

/// `value`, -0.5 to 255.5, to the nearest.
#[inline]
pub(super) fn byte(value: f32) -> u8 {
    // At 1.5 * 2^23 floats are 1 apart, so that the addition rounds and the last byte is the
    // result. A cast, which must saturate, takes three times as long.
    (value + 12_582_912.0).to_bits() as u8
}

/// `rgb [H, W, 3]`, sRGB-encoded 0-1, as bytes of the same shape. Values outside are clipped.
#[must_use]
pub fn quantize_rgb8(rgb: &[f32], size: PictureSize, dither: Dither) -> Vec<u8> {
    size.expect("rgb", rgb, 3);
    let mut bytes = vec![0; rgb.len()];
    let row_length = 3 * size.width as usize;
    for (y, (to, from)) in bytes.chunks_exact_mut(row_length).zip(rgb.chunks_exact(row_length)).enumerate() {
        let offsets = dither.row_interleaved(y);
        for (to, from) in to.chunks_mut(offsets.len()).zip(from.chunks(offsets.len())) {
            for ((to, &from), &offset) in to.iter_mut().zip(from).zip(offsets) {
                *to = byte(unit(from) * 255.0 + offset);
            }
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey ramp along x, `rows` rows high, from `from` on, `step` a pixel, in steps of 1/255.
    fn ramp(size: PictureSize, from: f32, step: f32) -> Vec<f32> {
        (0..size.pixels()).flat_map(|i| [(from + step * (i as u32 % size.width) as f32) / 255.0; 3]).collect()
    }

    #[test]
    fn no_pixel_is_off_by_a_step_and_means_are_right() {
        let size = PictureSize::new(1024, 64);
        let rgb = ramp(size, 100.2, 1.0 / 128.0);
        let bytes = quantize_rgb8(&rgb, size, Dither::Ordered);
        for (&byte, &value) in bytes.iter().zip(&rgb) {
            assert!((f32::from(byte) - 255.0 * value).abs() < 1.0);
        }
        // The mean over 16x16 pixels anywhere (every 4th place), within 0.05 of a step.
        let mut worst = 0f64;
        for channel in 0..3 {
            for y in (0..size.height - 16).step_by(4) {
                for x in (0..size.width - 16).step_by(4) {
                    let mut error = 0.0;
                    for i in 0..256 {
                        let at = ((y + i / 16) * size.width + x + i % 16) as usize * 3 + channel;
                        error += f64::from(bytes[at]) - 255.0 * f64::from(rgb[at]);
                    }
                    worst = worst.max((error / 256.0).abs());
                }
            }
        }
        println!("worst error of a 16x16 mean: {worst:.4} steps");
        assert!(worst < 0.05, "{worst}");
    }

    #[test]
    fn a_slow_gradient_has_no_flat_steps() {
        // 128 pixels a step. A step is flat as far as a strip of 16 rows has one value only.
        let size = PictureSize::new(1024, 16);
        let rgb = ramp(size, 100.2, 1.0 / 128.0);
        let widest = |dither| {
            let bytes = quantize_rgb8(&rgb, size, dither);
            let column = |x: usize| (0..16).map(move |y| (y * 1024 + x) * 3);
            let (mut widest, mut width, mut last) = (0, 0, None);
            for x in 0..1024 {
                let first = bytes[3 * x];
                let flat = column(x).all(|at| bytes[at] == first).then_some(first);
                width = if flat.is_some() && flat == last { width + 1 } else { usize::from(flat.is_some()) };
                last = flat;
                widest = widest.max(width);
            }
            widest
        };
        assert_eq!(widest(Dither::Off), 128);
        println!("widest flat step: {} pixels", widest(Dither::Ordered));
        assert!(widest(Dither::Ordered) <= 10);
    }

    #[test]
    fn bytes_stay_bytes_and_the_rest_is_clipped() {
        let size = PictureSize::new(256, 64);
        let rgb: Vec<f32> = (0..size.pixels()).flat_map(|i| [(i % 256) as f32 / 255.0; 3]).collect();
        for dither in [Dither::Off, Dither::Ordered] {
            let bytes = quantize_rgb8(&rgb, size, dither);
            assert!(bytes.iter().enumerate().all(|(at, &byte)| usize::from(byte) == at / 3 % 256));
            for (value, expected) in [(-1.0, 0), (1.5, 255), (f32::NAN, 0), (f32::INFINITY, 255)] {
                let bytes = quantize_rgb8(&vec![value; rgb.len()], size, dither);
                assert!(bytes.iter().all(|&byte| byte == expected), "{value}");
            }
        }
    }
}
