//! From a photo to what the network takes, as Hugging Face's image processor for it does
//! (`DPTImageProcessor` of transformers, on Pillow): resized in 8 bit, then each channel with
//! ImageNet's mean and deviation taken out.
//!
//! Newer versions of transformers resize by torchvision where it is installed, which differs from
//! Pillow by one level of 255 in about one value of 250.

use super::model::{DisparityError, MAX_ASPECT_RATIO, PATCH};
use crate::ops::Image;
use crate::pillow;
use rayon::prelude::*;

/// Mean and deviation of ImageNet, red, green, blue.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// Width and height that the network takes of a photo, px: the one of its sides that has to change
/// less becomes `side`, so the longer one of a small photo; both are rounded to whole patches,
/// halves to the even one.
///
/// # Errors
/// [`DisparityError`] if the photo is below a patch, or so long that the network would see it out
/// of proportion or need more memory than [`MAX_ASPECT_RATIO`] allows.
pub(crate) fn size(width: usize, height: usize, side: usize) -> Result<(usize, usize), DisparityError> {
    if width.min(height) < PATCH {
        return Err(DisparityError::Small { width, height });
    }
    if width.max(height) > MAX_ASPECT_RATIO * width.min(height) {
        return Err(DisparityError::Long { width, height });
    }
    let scales = [width, height].map(|length| side as f64 / length as f64);
    let least = if (1.0 - scales[0]).abs() < (1.0 - scales[1]).abs() { scales[0] } else { scales[1] };
    let patches = |length: usize| (least * length as f64 / PATCH as f64).round_ties_even();
    Ok((patches(width) as usize * PATCH, patches(height) as usize * PATCH))
}

/// A photo, `[H, W, 3]`, 0-1, display-referred, at another size and normalised. What is not in 0-1
/// is clamped, NaN is 0.
pub(crate) fn normalized(rgb: &[f32], width: usize, height: usize, to: (usize, usize)) -> Image {
    let levels: Vec<u8> = rgb.par_iter().map(|value| (255.0 * value).round() as u8).collect();
    let levels = pillow::resized(levels, width, height, to);
    let share = |level| (level as f64 * (1.0 / 255.0)) as f32;
    pillow::normalized(&levels, to, share, MEAN, DEVIATION)
}
