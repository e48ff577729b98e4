//! Structural similarity of pictures, and its derivative.
//!
//! SSIM as published (Wang et al. 2004): a Gaussian window of 11 px and standard deviation 1.5, applied as
//! rows and columns, zero beyond the border; constants 0.01^2 and 0.03^2 for values 0-1; the mean over
//! all pixels and channels. With the windowed means `m`, and `e` of products,
//! `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`.
//!
//! The derivative by `x` is that of `S` by `mx`, `exx` and `exy`, windowed again:
//! `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`. Every row of pixels is summed alike wherever bands of rows
//! begin, so bytes do not depend on threads. Pictures are interleaved, `[H, W, 3]`: a window along a row
//! takes every third value.
//!
//! A band goes down its rows a few at a time. Their windows share the rows that they read, and the
//! derivatives of `S` stay in the second cache until the windows of those above have used them.

use fearless_simd::{SimdBase, SimdFloat};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::stages::compare::{C1, C2, RADIUS, WINDOW};

/// Pixels of the window along a side.
const TAPS: usize = 2 * RADIUS + 1;
/// Channels of a pixel.
const CHANNELS: usize = 3;
/// Values that the window reaches to each side of a row.
const REACH: usize = CHANNELS * RADIUS;
/// Zeros before and after a row: the reach, and whole vectors.
const MARGIN: usize = 16;
/// Widest vector.
const WIDEST: usize = 16;
/// Rows that are windowed together: they share most of what they read.
const TOGETHER: usize = 4;
/// Rows of a band: the slopes of ten more are made for it.
const BAND: usize = 64;
/// Rows under the windows of rows together.
const REACHED: usize = TOGETHER + 2 * RADIUS;
/// Rows of slopes that are kept: those, and those made meanwhile.
const KEPT: usize = REACHED + TOGETHER;

/// Structural similarity with its working memory.
#[derive(Clone, Debug)]
pub struct Ssim {
    path: SimdPath,
    /// One a thread.
    bands: Vec<Band>,
}

/// Two pictures, rows of `wide` values of which the first `line` are theirs.
#[derive(Clone, Copy)]
struct Pictures<'a> {
    x: &'a [f32],
    y: &'a [f32],
    /// The weight of each pixel, where not all are equal.
    counts: Option<&'a [f32]>,
    /// Values of a row that are of the picture.
    line: usize,
    /// Values of a row: at least one vector.
    wide: usize,
    rows: usize,
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

    /// The mean similarity over the pixels that count by `mask`, `[H, W]` with values 0-1; 1 if none does.
    ///
    /// Beyond the mask both pictures are black, as beyond the border: what lies there does not matter, every
    /// pixel that counts is compared, and a mask of a rectangle gives what the rectangle alone would.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    #[must_use]
    pub fn masked_value(&mut self, x: &[f32], y: &[f32], mask: &[f32], width: usize) -> f64 {
        assert_eq!(x.len(), CHANNELS * mask.len(), "a picture and its mask");
        let counted: f64 = mask.iter().map(|v| f64::from(*v)).sum();
        if counted == 0.0 {
            return 1.0;
        }
        self.sum(&within(mask, x), &within(mask, y), width, Some(mask), None) / (CHANNELS as f64 * counted)
    }

    /// The mean similarity, and `scale` times its derivative by each value of `x` added to `gradient`.
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
        let widened = (line < WIDEST).then(|| [x, y].map(|picture| widened(picture, line)));
        let pictures = match &widened {
            None => Pictures { x, y, counts, line, wide: line, rows },
            Some([x, y]) => Pictures { x, y, counts, line, wide: WIDEST, rows },
        };
        let path = self.path;
        let mut sums = vec![0.0; rows];
        let (scale, gradient) = gradient.unwrap_or((0.0, &mut []));
        let gradients = gradient.chunks_mut(BAND * line).map(Some).chain(std::iter::repeat_with(|| None));
        // Each thread takes the next band as soon as it is done with one, with memory that it keeps.
        let waiting = Mutex::new((0..).step_by(BAND).zip(sums.chunks_mut(BAND)).zip(gradients));
        self.bands.resize_with(rayon::current_num_threads(), Band::default);
        self.bands.par_iter_mut().with_max_len(1).for_each(|band| {
            while let Some(((first, sums), gradient)) = next(&waiting) {
                match gradient {
                    None => dispatch!(path, simd => band.forward(simd, pictures, first, sums)),
                    Some(gradient) => {
                        dispatch!(path, simd => band.both(simd, pictures, first, sums, scale, gradient));
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
    let mut wide = vec![0.0; picture.len() / line * WIDEST];
    for (wide, row) in wide.chunks_exact_mut(WIDEST).zip(picture.chunks_exact(line)) {
        wide[..line].copy_from_slice(row);
    }
    wide
}

/// Working memory of a band.
#[derive(Clone, Debug, Default)]
struct Band {
    /// Rows windowed down the columns, margins zero, `[TOGETHER, 4, P]`.
    columns: Vec<f32>,
    /// dS/dmx, dS/dexx, dS/dexy of the last rows, `[KEPT, 3, wide]`; row `r` lies at `r % KEPT`.
    slopes: Vec<f32>,
    /// Stands for rows beyond the picture.
    zeros: Vec<f32>,
}

/// Returns the starts of vectors of `lanes` that cover `wide` values: the last one ends where they end. With the
/// lanes that are new in it.
#[inline(always)]
fn groups(wide: usize, lanes: usize) -> impl Iterator<Item = (usize, usize)> {
    let whole = wide / lanes * lanes;
    let last = (whole < wide).then(|| (wide - lanes, lanes - (wide - whole)));
    (0..whole).step_by(lanes).map(|at| (at, 0)).chain(last)
}

/// The rows that the windows of [`TOGETHER`] rows from `first` on read; zeros for those beyond the picture.
#[inline(always)]
fn reached<'a>(picture: &'a [f32], first: usize, rows: usize, zeros: &'a [f32]) -> [&'a [f32]; REACHED] {
    let wide = zeros.len();
    std::array::from_fn(|i| match (first + i).checked_sub(RADIUS) {
        Some(at) if at < rows => &picture[at * wide..(at + 1) * wide],
        _ => zeros,
    })
}

impl Band {
    fn prepare(&mut self, wide: usize) {
        let padded = wide + 2 * MARGIN;
        // Margins are written once: the windows write between them.
        if self.zeros.len() != wide {
            *self = Self {
                columns: vec![0.0; TOGETHER * 4 * padded],
                slopes: vec![0.0; KEPT * 3 * wide],
                zeros: vec![0.0; wide],
            };
        }
    }

    /// Sums of similarity of the rows from `first` on.
    #[inline(always)]
    fn forward<S: Lanes>(&mut self, simd: S, pictures: Pictures<'_>, first: usize, sums: &mut [f64]) {
        self.prepare(pictures.wide);
        for (index, sums) in sums.chunks_mut(TOGETHER).enumerate() {
            let from = first + index * TOGETHER;
            let mut all = [0.0; TOGETHER];
            self.slopes(simd, pictures, from, &mut all);
            sums.copy_from_slice(&all[..sums.len()]);
        }
    }

    /// The same, and `scale` times the derivative added to `gradient`, the same rows.
    #[inline(always)]
    fn both<S: Lanes>(
        &mut self,
        simd: S,
        pictures: Pictures<'_>,
        first: usize,
        sums: &mut [f64],
        scale: f32,
        gradient: &mut [f32],
    ) {
        self.prepare(pictures.wide);
        let end = first + sums.len();
        let mut made = first.saturating_sub(RADIUS);
        for (index, gradient) in gradient.chunks_mut(TOGETHER * pictures.line).enumerate() {
            let from = first + index * TOGETHER;
            while made < (from + TOGETHER + RADIUS).min(pictures.rows) {
                let mut all = [0.0; TOGETHER];
                self.slopes(simd, pictures, made, &mut all);
                for (row, sum) in (made..).zip(all) {
                    if (first..end).contains(&row) {
                        sums[row - first] = sum;
                    }
                }
                made += TOGETHER;
            }
            self.gradient(simd, pictures, from, scale, gradient);
        }
    }

    /// Slopes of the [`TOGETHER`] rows from `first` on, as far as there are any, and their sums of `S`.
    #[inline(always)]
    fn slopes<S: Lanes>(
        &mut self,
        simd: S,
        pictures: Pictures<'_>,
        first: usize,
        sums: &mut [f64; TOGETHER],
    ) {
        let Pictures { x, y, counts, line, wide, rows } = pictures;
        let padded = wide + 2 * MARGIN;
        let (x, y) = (reached(x, first, rows, &self.zeros), reached(y, first, rows, &self.zeros));
        // The windowed means of x, y, x^2 + y^2 and x y: down the columns, then along the row.
        // Plain loops over memory that is there: closures are not inlined where vectors are.
        let mut column = [[simd.set(0.0); 4]; REACHED];
        for (at, _) in groups(wide, S::N) {
            for (i, column) in column.iter_mut().enumerate() {
                let (x, y) = (simd.load(&x[i][at..]), simd.load(&y[i][at..]));
                *column = [x, y, x.mul_add(x, y * y), x * y];
            }
            let sums = down(simd, &column);
            for (k, sum) in sums.as_flattened().iter().enumerate() {
                sum.store_slice(&mut self.columns[k * padded + MARGIN + at..][..S::N]);
            }
        }
        let (one, two) = (simd.set(1.0), simd.set(2.0));
        let columns = self.columns.chunks_exact(4 * padded);
        for ((row, columns), sum) in (first..rows).zip(columns).zip(sums) {
            let slopes = &mut self.slopes[row % KEPT * 3 * wide..][..3 * wide];
            let (mean, rest) = slopes.split_at_mut(wide);
            let (square, product) = rest.split_at_mut(wide);
            let mut total = simd.set(0.0);
            for (at, seen) in groups(wide, S::N) {
                let [mx, my, squares, xy] = along(simd, columns, padded, at);
                let (means, cross) = (mx.mul_add(mx, my * my), mx * my);
                let (a1, a2) = (two.mul_add(cross, simd.set(C1)), two.mul_add(xy - cross, simd.set(C2)));
                // Variances are not below 0 but for rounding.
                let b1 = means + simd.set(C1);
                let b2 = (squares - means).max(simd.set(0.0)) + simd.set(C2);
                let over = one / (b1 * b2);
                let (over1, over2) = (over * b2, over * b1);
                let s = a1 * a2 * over;
                (two * (my * (a2 - a1)).mul_add(over, -(mx * s * (over1 - over2))))
                    .store_slice(&mut mean[at..at + S::N]);
                (-(s * over2)).store_slice(&mut square[at..at + S::N]);
                (two * a1 * over).store_slice(&mut product[at..at + S::N]);
                if seen == 0 && at + S::N <= line && counts.is_none() {
                    total += s;
                } else {
                    let mut values = [0.0; WIDEST];
                    s.store_slice(&mut values[..S::N]);
                    let inside = line.saturating_sub(at).min(S::N);
                    if let Some(counts) = counts {
                        let counts = &counts[row * line / CHANNELS..];
                        for (i, value) in values[..inside].iter_mut().enumerate() {
                            *value *= counts[(at + i) / CHANNELS];
                        }
                    }
                    *sum += values[seen.min(inside)..inside].iter().map(|v| f64::from(*v)).sum::<f64>();
                }
            }
            let mut values = [0.0; WIDEST];
            total.store_slice(&mut values[..S::N]);
            *sum += values[..S::N].iter().map(|v| f64::from(*v)).sum::<f64>();
            // Beyond the picture nothing is compared.
            for part in [mean, square, product] {
                part[line..].fill(0.0);
            }
        }
    }

    /// Adds the derivative of the rows from `first` on, [`TOGETHER`] of them or as many as `gradient` has.
    #[inline(always)]
    fn gradient<S: Lanes>(
        &mut self,
        simd: S,
        pictures: Pictures<'_>,
        first: usize,
        scale: f32,
        gradient: &mut [f32],
    ) {
        let Pictures { x, y, line, wide, rows, .. } = pictures;
        let padded = wide + 2 * MARGIN;
        let slopes = &self.slopes;
        let nothing = [&self.zeros[..]; 3];
        let reached: [[&[f32]; 3]; REACHED] =
            std::array::from_fn(|i| match (first + i).checked_sub(RADIUS) {
                Some(at) if at < rows => {
                    std::array::from_fn(|k| &slopes[(at % KEPT * 3 + k) * wide..][..wide])
                }
                _ => nothing,
            });
        let mut column = [[simd.set(0.0); 3]; REACHED];
        for (at, _) in groups(wide, S::N) {
            for (column, rows) in column.iter_mut().zip(&reached) {
                for (value, row) in column.iter_mut().zip(rows) {
                    *value = simd.load(&row[at..]);
                }
            }
            let sums = down(simd, &column);
            for (row, sums) in sums.iter().enumerate() {
                for (k, sum) in sums.iter().enumerate() {
                    sum.store_slice(&mut self.columns[(4 * row + k) * padded + MARGIN + at..][..S::N]);
                }
            }
        }
        let (scale, two) = (simd.set(scale), simd.set(2.0));
        let columns = self.columns.chunks_exact(4 * padded);
        for ((row, columns), gradient) in (first..).zip(columns).zip(gradient.chunks_exact_mut(line)) {
            let (x, y) = (&x[row * wide..], &y[row * wide..]);
            for (at, seen) in groups(wide, S::N) {
                let [mean, square, product] = along(simd, columns, padded, at);
                let (x, y) = (simd.load(&x[at..]), simd.load(&y[at..]));
                let slope = scale * (two * x).mul_add(square, y.mul_add(product, mean));
                if seen == 0 && at + S::N <= line {
                    let gradient = &mut gradient[at..at + S::N];
                    (simd.load(gradient) + slope).store_slice(gradient);
                } else {
                    let mut added = [0.0; WIDEST];
                    slope.store_slice(&mut added[..S::N]);
                    for (gradient, added) in gradient[at..].iter_mut().zip(&added[..S::N]).skip(seen) {
                        *gradient += added;
                    }
                }
            }
        }
    }
}

/// The windows down the rows of N quantities, for each of the rows together.
#[inline(always)]
fn down<S: Lanes, const N: usize>(simd: S, column: &[[S::F; N]; REACHED]) -> [[S::F; N]; TOGETHER] {
    let mut sums = [[simd.set(0.0); N]; TOGETHER];
    for (row, sums) in sums.iter_mut().enumerate() {
        for (weight, values) in WINDOW.iter().zip(&column[row..row + TAPS]) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum = simd.set(*weight).mul_add(*value, *sum);
            }
        }
    }
    sums
}

/// The windows along the first N rows of `columns` for the vector at `at`.
#[inline(always)]
fn along<S: Lanes, const N: usize>(simd: S, columns: &[f32], padded: usize, at: usize) -> [S::F; N] {
    let mut sums = [simd.set(0.0); N];
    let from = MARGIN - REACH + at;
    for (k, sum) in sums.iter_mut().enumerate() {
        let row = &columns[k * padded + from..][..2 * REACH + S::N];
        for (tap, weight) in WINDOW.iter().enumerate() {
            *sum = simd.set(*weight).mul_add(simd.load(&row[CHANNELS * tap..]), *sum);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::random::uniform;

    fn picture(width: usize, height: usize, seed: u64) -> Vec<f32> {
        (0..width * height * 3).map(|i| uniform(seed, i as u64) as f32).collect()
    }

    /// Brute force in f64, straight from the definition.
    fn referee(x: &[f32], y: &[f32], width: usize) -> f64 {
        let height = x.len() / (3 * width);
        let gauss: Vec<f64> = (0..TAPS).map(|t| (-((t as f64 - 5.0) / 1.5).powi(2) / 2.0).exp()).collect();
        let total: f64 = gauss.iter().sum();
        let mut sum = 0.0;
        for row in 0..height {
            for column in 0..width {
                for k in 0..3 {
                    let mut e = [0.0; 5];
                    for (dy, gy) in gauss.iter().enumerate() {
                        for (dx, gx) in gauss.iter().enumerate() {
                            let (Some(r), Some(c)) =
                                ((row + dy).checked_sub(5), (column + dx).checked_sub(5))
                            else {
                                continue;
                            };
                            if r < height && c < width {
                                let at = 3 * (r * width + c) + k;
                                let (w, x, y) = (gx * gy / total / total, f64::from(x[at]), f64::from(y[at]));
                                for (e, v) in e.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                                    *e += w * v;
                                }
                            }
                        }
                    }
                    let [mx, my, xx, yy, xy] = e;
                    let (c1, c2) = (1e-4, 9e-4);
                    sum += (2.0 * mx * my + c1) * (2.0 * (xy - mx * my) + c2)
                        / ((mx * mx + my * my + c1) * (xx - mx * mx + yy - my * my + c2));
                }
            }
        }
        sum / x.len() as f64
    }

    fn paths() -> Vec<SimdPath> {
        SimdPath::available()
    }

    /// f32 sums of 121 products: 1e-6 in the means, up to 1e-4 where variances are as small as the
    /// constants; far less in the mean over a picture.
    #[test]
    fn it_is_what_the_definition_says() {
        for path in paths() {
            // Bands begin again at 64 rows; 3 px are less than a vector.
            for (width, height) in [(23, 17), (3, 40), (41, 2), (6, 150), (5, 131)] {
                let (x, y) = (picture(width, height, 1), picture(width, height, 2));
                let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.7 * x + 0.3 * y).collect();
                let got = Ssim::new(path).value(&x, &mixed, width);
                let want = referee(&x, &mixed, width);
                assert!((got - want).abs() < 1e-5, "{path} {width}x{height}: {got}, want {want}");
                assert!((Ssim::new(path).value(&x, &x, width) - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn what_a_mask_hides_does_not_count() {
        let (width, height, kept) = (40, 21, 23);
        let (x, y) = (picture(width, height, 5), picture(width, height, 6));
        let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.7 * x + 0.3 * y).collect();
        let mask: Vec<f32> = (0..width * height).map(|i| f32::from(u8::from(i % width < kept))).collect();
        let crop = |rgb: &[f32]| -> Vec<f32> {
            rgb.chunks_exact(3 * width).flat_map(|row| &row[..3 * kept]).copied().collect()
        };
        for path in paths() {
            let mut ssim = Ssim::new(path);
            let got = ssim.masked_value(&x, &mixed, &mask, width);
            // The same windows; at most some thousand f32 numbers up to 1 are summed in another order.
            let want = ssim.value(&crop(&x), &crop(&mixed), kept);
            assert!((got - want).abs() < 1e-6, "{path}: {got}, want {want}");
            let garbage = picture(width, height, 7);
            let spoilt: Vec<f32> =
                (0..x.len()).map(|i| if mask[i / 3] == 0.0 { 1e3 * garbage[i] } else { x[i] }).collect();
            assert_eq!(ssim.masked_value(&spoilt, &mixed, &mask, width), got, "{path}");
            let (all, plain) =
                (ssim.masked_value(&x, &mixed, &vec![1.0; mask.len()], width), ssim.value(&x, &mixed, width));
            assert!((all - plain).abs() < 1e-6, "{path}: {all}, want {plain}");
            assert_eq!(ssim.masked_value(&x, &mixed, &vec![0.0; mask.len()], width), 1.0);
        }
    }

    /// Central differences of the f64 referee, step 1e-3: its own error is the third derivative's,
    /// some 1e-6 of a slope of 1; pictures are f32.
    #[test]
    fn its_derivative_is_that_of_the_definition() {
        for (width, height) in [(19, 14), (4, 70)] {
            check_derivative(width, height);
        }
    }

    fn check_derivative(width: usize, height: usize) {
        let (x, y) = (picture(width, height, 3), picture(width, height, 4));
        let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.6 * x + 0.4 * y).collect();
        for path in paths() {
            let mut gradient = vec![0.0; x.len()];
            Ssim::new(path).add_gradient(&mixed, &y, width, 1.0, &mut gradient);
            let (mut off, mut size) = (0.0, 0.0);
            for at in (0..x.len()).step_by(7) {
                let moved = |by: f32| {
                    let mut moved = mixed.clone();
                    moved[at] += by;
                    (referee(&moved, &y, width), f64::from(moved[at]))
                };
                let ((high, above), (low, below)) = (moved(1e-3), moved(-1e-3));
                let want = (high - low) / (above - below);
                off += (f64::from(gradient[at]) - want).powi(2);
                size += want * want;
            }
            assert!((off / size).sqrt() < 1e-4, "{path}: {}", (off / size).sqrt());
        }
    }
}
