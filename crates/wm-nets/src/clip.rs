//! CLIP's image embeddings: what a picture shows, as a vector of length 1 (Radford et al. 2021,
//! "Learning transferable visual models from natural language supervision"). CMMD compares pictures
//! by those of ViT-L/14 at 336 px.
//!
//! The square in the middle of a picture is resized in 8 bit to the network's size as Pillow does
//! it, its channels normalised, cut into patches and embedded; a class stands before the patches.
//! After a norm and the blocks, what has become of the class goes through another norm and a
//! projection, and is divided by its length.
//!
//! That is how the published CMMD prepares pictures (`io_util.py` and `embedding.py` of
//! google-research/cmmd; its `jax.image.resize` has nothing left to do), and numbers are those of
//! CLIP in Hugging Face's transformers, up to f32's rounding.

#[cfg(test)]
mod tests;

use crate::ops::{Activation, Linear, Norm, numbers};
use crate::pillow;
use crate::transformer::{Block, BlockKind, Embedding};
use crate::weights::{Licence, Weights, WeightsError};
use std::path::PathBuf;
use thiserror::Error;

/// Mean and standard deviation of CLIP's training images, red, green, blue.
const MEAN: [f32; 3] = [0.481_454_66, 0.457_827_5, 0.408_210_73];
const DEVIATION: [f32; 3] = [0.268_629_54, 0.261_302_6, 0.275_777_1];
/// Channels of an attention head in all of OpenAI's networks.
const HEAD_CHANNELS: usize = 64;
/// The epsilon of the layer norms.
const EPSILON: f64 = 1e-5;
/// Most channels and pixels of a side that are taken; the largest published ones have 1024 and 336.
const MAX_CHANNELS: usize = 1 << 13;
const MAX_SIDE_PX: usize = 1 << 11;
/// The advice where a file is of another network.
const ADVICE: &str = "give the weights of openai/clip-vit-large-patch14-336 on Hugging Face, pytorch_model.bin or \
                      converted to safetensors";

/// The network's numbers overflow.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("CLIP's numbers overflow; its weights are not those of CLIP, so get them again")]
pub struct NotFinite;

/// Numbers of channels, blocks and patches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Architecture {
    /// Channels of a patch.
    channels: usize,
    /// Channels in a block's perceptron.
    wide: usize,
    blocks: usize,
    /// Side of a patch, px.
    patch: usize,
    /// Patches along a side of a picture.
    grid: usize,
    /// Numbers of an embedding.
    width: usize,
}

impl Architecture {
    /// ViT-L/14 at 336 px.
    const PUBLISHED: Self = Self { channels: 1024, wide: 4096, blocks: 24, patch: 14, grid: 24, width: 768 };

    /// Derives the architecture from the shapes of tensors.
    fn of(weights: &Weights) -> Result<Self, WeightsError> {
        let filters = weights.shape("vision_model.embeddings.patch_embedding.weight");
        let Some([channels, 3, patch, other]) = filters else {
            let found = if filters.is_some() {
                "patches of another kind than CLIP's"
            } else {
                "no tensors of CLIP's"
            };
            return Err(weights.refuse(format!("{found} vision_model")));
        };
        let (channels, patch) = (*channels, *patch);
        let length = |name: &str| weights.length(name, 0, 1 << 20);
        let positions = length("vision_model.embeddings.position_embedding.weight")?;
        let grid = (positions - 1).isqrt();
        let blocks = weights.blocks(|block| of_block(block, "layer_norm1.weight"));
        let is_known = channels % HEAD_CHANNELS == 0
            && (HEAD_CHANNELS..=MAX_CHANNELS).contains(&channels)
            && patch == *other
            && (1..=MAX_SIDE_PX).contains(&patch)
            && (1..=MAX_SIDE_PX / patch).contains(&grid)
            && positions == 1 + grid * grid
            && blocks > 0;
        if !is_known {
            return Err(weights.refuse(format!(
                "a network of {channels} channels, {blocks} blocks, {positions} positions and patches of {patch}x{other} \
                 px, where CLIP ViT-L/14 at 336 px has 1024, 24, 577 and 14x14"
            )));
        }
        let wide = length(&of_block(0, "mlp.fc1.weight"))?;
        Ok(Self { channels, wide, blocks, patch, grid, width: length("visual_projection.weight")? })
    }
}

/// Returns the name of a tensor of a block.
fn of_block(index: usize, what: &str) -> String {
    format!("vision_model.encoder.layers.{index}.{what}")
}

/// The network with its weights.
#[derive(Debug)]
pub struct Clip {
    architecture: Architecture,
    embedding: Embedding,
    before: Norm,
    blocks: Vec<Block>,
    after: Norm,
    project: Linear,
    identity: u64,
}

impl Clip {
    /// Reads published weights, safetensors or PyTorch's, from one file or several, with the names
    /// of Hugging Face's transformers (`vision_model.*`, `visual_projection.weight`); the text's
    /// part may be there or not. Sizes are those of the tensors, heads of attention have 64
    /// channels.
    ///
    /// # Errors
    /// [`WeightsError`] if a file is no such file or damaged, a tensor is missing, of another shape
    /// or not finite, or the network is another one.
    pub fn read(files: &[PathBuf]) -> Result<Self, WeightsError> {
        let mut weights = Weights::open(files, ADVICE)?;
        let architecture = Architecture::of(&weights)?;
        let Architecture { channels, wide, blocks, patch, grid, width } = architecture;
        let mut tensor = |name: &str, shape: &[usize]| Ok(numbers(&weights.tensor(name, shape)?));
        let filters = tensor("vision_model.embeddings.patch_embedding.weight", &[channels, 3, patch, patch])?;
        let class = tensor("vision_model.embeddings.class_embedding", &[channels])?;
        let name = "vision_model.embeddings.position_embedding.weight";
        let positions = tensor(name, &[1 + grid * grid, channels])?;
        let embedding = Embedding::new(&filters, None, patch, class, positions, grid);
        let before = Norm::read("vision_model.pre_layrnorm", channels, EPSILON, &mut tensor)?;
        let kind = BlockKind {
            norms: ["layer_norm1", "layer_norm2"],
            attend: &["self_attn.q_proj", "self_attn.k_proj", "self_attn.v_proj"],
            project: "self_attn.out_proj",
            widen: "mlp.fc1",
            narrow: "mlp.fc2",
            scales: None,
            channels,
            wide,
            epsilon: EPSILON,
            activation: Activation::QuickGelu,
        };
        let block = |index| Block::read(&kind, &mut |what, shape| tensor(&of_block(index, what), shape));
        let blocks = (0..blocks).map(block).collect::<Result<_, _>>()?;
        let after = Norm::read("vision_model.post_layernorm", channels, EPSILON, &mut tensor)?;
        let projection = tensor("visual_projection.weight", &[width, channels])?;
        let Embedding { class, class_position, positions, .. } = &embedding;
        let identity = identity([class, class_position, &positions.values, &projection]);
        let project = Linear::new(projection, None, channels);
        Ok(Self { architecture, embedding, before, blocks, after, project, identity })
    }

    /// Returns the length of an embedding: 768 for the published network.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.architecture.width
    }

    /// Returns true if the network has the sizes of ViT-L/14 at 336 px, by which CMMD is defined.
    #[must_use]
    pub fn is_published(&self) -> bool {
        self.architecture == Architecture::PUBLISHED
    }

    /// Returns a number that identifies the weights.
    #[must_use]
    pub const fn identity(&self) -> u64 {
        self.identity
    }

    /// Returns the embedding of an image, `[H, W, 3]`, display-referred, 8 bit: a vector of length
    /// 1.
    ///
    /// Runs on the threads of the current rayon pool; their number does not change the result.
    ///
    /// # Errors
    /// [`NotFinite`] if its numbers overflow.
    ///
    /// # Panics
    /// If the picture is empty or no whole rows of `width`.
    pub fn embed(&self, rgb: &[u8], width: usize) -> Result<Vec<f32>, NotFinite> {
        let Architecture { channels, patch, grid, .. } = self.architecture;
        let side = patch * grid;
        let share = |level| level as f32 / 255.0;
        let picture = pillow::normalized(&square(rgb, width, side), (side, side), share, MEAN, DEVIATION);
        let mut x = self.before.apply(&self.embedding.apply(&picture));
        for block in &self.blocks {
            block.apply(&mut x, channels / HEAD_CHANNELS);
        }
        let mut embedding = self.project.apply(self.after.apply(&x[..channels]), Activation::Nothing);
        let length = embedding.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        embedding.iter_mut().for_each(|value| *value = (f64::from(*value) / length) as f32);
        if embedding.iter().all(|value| value.is_finite()) { Ok(embedding) } else { Err(NotFinite) }
    }

    /// Returns the licence of the published weights: LICENSE of <https://github.com/openai/CLIP>.
    /// The model card asks not to deploy them.
    #[must_use]
    pub const fn licence() -> Licence {
        Licence::Mit
    }

    /// Approximate size of the published file, with the text encoder.
    pub const PUBLISHED_BYTES: u64 = 1_712_000_000;

    /// Returns the source of the published weights for [`fetch`](crate::weights::fetch::fetch).
    /// Their checksum is not known here.
    #[cfg(feature = "fetch")]
    #[must_use]
    pub fn source() -> crate::weights::fetch::DownloadSource {
        crate::weights::fetch::DownloadSource {
            url: "https://huggingface.co/openai/clip-vit-large-patch14-336/resolve/main/pytorch_model.bin"
                .into(),
            file_name: "clip-vit-large-patch14-336.bin".into(),
            checksum: None,
        }
    }
}

/// Returns the square in the middle of a picture, resized, `[side, side, 3]`.
fn square(rgb: &[u8], width: usize, side: usize) -> Vec<u8> {
    let height = if width == 0 { 0 } else { rgb.len() / (3 * width) };
    assert!(height > 0 && rgb.len() == 3 * width * height, "whole rows of pixels");
    let length = width.min(height);
    let (left, top) = ((width - length) / 2, (height - length) / 2);
    let row = |y: usize| &rgb[3 * (y * width + left)..3 * (y * width + left + length)];
    pillow::resized((top..top + length).flat_map(row).copied().collect(), length, length, (side, side))
}

/// FNV-1a of numbers' bits.
fn identity<const N: usize>(tensors: [&Vec<f32>; N]) -> u64 {
    let step = |hash: u64, value: &f32| (hash ^ u64::from(value.to_bits())).wrapping_mul(0x0100_0000_01b3);
    tensors.into_iter().flatten().fold(0xcbf2_9ce4_8422_2325, step)
}
