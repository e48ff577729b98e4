//! Structural similarity of pictures, and its derivative.
//!
//! SSIM as published (Wang et al. 2004): a Gaussian window of 11 px and standard deviation 1.5,
//! applied as rows and columns, zero beyond the border; constants 0.01^2 and 0.03^2 for values 0-1;
//! the mean over all pixels and channels. With the windowed means `m`, and `e` of products,
//! `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`.
//!
//! The derivative by `x` is that of `S` by `mx`, `exx` and `exy`, windowed again:
//! `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`. Every row of pixels is summed alike wherever bands of
//! rows begin, so bytes do not depend on threads. Pictures are interleaved, `[H, W, 3]`: a window
//! along a row takes every third value.
//!
//! A band goes down its rows a few at a time. Their windows share the rows that they read, and the
//! derivatives of `S` stay in the second cache until the windows of those above have used them.

mod band;
#[cfg(test)]
mod tests;

use band::{Band, CHANNELS, MAX_LANES, Pictures};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use wm_render::dispatch;
use wm_render::simd::SimdPath;

/// Rows of a band: the slopes of ten more are made for it.
const BAND_ROWS: usize = 64;

/// Structural similarity with its working memory.
#[derive(Clone, Debug)]
pub struct Ssim {
    path: SimdPath,
    /// One a thread.
    bands: Vec<Band>,
}

impl Ssim {
    /// For pictures of any size, on a SIMD path.
    #[must_use]
    pub fn new(path: SimdPath) -> Self {
        Self { path, bands: Vec::new() }
    }

    /// The mean similarity of `x` and `y`, `[H, W, 3]` with values about 0-1.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    #[must_use]
    pub fn value(&mut self, x: &[f32], y: &[f32], width: usize) -> f64 {
        self.sum(x, y, width, None, None) / x.len() as f64
    }

    /// The mean similarity over the pixels that count by `mask`, `[H, W]` with values 0-1; 1 if
    /// none does. Without a mask all count.
    ///
    /// Beyond the mask both pictures are black, as beyond the border: what lies there does not
    /// matter, every pixel that counts is compared, and a mask of a rectangle gives what the
    /// rectangle alone would.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub(crate) fn masked_value(&mut self, x: &[f32], y: &[f32], mask: Option<&[f32]>, width: usize) -> f64 {
        let Some(mask) = mask else { return self.value(x, y, width) };
        assert_eq!(x.len(), CHANNELS * mask.len(), "a picture and its mask");
        let counted: f64 = mask.iter().map(|v| f64::from(*v)).sum();
        if counted == 0.0 {
            return 1.0;
        }
        self.sum(&within(mask, x), &within(mask, y), width, Some(mask), None) / (CHANNELS as f64 * counted)
    }

    /// The mean similarity, and `scale` times its derivative by each value of `x` added to
    /// `gradient`.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub fn add_gradient(
        &mut self,
        x: &[f32],
        y: &[f32],
        width: usize,
        scale: f32,
        gradient: &mut [f32],
    ) -> f64 {
        assert_eq!(x.len(), gradient.len());
        let size = x.len() as f64;
        self.sum(x, y, width, None, Some((scale / size as f32, gradient))) / size
    }

    /// The sum of the similarities of all pixels and channels, each times what its pixel counts.
    fn sum(
        &mut self,
        x: &[f32],
        y: &[f32],
        width: usize,
        counts: Option<&[f32]>,
        gradient: Option<(f32, &mut [f32])>,
    ) -> f64 {
        let line = width * CHANNELS;
        assert!(x.len() == y.len() && line > 0 && x.len().is_multiple_of(line), "two pictures of one size");
        let rows = x.len() / line;
        let widened = (line < MAX_LANES).then(|| [x, y].map(|picture| widened(picture, line)));
        let pictures = match &widened {
            None => Pictures { x, y, counts, line, wide: line, rows },
            Some([x, y]) => Pictures { x, y, counts, line, wide: MAX_LANES, rows },
        };
        let path = self.path;
        let mut sums = vec![0.0; rows];
        let (scale, gradient) = gradient.unwrap_or((0.0, &mut []));
        let gradients =
            gradient.chunks_mut(BAND_ROWS * line).map(Some).chain(std::iter::repeat_with(|| None));
        // Each thread takes the next band as soon as it is done with one, with memory that it
        // keeps.
        let waiting = Mutex::new((0..).step_by(BAND_ROWS).zip(sums.chunks_mut(BAND_ROWS)).zip(gradients));
        self.bands.resize_with(rayon::current_num_threads(), Band::default);
        self.bands.par_iter_mut().with_max_len(1).for_each(|band| {
            while let Some(((first, sums), gradient)) = next(&waiting) {
                match gradient {
                    None => dispatch!(path, simd => band.forward(simd, pictures, first, sums)),
                    Some(gradient) => {
                        dispatch!(path, simd => band.backward(simd, pictures, first, sums, scale, gradient));
                    }
                }
            }
        });
        sums.iter().sum()
    }
}

/// A picture, `[H, W, 3]`, that is black beyond a mask, `[H, W]`.
pub(crate) fn within(mask: &[f32], rgb: &[f32]) -> Vec<f32> {
    rgb.iter().enumerate().map(|(i, v)| v * mask[i / CHANNELS]).collect()
}

/// The next of what waits.
fn next<T>(waiting: &Mutex<impl Iterator<Item = T>>) -> Option<T> {
    waiting.lock().unwrap_or_else(PoisonError::into_inner).next()
}

/// Rows of `line` values with zeros behind, so that each holds a vector.
fn widened(picture: &[f32], line: usize) -> Vec<f32> {
    let mut wide = vec![0.0; picture.len() / line * MAX_LANES];
    for (wide, row) in wide.chunks_exact_mut(MAX_LANES).zip(picture.chunks_exact(line)) {
        wide[..line].copy_from_slice(row);
    }
    wide
}
