//! Pictures resized as Pillow does it, which is the same on every machine: in 8 bit by cubic
//! convolution with a = -0.5, widened where the picture becomes smaller; first along rows, then
//! along columns, each with weights of 22 bit and rounded to 8 bit.

use crate::ops::Image;
use rayon::prelude::*;

/// Fractional bits of the weights.
const WEIGHT_BITS: u32 = 22;

/// The part of a row or column that makes one value: from `first` on, each with a weight times
/// 2^[`WEIGHT_BITS`].
struct Weights {
    first: usize,
    weights: Vec<i32>,
}

/// Resizes a picture, `[H, W, 3]`, to another width and height.
pub(crate) fn resized(mut levels: Vec<u8>, width: usize, height: usize, to: (usize, usize)) -> Vec<u8> {
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

/// Normalises a picture, `[H, W, 3]` of width and height `size`: `share` makes a number of each
/// level, 0-255, from which the channel's mean is subtracted; the rest is divided by its deviation.
pub(crate) fn normalized(
    levels: &[u8],
    size: (usize, usize),
    share: impl Fn(usize) -> f32,
    mean: [f32; 3],
    deviation: [f32; 3],
) -> Image {
    let tables: [[f32; 256]; 3] = std::array::from_fn(|lane| {
        std::array::from_fn(|level| (share(level) - mean[lane]) / deviation[lane])
    });
    let value = |index: usize| tables[index % 3][usize::from(levels[index])];
    let values = (0..levels.len()).into_par_iter().map(value).collect();
    Image { values, width: size.0, height: size.1, channels: 3 }
}

fn rounded(sum: i32) -> u8 {
    ((sum + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS).clamp(0, 255) as u8
}

/// Returns the weights of each value of a row or column that is resized from `from` to `to`
/// values.
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
        let fixed = |weight: &f64| (weight / sum * f64::from(1 << WEIGHT_BITS)).round() as i32;
        Weights { first, weights: exact.iter().map(fixed).collect() }
    };
    (0..to).map(of).collect()
}

/// Returns the kernel of cubic convolution with a = -0.5.
fn cubic(x: f64) -> f64 {
    const CUBIC_A: f64 = -0.5;
    match x.abs() {
        x if x < 1.0 => ((CUBIC_A + 2.0) * x - (CUBIC_A + 3.0)) * x * x + 1.0,
        x if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * CUBIC_A,
        _ => 0.0,
    }
}
