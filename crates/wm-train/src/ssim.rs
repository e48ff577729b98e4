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

use fearless_simd::{SimdBase, SimdFloat};
use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};

/// Radius of the window, px.
const RADIUS: usize = 5;
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
const C1: f32 = 0.01 * 0.01;
const C2: f32 = 0.03 * 0.03;

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
    x: Vec<f32>,
    y: Vec<f32>,
    /// dS/dmx, dS/dexx, dS/dexy: padded rows of three, `[H, 3, P]`.
    slopes: Vec<f32>,
    rows: Vec<f64>,
}

/// How rows lie in memory.
#[derive(Clone, Copy)]
struct Layout {
    /// Values of a row.
    line: usize,
    /// Values of a row with its margins, whole vectors.
    padded: usize,
    /// Rows.
    rows: usize,
}

impl Layout {
    fn of(values: usize, width: usize) -> Self {
        let line = width * CHANNELS;
        Self { line, padded: line.next_multiple_of(WIDEST) + 2 * MARGIN, rows: values / line }
    }

    /// The rows that the window of `row` reaches, each with its weight.
    #[inline(always)]
    fn window(self, row: usize) -> impl Iterator<Item = (usize, f32)> + Clone {
        let first = row.saturating_sub(RADIUS);
        let last = (row + RADIUS).min(self.rows - 1);
        (first..=last).map(move |at| (at, WINDOW[at + RADIUS - row]))
    }

    /// Where vectors of `lanes` begin that cover a row.
    #[inline(always)]
    fn groups(self, lanes: usize) -> impl Iterator<Item = usize> {
        (MARGIN..MARGIN + self.line).step_by(lanes)
    }
}

impl Ssim {
    /// For pictures of any size, on a SIMD path.
    #[must_use]
    pub fn new(path: SimdPath) -> Self {
        Self { path, x: Vec::new(), y: Vec::new(), slopes: Vec::new(), rows: Vec::new() }
    }

    /// The mean similarity of `x` and `y`, `[H, W, 3]` with values about 0-1.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub fn value(&mut self, x: &[f32], y: &[f32], width: usize) -> f64 {
        self.forward(x, y, width, None) / x.len() as f64
    }

    /// The mean similarity over the pixels that count by `mask`, `[H, W]` with values 0-1; 1 if none does.
    ///
    /// Beyond the mask both pictures are black, as beyond the border: what lies there does not matter, every
    /// pixel that counts is compared, and a mask of a rectangle gives what the rectangle alone would.
    ///
    /// # Panics
    /// If the sizes differ or are no rows of `width`.
    pub fn masked_value(&mut self, x: &[f32], y: &[f32], mask: &[f32], width: usize) -> f64 {
        assert_eq!(x.len(), CHANNELS * mask.len(), "a picture and its mask");
        let counted: f64 = mask.iter().map(|v| f64::from(*v)).sum();
        if counted == 0.0 {
            return 1.0;
        }
        let within = |rgb: &[f32]| -> Vec<f32> {
            rgb.iter().enumerate().map(|(i, v)| v * mask[i / CHANNELS]).collect()
        };
        self.forward(&within(x), &within(y), width, Some(mask)) / (CHANNELS as f64 * counted)
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
        let value = self.forward(x, y, width, None) / x.len() as f64;
        let layout = Layout::of(x.len(), width);
        let scale = scale / x.len() as f32;
        let (slopes, path) = (&self.slopes[..], self.path);
        let pictures = self.x.par_chunks(layout.padded).zip(self.y.par_chunks(layout.padded));
        let rows = gradient.par_chunks_mut(layout.line).zip(pictures).enumerate();
        rows.for_each_init(Vec::new, |buffer, (row, (gradient, (x, y)))| {
            dispatch!(path, simd => backward_row(simd, row, layout, slopes, [x, y], scale, gradient, buffer));
        });
        value
    }

    /// The sum of the similarities of all pixels and channels, each times what its pixel counts.
    fn forward(&mut self, x: &[f32], y: &[f32], width: usize, counts: Option<&[f32]>) -> f64 {
        let line = width * CHANNELS;
        assert!(x.len() == y.len() && line > 0 && x.len().is_multiple_of(line), "two pictures of one size");
        let layout = Layout::of(x.len(), width);
        let all = layout.padded * layout.rows;
        for (padded, picture) in [(&mut self.x, x), (&mut self.y, y)] {
            padded.resize(all, 0.0);
            padded.par_chunks_mut(layout.padded).zip(picture.par_chunks(line)).for_each(|(padded, row)| {
                padded[..MARGIN].fill(0.0);
                padded[MARGIN..MARGIN + line].copy_from_slice(row);
                padded[MARGIN + line..].fill(0.0);
            });
        }
        self.slopes.resize(3 * all, 0.0);
        self.rows.resize(layout.rows, 0.0);
        let (path, x, y) = (self.path, &self.x[..], &self.y[..]);
        let rows = self.slopes.par_chunks_mut(3 * layout.padded).zip(&mut self.rows).enumerate();
        rows.for_each_init(Vec::new, |buffer, (row, (slopes, sum))| {
            let counts = counts.map(|counts| &counts[row * width..(row + 1) * width]);
            *sum = dispatch!(path, simd => forward_row(simd, row, layout, [x, y], counts, slopes, buffer));
        });
        self.rows.iter().sum()
    }
}

/// Cuts N rows out of `buffer`, margins zero.
#[inline(always)]
fn cut<const N: usize>(buffer: &mut Vec<f32>, size: usize) -> [&mut [f32]; N] {
    buffer.resize(N * size, 0.0);
    let mut parts = buffer.chunks_exact_mut(size);
    std::array::from_fn(|_| {
        let part = parts.next().unwrap_or_default();
        part[..MARGIN].fill(0.0);
        part[size - MARGIN..].fill(0.0);
        part
    })
}

/// The windows along N rows for the vector at `at`.
#[inline(always)]
fn along<S: Lanes, const N: usize>(simd: S, rows: &[&mut [f32]; N], at: usize) -> [S::F; N] {
    let mut sums = [simd.set(0.0); N];
    for (tap, weight) in WINDOW.iter().enumerate() {
        let (weight, from) = (simd.set(*weight), at - REACH + CHANNELS * tap);
        for k in 0..N {
            sums[k] = weight.mul_add(simd.load(&rows[k][from..]), sums[k]);
        }
    }
    sums
}

#[inline(always)]
fn forward_row<S: Lanes>(
    simd: S,
    row: usize,
    layout: Layout,
    [x, y]: [&[f32]; 2],
    counts: Option<&[f32]>,
    slopes: &mut [f32],
    buffer: &mut Vec<f32>,
) -> f64 {
    // The windowed means of x, y, x^2 + y^2 and x y: down the columns, then along the row.
    let columns = cut::<4>(buffer, layout.padded);
    for at in layout.groups(S::N) {
        let mut sums = [simd.set(0.0); 4];
        for (row, weight) in layout.window(row) {
            let from = row * layout.padded + at;
            let (x, y, weight) = (simd.load(&x[from..]), simd.load(&y[from..]), simd.set(weight));
            let (wx, wy) = (weight * x, weight * y);
            sums[0] += wx;
            sums[1] += wy;
            sums[2] = wx.mul_add(x, wy.mul_add(y, sums[2]));
            sums[3] = wx.mul_add(y, sums[3]);
        }
        for k in 0..4 {
            sums[k].store_slice(&mut columns[k][at..at + S::N]);
        }
    }
    let (mean, rest) = slopes.split_at_mut(layout.padded);
    let (square, product) = rest.split_at_mut(layout.padded);
    let mut total = 0.0;
    let (one, two) = (simd.set(1.0), simd.set(2.0));
    for at in layout.groups(S::N) {
        let [mx, my, squares, xy] = along(simd, &columns, at);
        let (means, cross) = (mx.mul_add(mx, my * my), mx * my);
        let (a1, a2) = (two.mul_add(cross, simd.set(C1)), two.mul_add(xy - cross, simd.set(C2)));
        // Variances are not below 0 but for rounding.
        let b1 = means + simd.set(C1);
        let b2 = (squares - means).max(simd.set(0.0)) + simd.set(C2);
        let (over1, over2) = (one / b1, one / b2);
        let over = over1 * over2;
        let s = a1 * a2 * over;
        (two * my * (a2 - a1) * over - two * mx * s * (over1 - over2)).store_slice(&mut mean[at..at + S::N]);
        (-(s * over2)).store_slice(&mut square[at..at + S::N]);
        (two * a1 * over).store_slice(&mut product[at..at + S::N]);
        let mut values = [0.0; WIDEST];
        s.store_slice(&mut values[..S::N]);
        let inside = (MARGIN + layout.line - at).min(S::N);
        if let Some(counts) = counts {
            for (i, value) in values[..inside].iter_mut().enumerate() {
                *value *= counts[(at - MARGIN + i) / CHANNELS];
            }
        }
        total += f64::from(values[..inside].iter().sum::<f32>());
    }
    // Beyond the picture nothing is compared.
    for part in [mean, square, product] {
        part[..MARGIN].fill(0.0);
        part[MARGIN + layout.line..].fill(0.0);
    }
    total
}

#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "one row's slices and its working memory")]
fn backward_row<S: Lanes>(
    simd: S,
    row: usize,
    layout: Layout,
    slopes: &[f32],
    [x, y]: [&[f32]; 2],
    scale: f32,
    gradient: &mut [f32],
    buffer: &mut Vec<f32>,
) {
    let columns = cut::<3>(buffer, layout.padded);
    for at in layout.groups(S::N) {
        let mut sums = [simd.set(0.0); 3];
        for (row, weight) in layout.window(row) {
            let weight = simd.set(weight);
            for k in 0..3 {
                let slope = simd.load(&slopes[(3 * row + k) * layout.padded + at..]);
                sums[k] = weight.mul_add(slope, sums[k]);
            }
        }
        for k in 0..3 {
            sums[k].store_slice(&mut columns[k][at..at + S::N]);
        }
    }
    let (scale, two) = (simd.set(scale), simd.set(2.0));
    for at in layout.groups(S::N) {
        let [mean, square, product] = along(simd, &columns, at);
        let (x, y) = (simd.load(&x[at..]), simd.load(&y[at..]));
        let mut added = [0.0; WIDEST];
        (scale * (two * x).mul_add(square, y.mul_add(product, mean))).store_slice(&mut added[..S::N]);
        for (gradient, added) in gradient[at - MARGIN..].iter_mut().zip(&added[..S::N]) {
            *gradient += added;
        }
    }
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
            for (width, height) in [(23, 17), (3, 40), (41, 2)] {
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
            assert_eq!(
                ssim.masked_value(&x, &mixed, &vec![1.0; mask.len()], width),
                ssim.value(&x, &mixed, width)
            );
            assert_eq!(ssim.masked_value(&x, &mixed, &vec![0.0; mask.len()], width), 1.0);
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
