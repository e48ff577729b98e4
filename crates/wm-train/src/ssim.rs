//! Structural similarity of pictures, and its derivative.
//!
//! As published (Wang et al. 2004): a Gaussian window of 11 px and standard deviation 1.5, applied as
//! rows and columns, zero beyond the border; constants 0.01^2 and 0.03^2 for values 0-1; the mean over
//! all pixels and channels. With the windowed means `m`, and `e` of products,
//! `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`.
//!
//! The derivative by `x` is that of `S` by `mx`, `exx` and `exy`, windowed again:
//! `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`. Rows of pixels are independent in both passes, so bytes do
//! not depend on threads. Pictures are interleaved, `[H, W, 3]`: a window along a row takes every third
//! value.

use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::SimdPath;

/// Radius of the window, px.
const RADIUS: usize = 5;
/// Pixels of the window along a side.
const TAPS: usize = 2 * RADIUS + 1;
/// Channels of a pixel.
const CHANNELS: usize = 3;
/// Values before and after a row that the window reaches.
const MARGIN: usize = CHANNELS * RADIUS;
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;
/// Values worked on side by side.
const LANES: usize = 16;

/// The window: Gaussian of standard deviation 1.5 px, sum 1.
const WINDOW: [f32; TAPS] = [
    0.001_028_38,
    0.007_598_76,
    0.036_000_77,
    0.109_360_69,
    0.213_005_53,
    0.266_011_72,
    0.213_005_53,
    0.109_360_69,
    0.036_000_77,
    0.007_598_76,
    0.001_028_38,
];

/// Structural similarity with its working memory.
#[derive(Clone, Debug)]
pub struct Ssim {
    path: SimdPath,
    /// dS/dmx, dS/dexx, dS/dexy: rows of three, `[H, 3, W * 3]`.
    slopes: Vec<f32>,
    rows: Vec<f64>,
}

impl Ssim {
    /// For pictures of any size, on a SIMD path.
    #[must_use]
    pub fn new(path: SimdPath) -> Self {
        Self { path, slopes: Vec::new(), rows: Vec::new() }
    }

    /// The mean similarity of `x` and `y`, `[H, W, 3]` with values about 0-1.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub fn value(&mut self, x: &[f32], y: &[f32], width: usize) -> f64 {
        self.forward(x, y, width)
    }

    /// The mean similarity, and `scale` times its derivative by each value of `x` added to `gradient`.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub fn add_gradient(&mut self, x: &[f32], y: &[f32], width: usize, scale: f32, gradient: &mut [f32]) -> f64 {
        assert_eq!(x.len(), gradient.len());
        let value = self.forward(x, y, width);
        let line = width * CHANNELS;
        let scale = scale / x.len() as f32;
        let (slopes, path) = (&self.slopes[..], self.path);
        gradient.par_chunks_mut(line).enumerate().for_each(|(row, gradient)| {
            let at = row * line..(row + 1) * line;
            let (x, y) = (&x[at.clone()], &y[at]);
            dispatch!(path, _simd => backward_row(row, line, slopes, x, y, scale, gradient));
        });
        value
    }

    fn forward(&mut self, x: &[f32], y: &[f32], width: usize) -> f64 {
        let line = width * CHANNELS;
        assert!(x.len() == y.len() && line > 0 && x.len().is_multiple_of(line), "two pictures of one size");
        self.slopes.resize(3 * x.len(), 0.0);
        self.rows.resize(x.len() / line, 0.0);
        let path = self.path;
        let rows = self.slopes.par_chunks_mut(3 * line).zip(&mut self.rows).enumerate();
        rows.for_each(|(row, (slopes, sum))| {
            *sum = dispatch!(path, _simd => forward_row(row, line, x, y, slopes));
        });
        self.rows.iter().sum::<f64>() / x.len() as f64
    }
}

/// Calls `work` for whole groups of lanes that cover `0..line`, the last overlapping the one before; one
/// by one in rows that are shorter than that.
macro_rules! each_group {
    ($line:expr, $work:ident ( $($argument:expr),* )) => {
        if $line >= LANES {
            let mut at = 0;
            while at + LANES <= $line {
                $work::<LANES>(at, $($argument),*);
                at += LANES;
            }
            if at < $line {
                $work::<LANES>($line - LANES, $($argument),*);
            }
        } else {
            for at in 0..$line {
                $work::<1>(at, $($argument),*);
            }
        }
    };
}

/// The rows that the window of `row` reaches, each with its weight.
fn window_rows(row: usize, rows: usize) -> impl Iterator<Item = (usize, f32)> + Clone {
    (0..TAPS).filter_map(move |tap| {
        let at = (row + tap).checked_sub(RADIUS)?;
        (at < rows).then(|| (at, WINDOW[tap]))
    })
}

#[inline(always)]
fn forward_row(row: usize, line: usize, x: &[f32], y: &[f32], slopes: &mut [f32]) -> f64 {
    // The five windowed means down the columns, with a margin of zeros, then along the row.
    let mut columns = vec![0.0; 5 * (line + 2 * MARGIN)];
    let [mx, my, xx, yy, xy] = split::<5>(&mut columns, line + 2 * MARGIN);
    let rows = x.len() / line;
    each_group!(line, moments(row, rows, line, x, y, [&mut *mx, &mut *my, &mut *xx, &mut *yy, &mut *xy]));
    let mut values = vec![0.0; line];
    each_group!(line, similarity(line, [&*mx, &*my, &*xx, &*yy, &*xy], slopes, &mut values));
    let mut sum = 0.0;
    for part in values.chunks(64) {
        sum += f64::from(part.iter().sum::<f32>());
    }
    sum
}

#[inline(always)]
fn split<const N: usize>(all: &mut [f32], size: usize) -> [&mut [f32]; N] {
    let mut parts = all.chunks_exact_mut(size);
    std::array::from_fn(|_| parts.next().unwrap_or_default())
}

#[inline(always)]
fn load<const N: usize>(from: &[f32], at: usize) -> [f32; N] {
    let mut lanes = [0.0; N];
    lanes.copy_from_slice(&from[at..at + N]);
    lanes
}

/// Sums down the columns `at..at + N`: of x, y and their products.
#[inline(always)]
fn moments<const N: usize>(
    at: usize,
    row: usize,
    rows: usize,
    line: usize,
    x: &[f32],
    y: &[f32],
    out: [&mut [f32]; 5],
) {
    let mut sums = [[0.0f32; N]; 5];
    for (row, weight) in window_rows(row, rows) {
        let (x, y) = (load::<N>(x, row * line + at), load::<N>(y, row * line + at));
        for i in 0..N {
            let (wx, wy) = (weight * x[i], weight * y[i]);
            sums[0][i] += wx;
            sums[1][i] += wy;
            sums[2][i] += wx * x[i];
            sums[3][i] += wy * y[i];
            sums[4][i] += wx * y[i];
        }
    }
    for (sums, out) in sums.iter().zip(out) {
        out[MARGIN + at..MARGIN + at + N].copy_from_slice(sums);
    }
}

/// The window along a row whose margin is in front.
#[inline(always)]
fn along<const N: usize>(column: &[f32], at: usize) -> [f32; N] {
    let mut sum = [0.0f32; N];
    for (tap, weight) in WINDOW.iter().enumerate() {
        let values = load::<N>(column, at + CHANNELS * tap);
        for i in 0..N {
            sum[i] += weight * values[i];
        }
    }
    sum
}

#[inline(always)]
fn similarity<const N: usize>(at: usize, line: usize, columns: [&[f32]; 5], slopes: &mut [f32], values: &mut [f32]) {
    let [mx, my, xx, yy, xy] = columns.map(|column| along::<N>(column, at));
    let (mut by_mean, mut by_xx, mut by_xy, mut value) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
    for i in 0..N {
        let (mean2, cross) = (mx[i] * mx[i] + my[i] * my[i], mx[i] * my[i]);
        let (a1, a2) = (2.0 * cross + C1, 2.0 * (xy[i] - cross) + C2);
        // Variances are not below 0 but for rounding.
        let (b1, b2) = (mean2 + C1, (xx[i] + yy[i] - mean2).max(0.0) + C2);
        let (over1, over2) = (1.0 / b1, 1.0 / b2);
        let over = over1 * over2;
        let s = a1 * a2 * over;
        value[i] = s;
        by_mean[i] = 2.0 * my[i] * (a2 - a1) * over - 2.0 * mx[i] * s * (over1 - over2);
        by_xx[i] = -s * over2;
        by_xy[i] = 2.0 * a1 * over;
    }
    values[at..at + N].copy_from_slice(&value);
    slopes[at..at + N].copy_from_slice(&by_mean);
    slopes[line + at..line + at + N].copy_from_slice(&by_xx);
    slopes[2 * line + at..2 * line + at + N].copy_from_slice(&by_xy);
}

#[inline(always)]
fn backward_row(row: usize, line: usize, slopes: &[f32], x: &[f32], y: &[f32], scale: f32, gradient: &mut [f32]) {
    let mut columns = vec![0.0; 3 * (line + 2 * MARGIN)];
    let [mean, xx, xy] = split::<3>(&mut columns, line + 2 * MARGIN);
    let rows = slopes.len() / (3 * line);
    each_group!(line, slope_sums(row, rows, line, slopes, [&mut *mean, &mut *xx, &mut *xy]));
    // An own copy, since overlapping groups must not add twice.
    let mut added = vec![0.0; line];
    each_group!(line, pull([&*mean, &*xx, &*xy], x, y, &mut added));
    for (gradient, added) in gradient.iter_mut().zip(&added) {
        *gradient += scale * added;
    }
}

#[inline(always)]
fn slope_sums<const N: usize>(
    at: usize,
    row: usize,
    rows: usize,
    line: usize,
    slopes: &[f32],
    out: [&mut [f32]; 3],
) {
    let mut sums = [[0.0f32; N]; 3];
    for (row, weight) in window_rows(row, rows) {
        for (k, sums) in sums.iter_mut().enumerate() {
            let values = load::<N>(slopes, (3 * row + k) * line + at);
            for i in 0..N {
                sums[i] += weight * values[i];
            }
        }
    }
    for (sums, out) in sums.iter().zip(out) {
        out[MARGIN + at..MARGIN + at + N].copy_from_slice(sums);
    }
}

#[inline(always)]
fn pull<const N: usize>(at: usize, columns: [&[f32]; 3], x: &[f32], y: &[f32], added: &mut [f32]) {
    let [mean, xx, xy] = columns.map(|column| along::<N>(column, at));
    let (x, y) = (load::<N>(x, at), load::<N>(y, at));
    let mut sum = [0.0; N];
    for i in 0..N {
        sum[i] = mean[i] + 2.0 * x[i] * xx[i] + y[i] * xy[i];
    }
    added[at..at + N].copy_from_slice(&sum);
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::synthetic::uniform;

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
                            let (Some(r), Some(c)) = ((row + dy).checked_sub(5), (column + dx).checked_sub(5)) else {
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
            for (width, height) in [(23, 17), (3, 40), (41, 2)] {
                let (x, y) = (picture(width, height, 1), picture(width, height, 2));
                let mixed: Vec<f32> = x.iter().zip(&y).map(|(x, y)| 0.7 * x + 0.3 * y).collect();
                let got = Ssim::new(path).value(&x, &mixed, width);
                assert!((got - referee(&x, &mixed, width)).abs() < 1e-5, "{path} {got}");
                assert!((Ssim::new(path).value(&x, &x, width) - 1.0).abs() < 1e-6);
            }
        }
    }

    /// Central differences of the f64 referee, step 1e-3: its own error is the third derivative's,
    /// some 1e-6 of a slope of 1; pictures are f32.
    #[test]
    fn its_derivative_is_that_of_the_definition() {
        let (width, height) = (19, 14);
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
