//! Conversion of frames to 8-bit pictures and JPEG.

use crate::state::ViewOutput;
use std::sync::LazyLock;
use wm_image::PictureSize;
use wm_image::color::{Dither, quantize_rgb8};
use wm_image::jpeg::{JpegError, SamplingFactor};
use wm_image::ramps::turbo;
use wm_render::Frame;

/// JPEG quality from which on chroma is not subsampled.
const WHOLE_COLORS: u8 = 85;

/// Colours of depths, near ones warm.
static DEPTHS: LazyLock<[[u8; 3]; 256]> =
    LazyLock::new(|| std::array::from_fn(|step| turbo(step as f64 / 255.0)));

/// Returns an output of a frame as bytes `[H, W, 3]`. `half` is the depth, scene units, that gets
/// the middle colour; it is the same for all frames of a scene, so that the colours do not flicker.
pub fn to_bytes(frame: &Frame, output: ViewOutput, half: f64, dither: Dither) -> Vec<u8> {
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let half = half as f32;
    match output {
        ViewOutput::Rgb => quantize_rgb8(&frame.rgb, PictureSize::new(frame.width, frame.height), dither),
        ViewOutput::Depth => {
            let color = |depth: &f32| {
                if *depth > 0.0 { DEPTHS[usize::from(byte(depth / (depth + half)))] } else { [0; 3] }
            };
            frame.depth.iter().flat_map(color).collect()
        }
        ViewOutput::Normal => frame.normal.iter().map(|n| byte(0.5 + 0.5 * n)).collect(),
        ViewOutput::Alpha => frame.alpha.iter().flat_map(|alpha| [byte(*alpha); 3]).collect(),
    }
}

/// Joins `left` and `right`, each `[H, W, 3]` with its width, side by side.
pub(crate) fn join_columns(left: (Vec<u8>, u32), right: (Vec<u8>, u32)) -> Vec<u8> {
    let ((left, left_width), (right, right_width)) = (left, right);
    match (left_width, right_width) {
        (0, _) => right,
        (_, 0) => left,
        _ => {
            let mut whole = Vec::with_capacity(left.len() + right.len());
            for (left, right) in
                left.chunks_exact(3 * left_width as usize).zip(right.chunks_exact(3 * right_width as usize))
            {
                whole.extend_from_slice(left);
                whole.extend_from_slice(right);
            }
            whole
        }
    }
}

/// Encodes the colours of a frame as [`jpeg`] does bytes.
///
/// # Errors
/// The picture is too large for a JPEG.
pub fn frame_jpeg(frame: &Frame, quality: u8) -> Result<Vec<u8>, JpegError> {
    let size = (frame.width, frame.height);
    jpeg(&to_bytes(frame, ViewOutput::Rgb, 0.0, Dither::Ordered), size, quality)
}

/// Encodes bytes `[H, W, 3]` as a JPEG; at low quality chroma is subsampled 2x2.
///
/// # Errors
/// The picture is too large for a JPEG.
pub fn jpeg(rgb: &[u8], size: (u32, u32), quality: u8) -> Result<Vec<u8>, JpegError> {
    let sampling = if quality >= WHOLE_COLORS { SamplingFactor::F_1_1 } else { SamplingFactor::F_2_2 };
    wm_image::jpeg::encode(rgb, size, quality, sampling)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_output_is_shown() {
        let frame = Frame {
            width: 2,
            height: 1,
            rgb: vec![0.0, 0.5, 1.0, 2.0, -1.0, f32::NAN],
            alpha: vec![0.0, 1.0],
            depth: vec![0.0, 10.0],
            normal: vec![-1.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            ..Frame::default()
        };
        let of = |output| to_bytes(&frame, output, 10.0, Dither::Off);
        assert_eq!(of(ViewOutput::Rgb), [0, 128, 255, 255, 0, 0]);
        assert_eq!(of(ViewOutput::Alpha), [0, 0, 0, 255, 255, 255]);
        assert_eq!(of(ViewOutput::Normal), [0, 128, 255, 128, 128, 128]);
        assert_eq!(of(ViewOutput::Depth)[..3], [0; 3]);
        assert_eq!(of(ViewOutput::Depth)[3..], turbo(128.0 / 255.0));
    }

    #[test]
    fn halves_make_a_whole() {
        assert_eq!(
            join_columns((vec![1, 1, 1, 4, 4, 4], 1), (vec![2, 2, 2, 3, 3, 3, 5, 5, 5, 6, 6, 6], 2)),
            [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 5, 5, 6, 6, 6]
        );
        assert_eq!(join_columns((vec![], 0), (vec![2, 2, 2], 1)), [2, 2, 2]);
    }

    #[test]
    fn jpegs_are_jpegs() {
        for quality in [40, 95] {
            assert!(jpeg(&[90; 3 * 33 * 17], (33, 17), quality).unwrap().starts_with(&[0xff, 0xd8, 0xff]));
        }
    }
}
