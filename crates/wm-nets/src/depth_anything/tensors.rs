//! The published files: their networks' sizes, the names of their tensors, and what is made of
//! them.

use super::model::{ModelSize, PATCH, Version};
use super::network::{Backbone, Fusion, Head, Network, ResidualUnit};
use crate::ops::{Activation, Convolution, Enlarge, Linear, Norm, numbers};
use crate::transformer::{Block, BlockKind, Embedding};
use crate::weights::{Weights, WeightsError};
use serde_json::Value;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// The advice where a file is of another network.
pub(crate) const ADVICE: &str = "give model.safetensors of depth-anything/Depth-Anything-V2-{Small,Base,Large}-hf \
                          or LiheYoung/depth-anything-{small,base,large}-hf on Hugging Face, or a .pth of the \
                          same networks";

/// The epsilon of DINOv2's layer norms.
const EPSILON: f64 = 1e-6;

/// Numbers of channels and blocks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Architecture {
    pub(crate) naming: Naming,
    /// Channels of a patch.
    pub(crate) channels: usize,
    pub(crate) blocks: usize,
    pub(crate) heads: usize,
    /// Patches along a side of the photos that it learnt from.
    pub(crate) grid: usize,
    /// Channels of the four taps.
    pub(crate) neck: [usize; 4],
    /// Channels where they are put together.
    pub(crate) fusion: usize,
    /// Channels before depth.
    pub(crate) last: usize,
}

impl Architecture {
    /// Channels of an attention head in all published networks.
    const HEAD_CHANNELS: usize = 64;
    /// Largest grid that is taken; the published ones are 37.
    const MAX_GRID: usize = 128;

    /// Finds out from tensors' shapes and, where it lies beside them, `config.json`.
    ///
    /// # Errors
    /// [`WeightsError`] if it is no Depth Anything, or does not say how many heads it has.
    pub(crate) fn of(weights: &Weights, config: &Config) -> Result<Self, WeightsError> {
        let naming = [Naming::Transformers, Naming::Original]
            .into_iter()
            .find(|naming| weights.shape(&naming.patches("weight")).is_some())
            .ok_or_else(|| weights.refuse("no tensors of Depth Anything".into()))?;
        let of = |name: &str, axis: usize| weights.length(&naming.name(name), axis, 1 << 16);
        let channels = weights.length(&naming.patches("weight"), 0, 1 << 16)?;
        // The largest published one has 40.
        let blocks = weights.blocks(|block| naming.block(block, "norm1.weight"));
        let heads = match config.heads {
            Some(heads) if heads > 0 && channels % heads == 0 => heads,
            None if channels % Self::HEAD_CHANNELS == 0 => channels / Self::HEAD_CHANNELS,
            _ => {
                return Err(weights.refuse(format!(
                    "a network of {channels} channels, of which the published ones have {0} a head and others say \
                     in a config.json beside how many heads they have",
                    Self::HEAD_CHANNELS
                )));
            }
        };
        let grid = (of("backbone.embeddings.position_embeddings", 1)? - 1).isqrt();
        if blocks < 4 || !(1..=Self::MAX_GRID).contains(&grid) {
            let found = format!("a network of {blocks} blocks and {grid}x{grid} positions");
            return Err(weights.refuse(format!("{found}, where Depth Anything has 12 or 24 and 37x37")));
        }
        let neck = |index: usize| of(&format!("neck.convs.{index}.weight"), 1);
        let neck = [neck(0)?, neck(1)?, neck(2)?, neck(3)?];
        // Half of it goes to the last convolution but one.
        let fusion = 2 * of("head.conv2.weight", 1)?;
        let last = of("head.conv2.weight", 0)?;
        Ok(Self { naming, channels, blocks, heads, grid, neck, fusion, last })
    }

    /// Returns the published size that these are.
    pub(crate) fn size(&self) -> Option<ModelSize> {
        match (self.channels, self.blocks) {
            (384, 12) => Some(ModelSize::Small),
            (768, 12) => Some(ModelSize::Base),
            (1024, 24) => Some(ModelSize::Large),
            _ => None,
        }
    }

    /// After which blocks the head takes the features: for V1 the last four, for V2 as the
    /// backbone's `out_indices` are in the published `config.json` (and `intermediate_layer_idx` of
    /// the original `dpt.py`, from 0).
    pub(crate) fn taps(&self, version: Version) -> [usize; 4] {
        let last = self.blocks;
        match (version, last) {
            (Version::V1, _) => [last - 3, last - 2, last - 1, last],
            (Version::V2, 24) => [5, 12, 18, 24],
            (Version::V2, _) => [last / 4, last / 2, last * 3 / 4, last],
        }
    }
}

/// The facts in `config.json` beside a file that tensors do not tell.
#[derive(Debug, Default)]
pub(crate) struct Config {
    heads: Option<usize>,
    taps: Option<Vec<usize>>,
    metric: bool,
}

impl Config {
    /// Reads it from beside a file; one that is not there, or of something else, says nothing.
    pub(crate) fn beside(file: &Path) -> Self {
        Self::read(&file.with_file_name("config.json")).unwrap_or_default()
    }

    fn read(file: &Path) -> Option<Self> {
        /// Far longer than any.
        const MAX_CONFIG_BYTES: u64 = 1 << 20;
        let mut json = String::new();
        File::open(file).ok()?.take(MAX_CONFIG_BYTES).read_to_string(&mut json).ok()?;
        let config: Value = serde_json::from_str(&json).ok()?;
        let number = |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok());
        let backbone = &config["backbone_config"];
        let taps = |all: &Vec<Value>| all.iter().filter_map(number).collect();
        (config["model_type"] == "depth_anything").then(|| Self {
            heads: number(&backbone["num_attention_heads"]),
            taps: backbone["out_indices"].as_array().map(taps),
            metric: config["depth_estimation_type"] == "metric",
        })
    }

    /// Returns the reason in the file's name or its `config.json` against the use of a file, if
    /// there is one.
    pub(crate) fn contradiction(
        &self,
        file: &Path,
        architecture: &Architecture,
        version: Version,
    ) -> Option<String> {
        let metric = "a metric network, which gives depth and not disparity";
        if self.metric {
            return Some(format!("by the config.json beside it {metric}"));
        }
        let name = file.file_name().unwrap_or_default();
        if name.to_string_lossy().to_lowercase().contains("metric") {
            return Some(format!("by its name {metric}"));
        }
        let (taps, expected) = (self.taps.as_ref()?, architecture.taps(version));
        let other = if version == Version::V1 { Version::V2 } else { Version::V1 };
        if taps[..] == architecture.taps(other) {
            return Some(format!("by the config.json beside it {other:?}, not {version:?}"));
        }
        (taps[..] != expected).then(|| {
            format!("by the config.json beside it features are taken after blocks {taps:?}, not {expected:?}")
        })
    }
}

/// The naming scheme of the tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Naming {
    /// Hugging Face's transformers.
    Transformers,
    /// The authors' own code.
    Original,
}

impl Naming {
    fn patches(self, what: &str) -> String {
        match self {
            Self::Transformers => format!("backbone.embeddings.patch_embeddings.projection.{what}"),
            Self::Original => format!("pretrained.patch_embed.proj.{what}"),
        }
    }

    /// Returns the name of a tensor of a block from transformers' name; the authors' code uses
    /// other names for some.
    fn block(self, index: usize, what: &str) -> String {
        match self {
            Self::Transformers => format!("backbone.encoder.layer.{index}.{what}"),
            Self::Original => {
                let what = what
                    .replace("attention.output.dense", "attn.proj")
                    .replace("layer_scale1.lambda1", "ls1.gamma")
                    .replace("layer_scale2.lambda1", "ls2.gamma");
                format!("pretrained.blocks.{index}.{what}")
            }
        }
    }

    /// The other name of what is in no block.
    fn name(self, transformers: &str) -> String {
        if self == Self::Transformers {
            return transformers.into();
        }
        let simple = [
            ("backbone.embeddings.position_embeddings", "pretrained.pos_embed"),
            ("backbone.embeddings.cls_token", "pretrained.cls_token"),
            ("backbone.layernorm", "pretrained.norm"),
            ("neck.convs.0", "depth_head.scratch.layer1_rn"),
            ("neck.convs.1", "depth_head.scratch.layer2_rn"),
            ("neck.convs.2", "depth_head.scratch.layer3_rn"),
            ("neck.convs.3", "depth_head.scratch.layer4_rn"),
            ("neck.fusion_stage.layers.0", "depth_head.scratch.refinenet4"),
            ("neck.fusion_stage.layers.1", "depth_head.scratch.refinenet3"),
            ("neck.fusion_stage.layers.2", "depth_head.scratch.refinenet2"),
            ("neck.fusion_stage.layers.3", "depth_head.scratch.refinenet1"),
            ("head.conv1", "depth_head.scratch.output_conv1"),
            ("head.conv2", "depth_head.scratch.output_conv2.0"),
            ("head.conv3", "depth_head.scratch.output_conv2.2"),
        ];
        if let Some(rest) = transformers.strip_prefix("neck.reassemble_stage.layers.") {
            let (index, what) = rest.split_once('.').unwrap_or((rest, ""));
            let what = what.replace("projection", "projects").replace("resize", "resize_layers");
            let (part, what) = what.split_once('.').unwrap_or((&what, ""));
            return format!("depth_head.{part}.{index}.{what}");
        }
        let (from, to) =
            simple.into_iter().find(|(from, _)| transformers.starts_with(from)).unwrap_or_default();
        let rest = transformers[from.len()..]
            .replace("residual_layer", "resConfUnit")
            .replace("convolution", "conv")
            .replace("projection", "out_conv");
        format!("{to}{rest}")
    }
}

/// Reads one tensor after the other.
pub(crate) struct Reader<'a> {
    pub(crate) weights: &'a mut Weights,
    pub(crate) architecture: &'a Architecture,
}

type Read<T> = Result<T, WeightsError>;

impl Reader<'_> {
    /// All of a network.
    ///
    /// # Errors
    /// [`WeightsError`] if a tensor is missing, of another shape or not finite.
    pub(crate) fn network(&mut self, version: Version) -> Read<Network> {
        Ok(Network { backbone: self.backbone(version)?, head: self.head()? })
    }

    fn exact(&mut self, name: &str, shape: &[usize]) -> Read<Vec<f32>> {
        Ok(numbers(&self.weights.tensor(name, shape)?))
    }

    fn tensor(&mut self, name: &str, shape: &[usize]) -> Read<Vec<f32>> {
        self.exact(&self.architecture.naming.name(name), shape)
    }

    /// Reads a linear layer by its name and the shape of its weight.
    fn linear(&mut self, name: &str, shape: &[usize]) -> Read<Linear> {
        Linear::read(name, shape, &mut |name, shape| self.tensor(name, shape))
    }

    fn convolution(&mut self, name: &str, to: usize, from: usize, stride: usize) -> Read<Convolution> {
        let weight = self.tensor(&format!("{name}.weight"), &[to, from, 3, 3])?;
        let bias = self.tensor(&format!("{name}.bias"), &[to])?;
        Ok(Convolution::new(&weight, Some(bias), from, stride))
    }

    fn backbone(&mut self, version: Version) -> Read<Backbone> {
        let Architecture { channels, grid, heads, .. } = *self.architecture;
        let weight = self.exact(&self.architecture.naming.patches("weight"), &[channels, 3, PATCH, PATCH])?;
        let bias = self.exact(&self.architecture.naming.patches("bias"), &[channels])?;
        let class = self.tensor("backbone.embeddings.cls_token", &[1, 1, channels])?;
        let name = "backbone.embeddings.position_embeddings";
        let positions = self.tensor(name, &[1, 1 + grid * grid, channels])?;
        let embedding = Embedding::new(&weight, Some(bias), PATCH, class, positions, grid);
        let blocks = (0..self.architecture.blocks).map(|index| self.block(index)).collect::<Read<_>>()?;
        let norm =
            Norm::read("backbone.layernorm", channels, EPSILON, &mut |name, shape| self.tensor(name, shape))?;
        Ok(Backbone { embedding, blocks, norm, heads, taps: self.architecture.taps(version) })
    }

    fn block(&mut self, index: usize) -> Read<Block> {
        let (channels, naming) = (self.architecture.channels, self.architecture.naming);
        let attend: &[&str] = match naming {
            Naming::Original => &["attn.qkv"],
            Naming::Transformers => {
                &["attention.attention.query", "attention.attention.key", "attention.attention.value"]
            }
        };
        let kind = BlockKind {
            norms: ["norm1", "norm2"],
            attend,
            project: "attention.output.dense",
            widen: "mlp.fc1",
            narrow: "mlp.fc2",
            scales: Some(["layer_scale1.lambda1", "layer_scale2.lambda1"]),
            channels,
            // In all of DINOv2's networks.
            wide: 4 * channels,
            epsilon: EPSILON,
            activation: Activation::Gelu,
        };
        Block::read(&kind, &mut |what, shape| self.exact(&naming.block(index, what), shape))
    }

    fn head(&mut self) -> Read<Head> {
        let Architecture { channels, neck, fusion, last, .. } = *self.architecture;
        let stage = |index: usize| format!("neck.reassemble_stage.layers.{index}");
        let mut project = Vec::new();
        let mut reduce = Vec::new();
        for (index, to) in neck.into_iter().enumerate() {
            project.push(self.linear(&format!("{}.projection", stage(index)), &[to, channels, 1, 1])?);
            let weight = self.tensor(&format!("neck.convs.{index}.weight"), &[fusion, to, 3, 3])?;
            reduce.push(Convolution::new(&weight, None, to, 1));
        }
        let mut enlarge = Vec::new();
        for (index, side) in [4, 2].into_iter().enumerate() {
            let name = format!("{}.resize", stage(index));
            let weight = self.tensor(&format!("{name}.weight"), &[neck[index], neck[index], side, side])?;
            let bias = self.tensor(&format!("{name}.bias"), &[neck[index]])?;
            enlarge.push(Enlarge::new(&weight, &bias, side));
        }
        let shrink = self.convolution(&format!("{}.resize", stage(3)), neck[3], neck[3], 2)?;
        let fusions: Vec<Fusion> = (0..4).map(|index| self.fusion(index)).collect::<Read<_>>()?;
        let last_two = [
            self.convolution("head.conv1", fusion / 2, fusion, 1)?,
            self.convolution("head.conv2", last, fusion / 2, 1)?,
        ];
        Ok(Head {
            project: four(project),
            enlarge: enlarge.try_into().expect("two"),
            shrink,
            reduce: four(reduce),
            fusions: four(fusions),
            last: last_two,
            depth: self.linear("head.conv3", &[1, last, 1, 1])?,
        })
    }

    fn fusion(&mut self, index: usize) -> Read<Fusion> {
        let fusion = self.architecture.fusion;
        let name = format!("neck.fusion_stage.layers.{index}");
        let mut residual = |which: usize| {
            let name = format!("{name}.residual_layer{which}.convolution");
            let mut convolution =
                |index: usize| self.convolution(&format!("{name}{index}"), fusion, fusion, 1);
            Ok(ResidualUnit([convolution(1)?, convolution(2)?]))
        };
        // The files have one for the first too, which nothing is added to.
        let added = if index == 0 { None } else { Some(residual(1)?) };
        let sum = residual(2)?;
        let project = self.linear(&format!("{name}.projection"), &[fusion, fusion, 1, 1])?;
        Ok(Fusion { added, sum, project })
    }
}

fn four<T: std::fmt::Debug>(all: Vec<T>) -> [T; 4] {
    all.try_into().expect("one of each of four")
}
