//! The operations of networks, over numbers `[pixels, channels]`: the channels of a pixel lie
//! together.
//!
//! Everything with many products is one of candle's matrix products. A convolution is one over the
//! neighbours of each pixel, for a bounded number of pixels at a time. All sums are in an order of
//! their own, whoever adds them, so the number of threads does not change the result.
//!
//! Networks use candle for matrix products alone: resizes, position embeddings, GELU and epsilons
//! of candle-transformers differ from the published code.

use candle_core::{Device, Storage, Tensor};
use rayon::prelude::*;

/// Most values of neighbours that are laid out at a time for a convolution: 8 MiB.
const MAX_NEIGHBOUR_VALUES: usize = 1 << 21;
/// Rows per task.
const BLOCK_ROWS: usize = 16;

/// Features of an image, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    /// `[height, width, channels]`
    pub(crate) values: Vec<f32>,
    /// px.
    pub(crate) width: usize,
    /// px.
    pub(crate) height: usize,
    /// Numbers a pixel.
    pub(crate) channels: usize,
}

/// A matrix with a bias.
#[derive(Debug)]
pub(crate) struct Linear {
    /// `[to, from]`
    weight: Tensor,
    /// `[to]`
    bias: Option<Vec<f32>>,
}

/// The function that follows a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Activation {
    Nothing,
    Relu,
    /// `x / 2 (1 + erf(x / sqrt 2))`
    Gelu,
    /// `x / (1 + exp(-1.702 x))`
    QuickGelu,
}

/// Returns a tensor's numbers, which are f32 on the CPU in all of this crate.
pub(crate) fn numbers(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().and_then(|flat| flat.to_vec1()).expect("numbers that are f32")
}

/// Returns a tensor over numbers, without a copy.
fn matrix(values: Vec<f32>, columns: usize) -> Tensor {
    let rows = values.len() / columns;
    Tensor::from_vec(values, (rows, columns), &Device::Cpu).expect("whole rows")
}

/// `lhs rhs`, `[rows, columns]`, with `f` of each row and its index.
fn product(lhs: &Tensor, rhs: &Tensor, f: impl Fn(usize, &mut [f32]) + Sync) -> Vec<f32> {
    let product = lhs.matmul(rhs).expect("shapes that fit");
    let columns = product.dims()[1];
    let (storage, _) = product.storage_and_layout();
    let Storage::Cpu(storage) = &*storage else { unreachable!("all is on the CPU") };
    let mut values = storage.as_slice::<f32>().expect("numbers that are f32").to_vec();
    values.par_chunks_mut(BLOCK_ROWS * columns).enumerate().for_each(|(block, rows)| {
        for (index, row) in rows.chunks_exact_mut(columns).enumerate() {
            f(block * BLOCK_ROWS + index, row);
        }
    });
    values
}

impl Linear {
    /// `weight` `[to, from]` row by row, `bias` `[to]`.
    pub(crate) fn new(weight: Vec<f32>, bias: Option<Vec<f32>>, from: usize) -> Self {
        Self { weight: matrix(weight, from), bias }
    }

    /// `[rows, from]` to `[rows, to]`.
    pub(crate) fn apply(&self, x: Vec<f32>, then: Activation) -> Vec<f32> {
        let x = matrix(x, self.weight.dims()[1]);
        let transposed = self.weight.t().expect("two dimensions");
        product(&x, &transposed, |_, row| {
            if let Some(bias) = &self.bias {
                row.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
            }
            match then {
                Activation::Nothing => {}
                Activation::Relu => row.iter_mut().for_each(|value| *value = relu(*value)),
                Activation::Gelu => row.iter_mut().for_each(|value| *value = gelu(*value)),
                Activation::QuickGelu => row.iter_mut().for_each(|value| *value = quick_gelu(*value)),
            }
        })
    }

    /// Returns the number of output channels.
    fn to(&self) -> usize {
        self.weight.dims()[0]
    }

    /// Applies the layer to every pixel of an image: a convolution of 1x1 px.
    pub(crate) fn over(&self, image: Image) -> Image {
        let values = self.apply(image.values, Activation::Nothing);
        Image { values, channels: self.to(), ..image }
    }
}

/// NaN stays NaN, unlike in `max`.
fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

fn gelu(x: f32) -> f32 {
    0.5 * x * (1.0 + candle_core::cpu::erf::erf_f32(x * std::f32::consts::FRAC_1_SQRT_2))
}

fn quick_gelu(x: f32) -> f32 {
    x / (1.0 + (-1.702 * x).exp())
}

/// A convolution of 3x3 px with one pixel of zeros around the image.
#[derive(Debug)]
pub(crate) struct Convolution {
    /// From the nine neighbours, row by row, of a pixel.
    linear: Linear,
    stride: usize,
}

impl Convolution {
    /// `weight` `[to, from, 3, 3]`.
    pub(crate) fn new(weight: &[f32], bias: Option<Vec<f32>>, from: usize, stride: usize) -> Self {
        let mut sorted = Vec::with_capacity(weight.len());
        for filter in weight.chunks_exact(9 * from) {
            for place in 0..9 {
                sorted.extend(filter.iter().skip(place).step_by(9));
            }
        }
        Self { linear: Linear::new(sorted, bias, 9 * from), stride }
    }

    /// Applies the layer; the image shrinks by the stride, rounded up.
    pub(crate) fn apply(&self, image: &Image, then: Activation) -> Image {
        let (width, height) = (image.width.div_ceil(self.stride), image.height.div_ceil(self.stride));
        let (pixels, one) = (width * height, 9 * image.channels);
        let at_a_time = (MAX_NEIGHBOUR_VALUES / one).max(1);
        let mut values = Vec::with_capacity(pixels * self.linear.to());
        for start in (0..pixels).step_by(at_a_time) {
            let count = at_a_time.min(pixels - start);
            let mut neighbours = vec![0.0; count * one];
            neighbours.par_chunks_mut(one * BLOCK_ROWS).enumerate().for_each(|(block, chunk)| {
                for (index, nine) in chunk.chunks_exact_mut(one).enumerate() {
                    let pixel = start + block * BLOCK_ROWS + index;
                    image.neighbours(pixel % width * self.stride, pixel / width * self.stride, nine);
                }
            });
            values.extend(self.linear.apply(neighbours, then));
        }
        Image { values, width, height, channels: self.linear.to() }
    }
}

/// A transposed convolution whose stride is its side: each pixel becomes a square of them.
#[derive(Debug)]
pub(crate) struct Enlarge {
    /// To the pixels of the square, row by row.
    linear: Linear,
    side: usize,
}

impl Enlarge {
    /// `weight` `[channels, channels, side, side]`, the first those that come in.
    pub(crate) fn new(weight: &[f32], bias: &[f32], side: usize) -> Self {
        let channels = bias.len();
        let square = side * side;
        let mut sorted = Vec::with_capacity(weight.len());
        for place in 0..square {
            for to in 0..channels {
                sorted.extend((0..channels).map(|from| weight[(from * channels + to) * square + place]));
            }
        }
        Self { linear: Linear::new(sorted, Some(bias.repeat(square)), channels), side }
    }

    /// Applies the layer; the image grows by the side.
    pub(crate) fn apply(&self, image: Image) -> Image {
        let Image { width, height, channels, .. } = image;
        let squares = self.linear.apply(image.values, Activation::Nothing);
        // A row of a square.
        let run = self.side * channels;
        let mut values = vec![0.0; squares.len()];
        values.par_chunks_mut(width * run).enumerate().for_each(|(y, row)| {
            let (y, inside) = (y / self.side, y % self.side);
            for (x, pixels) in row.chunks_exact_mut(run).enumerate() {
                let start = ((y * width + x) * self.side + inside) * run;
                pixels.copy_from_slice(&squares[start..start + run]);
            }
        });
        Image { values, width: self.side * width, height: self.side * height, channels }
    }
}

impl Image {
    /// Copies the channels of the 3x3 px around a pixel into `nine`, which is all 0.
    fn neighbours(&self, x: usize, y: usize, nine: &mut [f32]) {
        let run = 3 * self.channels;
        let (left, right) = (x.saturating_sub(1), (x + 2).min(self.width));
        // At the left edge the first column is missing.
        let skip = (left + 1 - x) * self.channels;
        for (row, three) in nine.chunks_exact_mut(run).enumerate() {
            let Some(y) = (y + row).checked_sub(1).filter(|y| *y < self.height) else { continue };
            let start = (y * self.width + left) * self.channels;
            let length = (right - left) * self.channels;
            three[skip..skip + length].copy_from_slice(&self.values[start..start + length]);
        }
    }

    /// Returns the image with negative values set to 0.
    pub(crate) fn relu(&self) -> Self {
        let values = self.values.par_iter().with_min_len(1 << 14).map(|value| relu(*value)).collect();
        Self { values, ..*self }
    }

    /// Adds another image of the same size.
    pub(crate) fn add(&mut self, other: &Self) {
        assert_eq!(self.values.len(), other.values.len(), "images of one size");
        let pairs = self.values.par_iter_mut().with_min_len(1 << 14).zip(&other.values);
        pairs.for_each(|(value, other)| *value += other);
    }

    /// Resizes bilinearly, with aligned corner pixels.
    pub(crate) fn bilinear(&self, width: usize, height: usize) -> Self {
        let columns = taps(width, |x| linear_taps(x, self.width, width));
        let rows = taps(height, |y| linear_taps(y, self.height, height));
        self.resized(&columns, &rows)
    }

    /// Resizes by cubic convolution with a = -0.75 and aligned edges, without a filter for
    /// reduction; the result may leave the range of the values.
    pub(crate) fn bicubic(&self, width: usize, height: usize) -> Self {
        let columns = taps(width, |x| cubic_taps(x, self.width, width));
        let rows = taps(height, |y| cubic_taps(y, self.height, height));
        self.resized(&columns, &rows)
    }

    /// Weighted sums of `N` columns, then of as many rows.
    fn resized<const N: usize>(&self, columns: &[[Tap; N]], rows: &[[Tap; N]]) -> Self {
        let (channels, width) = (self.channels, columns.len());
        let mut values = vec![0.0; rows.len() * width * channels];
        values.par_chunks_mut(width * channels).zip(rows).for_each(|(line, taps)| {
            for (pixel, columns) in line.chunks_exact_mut(channels).zip(columns) {
                for row in taps {
                    for column in columns {
                        let start = (row.index * self.width + column.index) * channels;
                        let from = &self.values[start..start + channels];
                        let weight = row.weight * column.weight;
                        pixel.iter_mut().zip(from).for_each(|(sum, value)| *sum += weight * value);
                    }
                }
            }
        });
        Self { values, width, height: rows.len(), channels }
    }
}

/// The index and weight of a sample of a resized image.
#[derive(Clone, Copy)]
struct Tap {
    index: usize,
    weight: f32,
}

fn taps<const N: usize>(to: usize, of: impl Fn(usize) -> [Tap; N]) -> Vec<[Tap; N]> {
    (0..to).map(of).collect()
}

fn linear_taps(at: usize, from: usize, to: usize) -> [Tap; 2] {
    let scale = if to > 1 { (from - 1) as f32 / (to - 1) as f32 } else { 0.0 };
    let place = scale * at as f32;
    let index = (place as usize).min(from - 1);
    let weight = place - index as f32;
    [Tap { index, weight: 1.0 - weight }, Tap { index: (index + 1).min(from - 1), weight }]
}

fn cubic_taps(at: usize, from: usize, to: usize) -> [Tap; 4] {
    const A: f32 = -0.75;
    let place = (from as f32 / to as f32) * (at as f32 + 0.5) - 0.5;
    let (first, t) = (place.floor(), place - place.floor());
    let near = |x: f32| ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0;
    let far = |x: f32| ((A * x - 5.0 * A) * x + 8.0 * A) * x - 4.0 * A;
    let weights = [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)];
    std::array::from_fn(|tap| {
        let index = (first as isize + tap as isize - 1).clamp(0, from as isize - 1);
        Tap { index: index.unsigned_abs(), weight: weights[tap] }
    })
}

/// Scale and shift of a layer norm, each `[channels]`.
#[derive(Debug)]
pub(crate) struct Norm {
    pub(crate) scale: Vec<f32>,
    pub(crate) shift: Vec<f32>,
    /// Added to the variance, so that constant rows do not divide by 0.
    pub(crate) epsilon: f64,
}

impl Norm {
    /// `[rows, channels]`, each row with mean 0 and variance 1 before scale and shift.
    pub(crate) fn apply(&self, x: &[f32]) -> Vec<f32> {
        let channels = self.scale.len();
        let mut values = x.to_vec();
        values.par_chunks_mut(channels * BLOCK_ROWS).for_each(|rows| {
            for row in rows.chunks_exact_mut(channels) {
                let mean = row.iter().map(|v| f64::from(*v)).sum::<f64>() / channels as f64;
                let squares = row.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>();
                let inverse = 1.0 / (squares / channels as f64 + self.epsilon).sqrt();
                let scaled = self.scale.iter().zip(&self.shift);
                for (value, (scale, shift)) in row.iter_mut().zip(scaled) {
                    *value = ((f64::from(*value) - mean) * inverse) as f32 * scale + shift;
                }
            }
        });
        values
    }
}

/// Adds `[rows, channels]`, each channel scaled.
pub(crate) fn add_scaled(x: &mut [f32], scale: &[f32], other: &[f32]) {
    let channels = scale.len();
    x.par_chunks_mut(channels * BLOCK_ROWS).zip(other.par_chunks(channels * BLOCK_ROWS)).for_each(
        |(x, other)| {
            for (x, other) in x.chunks_exact_mut(channels).zip(other.chunks_exact(channels)) {
                x.iter_mut().zip(other.iter().zip(scale)).for_each(|(x, (other, scale))| *x += other * scale);
            }
        },
    );
}

/// `softmax(q k^T / sqrt d) v` of each head, `[rows, channels]`. `qkv` is `[rows, 3 channels]`:
/// queries, keys, values, in each the heads side by side.
pub(crate) fn attention(qkv: Vec<f32>, channels: usize, heads: usize) -> Vec<f32> {
    /// Queries at a time, which bounds the memory.
    const BLOCK_QUERIES: usize = 256;
    let (rows, depth) = (qkv.len() / (3 * channels), channels / heads);
    let scale = 1.0 / (depth as f32).sqrt();
    let qkv = matrix(qkv, 3 * channels);
    let part = |column: usize| qkv.narrow(1, column, depth).expect("columns that are there");
    let mut out = vec![0.0; rows * channels];
    for head in 0..heads {
        let [queries, keys, values] = [0, 1, 2].map(|which| part(which * channels + head * depth));
        let keys = keys.t().expect("two dimensions");
        for start in (0..rows).step_by(BLOCK_QUERIES) {
            let some =
                queries.narrow(0, start, BLOCK_QUERIES.min(rows - start)).expect("rows that are there");
            let likeness = product(&some, &keys, |_, row| {
                let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                row.iter_mut().for_each(|value| *value = ((*value - largest) * scale).exp());
                let inverse = 1.0 / row.iter().map(|value| f64::from(*value)).sum::<f64>();
                row.iter_mut().for_each(|value| *value *= inverse as f32);
            });
            let sums = product(&matrix(likeness, rows), &values, |_, _| {});
            for (row, sum) in sums.chunks_exact(depth).enumerate() {
                let to = (start + row) * channels + head * depth;
                out[to..to + depth].copy_from_slice(sum);
            }
        }
    }
    out
}
