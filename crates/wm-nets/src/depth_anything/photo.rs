//! From a photo to what the network takes, as Hugging Face's image processor for it does (`DPTImageProcessor`
//! of transformers, on Pillow): resized in 8 bit, then each channel with ImageNet's mean and deviation taken out.
//!
//! Resizing is Pillow's, which keeps it the same on every machine: cubic convolution with a = -0.5, widened where
//! the photo becomes smaller; first along rows, then along columns, each with weights of 22 bit and rounded to 8
//! bit. Newer versions of transformers resize by torchvision where it is installed, which differs by one level of
//! 255 in about one value of 250.

use super::PhotoError;
use super::ops::Image;
use rayon::prelude::*;

/// Pixels of a patch's side.
pub const PATCH: usize = 14;
/// Mean and deviation of ImageNet, red, green, blue.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Bits behind the point of Pillow's weights.
const BITS: u32 = 22;

/// Width and height that the network takes of a photo, px: the one of its sides that has to change less becomes
/// `side`, so the longer one of a small photo; both are rounded to whole patches, halves to the even one.
///
/// # Errors
/// [`PhotoError`] if the photo is below a patch, or so long that the network would see it out of proportion or need
/// more memory than [`LONGEST`](super::LONGEST) allows.
pub fn size(width: usize, height: usize, side: usize) -> Result<(usize, usize), PhotoError> {
    if width.min(height) < PATCH {
        return Err(PhotoError::Small { width, height });
    }
    if width.max(height) > super::LONGEST * width.min(height) {
        return Err(PhotoError::Long { width, height });
    }
    let scales = [width, height].map(|length| side as f64 / length as f64);
    let least = if (1.0 - scales[0]).abs() < (1.0 - scales[1]).abs() { scales[0] } else { scales[1] };
    let patches = |length: usize| (least * length as f64 / PATCH as f64).round_ties_even();
    Ok((patches(width) as usize * PATCH, patches(height) as usize * PATCH))
}

/// A photo, `[H, W, 3]`, 0-1, display-referred, at another size and normalised. What is not in 0-1 is clamped,
/// NaN is 0.
pub fn normalized(rgb: &[f32], (width, height): (usize, usize), to: (usize, usize)) -> Image {
    let levels: Vec<u8> = rgb.par_iter().map(|value| (255.0 * value).round() as u8).collect();
    let levels = resized(levels, (width, height), to);
    let tables: [[f32; 256]; 3] = std::array::from_fn(|lane| {
        std::array::from_fn(|level| ((level as f64 * (1.0 / 255.0)) as f32 - MEAN[lane]) / DEVIATION[lane])
    });
    let value = |(index, level): (usize, &u8)| tables[index % 3][usize::from(*level)];
    let values = levels.par_iter().enumerate().map(value).collect();
    Image { values, width: to.0, height: to.1, channels: 3 }
}

/// What one value takes of a row or column: from `first` on, each with a weight times 2^[`BITS`].
struct Weights {
    first: usize,
    weights: Vec<i32>,
}

/// Pillow's resizing of `[H, W, 3]`.
fn resized(mut levels: Vec<u8>, (width, height): (usize, usize), to: (usize, usize)) -> Vec<u8> {
    if to.0 != width {
        let all = weights(width, to.0);
        let mut rows = vec![0; 3 * to.0 * height];
        rows.par_chunks_mut(3 * to.0).zip(levels.par_chunks(3 * width)).for_each(|(row, from)| {
            for (pixel, Weights { first, weights }) in row.chunks_exact_mut(3).zip(&all) {
                let sums = (0..3).map(|lane| {
                    let from = from[3 * first + lane..].iter().step_by(3);
                    weights.iter().zip(from).map(|(weight, level)| weight * i32::from(*level)).sum()
                });
                pixel.iter_mut().zip(sums).for_each(|(level, sum)| *level = rounded(sum));
            }
        });
        levels = rows;
    }
    if to.1 != height {
        let all = weights(height, to.1);
        let one = 3 * to.0;
        let mut rows = vec![0; one * to.1];
        rows.par_chunks_mut(one).zip(&all).for_each(|(row, Weights { first, weights })| {
            let mut sums = vec![0; one];
            for (weight, from) in weights.iter().zip(levels[first * one..].chunks_exact(one)) {
                sums.iter_mut().zip(from).for_each(|(sum, level)| *sum += weight * i32::from(*level));
            }
            row.iter_mut().zip(sums).for_each(|(level, sum)| *level = rounded(sum));
        });
        levels = rows;
    }
    levels
}

fn rounded(sum: i32) -> u8 {
    ((sum + (1 << (BITS - 1))) >> BITS).clamp(0, 255) as u8
}

/// The weights of each value of a row or column that goes from `from` to `to` of them.
fn weights(from: usize, to: usize) -> Vec<Weights> {
    let scale = from as f64 / to as f64;
    let wide = scale.max(1.0);
    // The filter is 0 from there on.
    let reach = 2.0 * wide;
    let of = |at: usize| {
        let center = (at as f64 + 0.5) * scale;
        let first = ((center - reach + 0.5).max(0.0)) as usize;
        let end = ((center + reach + 0.5) as usize).min(from);
        let exact: Vec<f64> = (first..end).map(|place| cubic((place as f64 - center + 0.5) / wide)).collect();
        let sum: f64 = exact.iter().sum();
        let fixed = |weight: &f64| (weight / sum * f64::from(1 << BITS)).round() as i32;
        Weights { first, weights: exact.iter().map(fixed).collect() }
    };
    (0..to).map(of).collect()
}

/// The kernel of cubic convolution with a = -0.5.
fn cubic(x: f64) -> f64 {
    const A: f64 = -0.5;
    match x.abs() {
        x if x < 1.0 => ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0,
        x if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * A,
        _ => 0.0,
    }
}
