//! Learned perceptual image patch similarity, LPIPS v0.1 with AlexNet (Zhang et al. 2018, "The
//! unreasonable effectiveness of deep features as a perceptual metric").
//!
//! Pictures in 0-1, display-referred, go to -1..1 and per channel to `(v - shift) / scale`, then
//! through the five convolutions of AlexNet, a maximum over 3x3 px at every second one before the
//! second and third. Of what comes out of each convolution's ReLU, `f` and `g` for the two
//! pictures, with unit length over channels (`f / (|f| + 1e-10)`) at each pixel,
//! `d = sum over layers of mean over pixels of sum over channels of w_c (f_c - g_c)^2`, with the
//! weights `w` that were fitted to people's judgements. 0 for equal pictures; lower is more alike;
//! symmetric.
//!
//! The convolutions are summed in f32, the rest in f64.

#[cfg(test)]
mod tests;

use crate::weights::{Weights, WeightsError};
use candle_core::{Device, Tensor};
use std::path::PathBuf;

/// One of the network's convolutions with its head.
struct Layer {
    /// The index of the convolution in torchvision's `features`.
    place: usize,
    /// Channels that come in and go out.
    channels: (usize, usize),
    /// Side of the kernel, px.
    kernel: usize,
    stride: usize,
    padding: usize,
    /// A maximum that is taken before it.
    pool: Pool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Pool {
    Before,
    None,
}

/// The convolutions of AlexNet as torchvision has them.
const LAYERS: [Layer; 5] = [
    Layer { place: 0, channels: (3, 64), kernel: 11, stride: 4, padding: 2, pool: Pool::None },
    Layer { place: 3, channels: (64, 192), kernel: 5, stride: 1, padding: 2, pool: Pool::Before },
    Layer { place: 6, channels: (192, 384), kernel: 3, stride: 1, padding: 1, pool: Pool::Before },
    Layer { place: 8, channels: (384, 256), kernel: 3, stride: 1, padding: 1, pool: Pool::None },
    Layer { place: 10, channels: (256, 256), kernel: 3, stride: 1, padding: 1, pool: Pool::None },
];
/// Side and stride of the pools.
const POOL_SIDE_PX: usize = 3;
const POOL_STRIDE_PX: usize = 2;
/// Shift and scale of the published network's images, red, green, blue.
const IMAGE_SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const IMAGE_SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Added to the length of features, so that it is never 0.
const EPSILON: f64 = 1e-10;
/// The advice where a tensor is missing or of another shape.
const ADVICE: &str =
    "LPIPS takes torchvision's AlexNet and the heads of lpips v0.1 (alex), in one file or in two";

impl Layer {
    fn weight(&self) -> (String, Vec<usize>) {
        let (from, to) = self.channels;
        (format!("features.{}.weight", self.place), vec![to, from, self.kernel, self.kernel])
    }

    fn bias(&self) -> (String, Vec<usize>) {
        (format!("features.{}.bias", self.place), vec![self.channels.1])
    }

    fn head(&self, index: usize) -> (String, Vec<usize>) {
        (format!("lin{index}.model.1.weight"), vec![1, self.channels.1, 1, 1])
    }
}

/// Names and shapes of the tensors that [`Lpips::read`] looks for: of each convolution weight
/// `[out, in, k, k]`, bias `[out]` and head `[1, out, 1, 1]`.
#[must_use]
pub fn tensors() -> Vec<(String, Vec<usize>)> {
    let of = |index: usize| [LAYERS[index].weight(), LAYERS[index].bias(), LAYERS[index].head(index)];
    (0..LAYERS.len()).flat_map(of).collect()
}

/// The network with its weights.
#[derive(Debug)]
pub struct Lpips {
    convolutions: Vec<Convolution>,
}

#[derive(Debug)]
struct Convolution {
    /// `[out, in, k, k]`
    weight: Tensor,
    /// `[1, out, 1, 1]`
    bias: Tensor,
    /// `[out]`
    head: Vec<f32>,
}

/// The output of a ReLU, `[C, H W]`.
struct Features {
    values: Vec<f32>,
    pixels: usize,
}

impl Lpips {
    /// Shortest side of a picture, px: less leaves nothing to the second maximum.
    pub const MIN_SIDE_PX: usize = 31;

    /// Reads published weights, safetensors or PyTorch's, from one file or several: `features.N.*`
    /// of torchvision's AlexNet and the heads `linN.model.1.weight`.
    ///
    /// # Errors
    /// [`WeightsError`] if a file is no such file or damaged, or a tensor is missing, of another
    /// shape or not finite.
    pub fn read(files: &[PathBuf]) -> Result<Self, WeightsError> {
        let mut weights = Weights::open(files, ADVICE)?;
        let mut tensor = |named: (String, Vec<usize>)| weights.tensor(&named.0, &named.1);
        let mut convolutions = Vec::new();
        for (index, layer) in LAYERS.iter().enumerate() {
            let weight = tensor(layer.weight())?;
            let bias = tensor(layer.bias())?.reshape((1, layer.channels.1, 1, 1)).expect("one a channel");
            let head = tensor(layer.head(index))?.flatten_all().and_then(|head| head.to_vec1());
            convolutions.push(Convolution { weight, bias, head: head.expect("numbers that are f32") });
        }
        Ok(Self { convolutions })
    }

    /// Returns the distance of two pictures, `[H, W, 3]`, display-referred, 0-1 (other values are
    /// clamped). With a mask, `[H, W]`, 0-1, masked pixels are taken from `y` in both pictures;
    /// the mean is still over the whole picture.
    ///
    /// Runs on the threads of the current rayon pool; their number does not change the result.
    ///
    /// # Panics
    /// If the sizes differ, are no rows of `width`, or a side is below [`Self::MIN_SIDE_PX`].
    #[must_use]
    pub fn distance(&self, x: &[f32], y: &[f32], mask: Option<&[f32]>, width: usize) -> f64 {
        assert_eq!(x.len(), y.len(), "two pictures of one size");
        let height = x.len() / (3 * width);
        assert_eq!(x.len(), 3 * width * height, "whole rows");
        assert!(width.min(height) >= Self::MIN_SIDE_PX, "{width}x{height} px is too small");
        let blended: Option<Vec<f32>> = mask.map(|mask| {
            assert_eq!(3 * mask.len(), x.len(), "a mask of the pictures' size");
            let pairs = x.iter().zip(y).enumerate();
            pairs.map(|(i, (x, y))| y + mask[i / 3] * (x - y)).collect()
        });
        let x = blended.as_deref().unwrap_or(x);
        let pictures = (self.features(x, width, height), self.features(y, width, height));
        let (Ok(x), Ok(y)) = pictures else {
            panic!("shapes that fit: {:?}", pictures.0.err().or(pictures.1.err()))
        };
        let layers = self.convolutions.iter().zip(x.iter().zip(&y));
        layers.map(|(convolution, (x, y))| mean_difference(x, y, &convolution.head)).sum()
    }

    /// Returns the features of each layer.
    fn features(&self, rgb: &[f32], width: usize, height: usize) -> candle_core::Result<Vec<Features>> {
        let mut planes = Vec::with_capacity(rgb.len());
        for lane in 0..3 {
            let scaled = |v: &f32| (2.0 * v.clamp(0.0, 1.0) - 1.0 - IMAGE_SHIFT[lane]) / IMAGE_SCALE[lane];
            planes.extend(rgb.iter().skip(lane).step_by(3).map(scaled));
        }
        let mut tensor = Tensor::from_vec(planes, (1, 3, height, width), &Device::Cpu)?;
        let mut all = Vec::new();
        for (layer, convolution) in LAYERS.iter().zip(&self.convolutions) {
            if layer.pool == Pool::Before {
                tensor = tensor.max_pool2d_with_stride(POOL_SIDE_PX, POOL_STRIDE_PX)?;
            }
            tensor = tensor.conv2d(&convolution.weight, layer.padding, layer.stride, 1, 1)?;
            tensor = tensor.broadcast_add(&convolution.bias)?.relu()?;
            let (_, _, rows, columns) = tensor.dims4()?;
            all.push(Features { values: tensor.flatten_all()?.to_vec1()?, pixels: rows * columns });
        }
        Ok(all)
    }
}

impl Features {
    /// Returns the reciprocal of the length at each pixel.
    fn inverse_lengths(&self) -> Vec<f64> {
        let mut squares = vec![0.0; self.pixels];
        for plane in self.values.chunks_exact(self.pixels) {
            for (sum, value) in squares.iter_mut().zip(plane) {
                *sum += f64::from(*value).powi(2);
            }
        }
        squares.iter().map(|square| 1.0 / (square.sqrt() + EPSILON)).collect()
    }
}

/// Returns the mean over pixels of the weighted squares.
fn mean_difference(x: &Features, y: &Features, head: &[f32]) -> f64 {
    let (of_x, of_y) = (x.inverse_lengths(), y.inverse_lengths());
    let planes = x.values.chunks_exact(x.pixels).zip(y.values.chunks_exact(y.pixels));
    let mut sum = 0.0;
    for ((x_plane, y_plane), weight) in planes.zip(head) {
        let values = x_plane.iter().zip(y_plane).zip(of_x.iter().zip(&of_y));
        let squares =
            values.map(|((x, y), (of_x, of_y))| (f64::from(*x) * of_x - f64::from(*y) * of_y).powi(2));
        sum += f64::from(*weight) * squares.sum::<f64>();
    }
    sum / x.pixels as f64
}
