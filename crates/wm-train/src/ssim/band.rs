//! The windows of a band of rows, and the derivative under them.

use fearless_simd::{SimdBase, SimdFloat};
use wm_render::simd::Lanes;
use wm_render::training::{C1, C2, WINDOW_RADIUS_PX, WINDOW_WEIGHTS};

/// Pixels of the window along a side.
pub(super) const TAPS: usize = 2 * WINDOW_RADIUS_PX + 1;
/// Channels of a pixel.
pub(super) const CHANNELS: usize = 3;
/// Values that the window reaches to each side of a row.
const REACH_VALUES: usize = CHANNELS * WINDOW_RADIUS_PX;
/// Zeros before and after a row: the reach, and whole vectors.
const MARGIN_VALUES: usize = 16;
/// Widest vector.
pub(super) const MAX_LANES: usize = 16;
/// Rows that are windowed together: they share most of what they read.
const ROWS_AT_ONCE: usize = 4;
/// Rows under the windows of rows together.
const WINDOW_ROWS: usize = ROWS_AT_ONCE + 2 * WINDOW_RADIUS_PX;
/// Rows of slopes that are kept: those, and those made meanwhile.
const KEPT_ROWS: usize = WINDOW_ROWS + ROWS_AT_ONCE;

/// Two pictures, rows of `wide` values of which the first `line` are theirs.
#[derive(Clone, Copy)]
pub(super) struct Pictures<'a> {
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    /// The weight of each pixel, where not all are equal.
    pub(super) counts: Option<&'a [f32]>,
    /// Values of a row that are of the picture.
    pub(super) line: usize,
    /// Values of a row: at least one vector.
    pub(super) wide: usize,
    pub(super) rows: usize,
}

/// Working memory of a band.
#[derive(Clone, Debug, Default)]
pub(super) struct Band {
    /// Rows windowed down the columns, margins zero, `[ROWS_AT_ONCE, 4, P]`.
    columns: Vec<f32>,
    /// dS/dmx, dS/dexx, dS/dexy of the last rows, `[KEPT_ROWS, 3, wide]`; row `r` lies at `r %
    /// KEPT_ROWS`.
    slopes: Vec<f32>,
    /// Stands for rows beyond the picture.
    zeros: Vec<f32>,
}

/// Returns the starts of vectors of `lanes` that cover `wide` values: the last one ends where they
/// end. With the lanes that are new in it.
#[inline(always)]
fn groups(wide: usize, lanes: usize) -> impl Iterator<Item = (usize, usize)> {
    let whole = wide / lanes * lanes;
    let last = (whole < wide).then(|| (wide - lanes, lanes - (wide - whole)));
    (0..whole).step_by(lanes).map(|at| (at, 0)).chain(last)
}

/// The rows that the windows of [`ROWS_AT_ONCE`] rows from `first` on read; zeros for those beyond
/// the picture.
#[inline(always)]
fn reached<'a>(picture: &'a [f32], first: usize, rows: usize, zeros: &'a [f32]) -> [&'a [f32]; WINDOW_ROWS] {
    let wide = zeros.len();
    std::array::from_fn(|i| match (first + i).checked_sub(WINDOW_RADIUS_PX) {
        Some(at) if at < rows => &picture[at * wide..(at + 1) * wide],
        _ => zeros,
    })
}

impl Band {
    fn prepare(&mut self, wide: usize) {
        let padded = wide + 2 * MARGIN_VALUES;
        // Margins are written once: the windows write between them.
        if self.zeros.len() != wide {
            *self = Self {
                columns: vec![0.0; ROWS_AT_ONCE * 4 * padded],
                slopes: vec![0.0; KEPT_ROWS * 3 * wide],
                zeros: vec![0.0; wide],
            };
        }
    }

    /// Sums of similarity of the rows from `first` on.
    #[inline(always)]
    pub(crate) fn forward<S: Lanes>(
        &mut self,
        simd: S,
        pictures: Pictures<'_>,
        first: usize,
        sums: &mut [f64],
    ) {
        self.prepare(pictures.wide);
        for (index, sums) in sums.chunks_mut(ROWS_AT_ONCE).enumerate() {
            let from = first + index * ROWS_AT_ONCE;
            let mut all = [0.0; ROWS_AT_ONCE];
            self.slopes(simd, pictures, from, &mut all);
            sums.copy_from_slice(&all[..sums.len()]);
        }
    }

    /// Computes the sum over rows, and adds `scale` times its derivative to the same rows of
    /// `gradient`.
    #[inline(always)]
    pub(crate) fn backward<S: Lanes>(
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
        let mut made = first.saturating_sub(WINDOW_RADIUS_PX);
        for (index, gradient) in gradient.chunks_mut(ROWS_AT_ONCE * pictures.line).enumerate() {
            let from = first + index * ROWS_AT_ONCE;
            while made < (from + ROWS_AT_ONCE + WINDOW_RADIUS_PX).min(pictures.rows) {
                let mut all = [0.0; ROWS_AT_ONCE];
                self.slopes(simd, pictures, made, &mut all);
                for (row, sum) in (made..).zip(all) {
                    if (first..end).contains(&row) {
                        sums[row - first] = sum;
                    }
                }
                made += ROWS_AT_ONCE;
            }
            self.gradient(simd, pictures, from, scale, gradient);
        }
    }

    /// Slopes of the [`ROWS_AT_ONCE`] rows from `first` on, as far as there are any, and their sums
    /// of
    /// `S`.
    #[inline(always)]
    fn slopes<S: Lanes>(
        &mut self,
        simd: S,
        pictures: Pictures<'_>,
        first: usize,
        sums: &mut [f64; ROWS_AT_ONCE],
    ) {
        let Pictures { x, y, counts, line, wide, rows } = pictures;
        let padded = wide + 2 * MARGIN_VALUES;
        let (x, y) = (reached(x, first, rows, &self.zeros), reached(y, first, rows, &self.zeros));
        // The windowed means of x, y, x^2 + y^2 and x y: down the columns, then along the row.
        // Plain loops over memory that is there: closures are not inlined where vectors are.
        let mut column = [[simd.set(0.0); 4]; WINDOW_ROWS];
        for (at, _) in groups(wide, S::N) {
            for (i, column) in column.iter_mut().enumerate() {
                let (x, y) = (simd.load(&x[i][at..]), simd.load(&y[i][at..]));
                *column = [x, y, x.mul_add(x, y * y), x * y];
            }
            let sums = down(simd, &column);
            for (k, sum) in sums.as_flattened().iter().enumerate() {
                sum.store_slice(&mut self.columns[k * padded + MARGIN_VALUES + at..][..S::N]);
            }
        }
        let (one, two) = (simd.set(1.0), simd.set(2.0));
        let columns = self.columns.chunks_exact(4 * padded);
        for ((row, columns), sum) in (first..rows).zip(columns).zip(sums) {
            let slopes = &mut self.slopes[row % KEPT_ROWS * 3 * wide..][..3 * wide];
            let (mean, rest) = slopes.split_at_mut(wide);
            let (square, product) = rest.split_at_mut(wide);
            let mut total = simd.set(0.0);
            for (at, seen) in groups(wide, S::N) {
                let [mx, my, squares, xy] = row_windows(simd, columns, padded, at);
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
                    let mut values = [0.0; MAX_LANES];
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
            let mut values = [0.0; MAX_LANES];
            total.store_slice(&mut values[..S::N]);
            *sum += values[..S::N].iter().map(|v| f64::from(*v)).sum::<f64>();
            // Beyond the picture nothing is compared.
            for part in [mean, square, product] {
                part[line..].fill(0.0);
            }
        }
    }

    /// Adds the derivative of the rows from `first` on, [`ROWS_AT_ONCE`] of them or as many as
    /// `gradient` has.
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
        let padded = wide + 2 * MARGIN_VALUES;
        let slopes = &self.slopes;
        let nothing = [&self.zeros[..]; 3];
        let reached: [[&[f32]; 3]; WINDOW_ROWS] =
            std::array::from_fn(|i| match (first + i).checked_sub(WINDOW_RADIUS_PX) {
                Some(at) if at < rows => {
                    std::array::from_fn(|k| &slopes[(at % KEPT_ROWS * 3 + k) * wide..][..wide])
                }
                _ => nothing,
            });
        let mut column = [[simd.set(0.0); 3]; WINDOW_ROWS];
        for (at, _) in groups(wide, S::N) {
            for (column, rows) in column.iter_mut().zip(&reached) {
                for (value, row) in column.iter_mut().zip(rows) {
                    *value = simd.load(&row[at..]);
                }
            }
            let sums = down(simd, &column);
            for (row, sums) in sums.iter().enumerate() {
                for (k, sum) in sums.iter().enumerate() {
                    sum.store_slice(&mut self.columns[(4 * row + k) * padded + MARGIN_VALUES + at..][..S::N]);
                }
            }
        }
        let (scale, two) = (simd.set(scale), simd.set(2.0));
        let columns = self.columns.chunks_exact(4 * padded);
        for ((row, columns), gradient) in (first..).zip(columns).zip(gradient.chunks_exact_mut(line)) {
            let (x, y) = (&x[row * wide..], &y[row * wide..]);
            for (at, seen) in groups(wide, S::N) {
                let [mean, square, product] = row_windows(simd, columns, padded, at);
                let (x, y) = (simd.load(&x[at..]), simd.load(&y[at..]));
                let slope = scale * (two * x).mul_add(square, y.mul_add(product, mean));
                if seen == 0 && at + S::N <= line {
                    let gradient = &mut gradient[at..at + S::N];
                    (simd.load(gradient) + slope).store_slice(gradient);
                } else {
                    let mut added = [0.0; MAX_LANES];
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
fn down<S: Lanes, const N: usize>(simd: S, column: &[[S::F; N]; WINDOW_ROWS]) -> [[S::F; N]; ROWS_AT_ONCE] {
    let mut sums = [[simd.set(0.0); N]; ROWS_AT_ONCE];
    for (row, sums) in sums.iter_mut().enumerate() {
        for (weight, values) in WINDOW_WEIGHTS.iter().zip(&column[row..row + TAPS]) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum = simd.set(*weight).mul_add(*value, *sum);
            }
        }
    }
    sums
}

/// The windows along the first N rows of `columns` for the vector at `at`.
#[inline(always)]
fn row_windows<S: Lanes, const N: usize>(simd: S, columns: &[f32], padded: usize, at: usize) -> [S::F; N] {
    let mut sums = [simd.set(0.0); N];
    let from = MARGIN_VALUES - REACH_VALUES + at;
    for (k, sum) in sums.iter_mut().enumerate() {
        let row = &columns[k * padded + from..][..2 * REACH_VALUES + S::N];
        for (tap, weight) in WINDOW_WEIGHTS.iter().enumerate() {
            *sum = simd.set(*weight).mul_add(simd.load(&row[CHANNELS * tap..]), *sum);
        }
    }
    sums
}
