//! Vision transformers: patches of a picture with a class before them, and blocks that each network
//! has its own number of.

use crate::ops::{Activation, Image, Linear, Norm, add_scaled, attention};
use crate::weights::WeightsError;

/// Reads a tensor by its name and shape.
pub(crate) type Tensors<'a> = dyn FnMut(&str, &[usize]) -> Result<Vec<f32>, WeightsError> + 'a;

/// The layers before the blocks.
#[derive(Debug)]
pub(crate) struct Embedding {
    /// From a patch's pixels, row by row.
    patches: Linear,
    /// Side of a patch, px.
    side: usize,
    /// The class token before the patches, `[channels]`.
    pub(crate) class: Vec<f32>,
    /// The position embedding of the class token.
    pub(crate) class_position: Vec<f32>,
    /// The position embeddings of the patches of a square image.
    pub(crate) positions: Image,
}

impl Embedding {
    /// Makes the layers of filters `[channels, 3, side, side]` with their bias, a class token, and
    /// position embeddings `[1 + grid grid, channels]`, that of the class first.
    pub(crate) fn new(
        filters: &[f32],
        bias: Option<Vec<f32>>,
        side: usize,
        class: Vec<f32>,
        mut class_position: Vec<f32>,
        grid: usize,
    ) -> Self {
        let channels = class.len();
        let values = class_position.split_off(channels);
        Self {
            patches: Linear::new(Self::filters(filters, side), bias, 3 * side * side),
            side,
            class,
            class_position,
            positions: Image { values, width: grid, height: grid, channels },
        }
    }

    /// Filters `[channels, 3, side, side]` for pixels that have their channels together.
    fn filters(weight: &[f32], side: usize) -> Vec<f32> {
        let square = side * side;
        let mut sorted = Vec::with_capacity(weight.len());
        for filter in weight.chunks_exact(3 * square) {
            sorted.extend((0..3 * square).map(|place| filter[place % 3 * square + place / 3]));
        }
        sorted
    }

    /// Returns the input of the first block for an image of whole patches: the class token, then
    /// the patches, row by row.
    pub(crate) fn apply(&self, picture: &Image) -> Vec<f32> {
        let (columns, rows) = (picture.width / self.side, picture.height / self.side);
        let line = self.side * picture.channels;
        let mut pixels = Vec::with_capacity(picture.values.len());
        for row in 0..rows {
            for column in 0..columns {
                for y in row * self.side..(row + 1) * self.side {
                    let start = (y * columns + column) * line;
                    pixels.extend_from_slice(&picture.values[start..start + line]);
                }
            }
        }
        let patches = Image {
            values: self.patches.apply(pixels, Activation::Nothing),
            width: columns,
            height: rows,
            channels: self.class.len(),
        };
        // Exactly the same where the picture is of the size that the network learnt from.
        let mut positions = self.positions.bicubic(columns, rows);
        positions.add(&patches);
        let class = self.class.iter().zip(&self.class_position).map(|(value, position)| value + position);
        class.chain(positions.values).collect()
    }
}

/// A block: attention, then a perceptron per patch, each added with a scale per channel.
#[derive(Debug)]
pub(crate) struct Block {
    norms: [Norm; 2],
    /// Queries, keys, values.
    attend: Linear,
    project: Linear,
    widen: Linear,
    /// The function after it.
    activation: Activation,
    narrow: Linear,
    scales: [Vec<f32>; 2],
}

/// The differences between the blocks of networks.
pub(crate) struct BlockKind<'a> {
    /// Names of the tensors, without what comes before them and `weight` or `bias`.
    pub(crate) norms: [&'a str; 2],
    /// One tensor for each of queries, keys and values, or one of all three.
    pub(crate) attend: &'a [&'a str],
    pub(crate) project: &'a str,
    pub(crate) widen: &'a str,
    pub(crate) narrow: &'a str,
    /// Full names; `None` where all is added as it is.
    pub(crate) scales: Option<[&'a str; 2]>,
    /// Channels of a patch.
    pub(crate) channels: usize,
    /// Channels in the perceptron.
    pub(crate) wide: usize,
    pub(crate) epsilon: f64,
    pub(crate) activation: Activation,
}

impl Block {
    /// Reads a block.
    ///
    /// # Errors
    /// The errors of `tensor`.
    pub(crate) fn read(kind: &BlockKind<'_>, tensor: &mut Tensors<'_>) -> Result<Self, WeightsError> {
        let (channels, wide) = (kind.channels, kind.wide);
        let norms = [
            Norm::read(kind.norms[0], channels, kind.epsilon, tensor)?,
            Norm::read(kind.norms[1], channels, kind.epsilon, tensor)?,
        ];
        let (mut weight, mut bias) = (Vec::new(), Vec::new());
        let rows = 3 * channels / kind.attend.len();
        for name in kind.attend {
            weight.extend(tensor(&format!("{name}.weight"), &[rows, channels])?);
            bias.extend(tensor(&format!("{name}.bias"), &[rows])?);
        }
        let attend = Linear::new(weight, Some(bias), channels);
        let project = Linear::read(kind.project, &[channels, channels], tensor)?;
        let widen = Linear::read(kind.widen, &[wide, channels], tensor)?;
        let narrow = Linear::read(kind.narrow, &[channels, wide], tensor)?;
        let scales = match kind.scales {
            Some([first, second]) => [tensor(first, &[channels])?, tensor(second, &[channels])?],
            None => [vec![1.0; channels], vec![1.0; channels]],
        };
        Ok(Self { norms, attend, project, widen, activation: kind.activation, narrow, scales })
    }

    /// Applies it to `[rows, channels]`.
    pub(crate) fn apply(&self, x: &mut [f32], heads: usize) {
        let channels = self.scales[0].len();
        let attended = self.attend.apply(self.norms[0].apply(x), Activation::Nothing);
        let attended = self.project.apply(attention(attended, channels, heads), Activation::Nothing);
        add_scaled(x, &self.scales[0], &attended);
        let wide = self.widen.apply(self.norms[1].apply(x), self.activation);
        add_scaled(x, &self.scales[1], &self.narrow.apply(wide, Activation::Nothing));
    }
}

impl Linear {
    /// Reads `name.weight` of a shape, outputs first, and `name.bias`.
    ///
    /// # Errors
    /// The errors of `tensor`.
    pub(crate) fn read(name: &str, shape: &[usize], tensor: &mut Tensors<'_>) -> Result<Self, WeightsError> {
        let weight = tensor(&format!("{name}.weight"), shape)?;
        let bias = tensor(&format!("{name}.bias"), &shape[..1])?;
        Ok(Self::new(weight, Some(bias), shape[1..].iter().product()))
    }
}

impl Norm {
    /// Reads `name.weight` and `name.bias`.
    ///
    /// # Errors
    /// The errors of `tensor`.
    pub(crate) fn read(
        name: &str,
        channels: usize,
        epsilon: f64,
        tensor: &mut Tensors<'_>,
    ) -> Result<Self, WeightsError> {
        let scale = tensor(&format!("{name}.weight"), &[channels])?;
        Ok(Self { scale, shift: tensor(&format!("{name}.bias"), &[channels])?, epsilon })
    }
}
