//! Depth Anything: how near each pixel of one photo is, V1 (Yang et al. 2024, "Depth Anything:
//! unleashing the power of large-scale unlabeled data") and V2 (Yang et al. 2024, "Depth Anything
//! V2").
//!
//! A photo is resized to whole patches of 14x14 px (`DepthAnything::network_size`). A DINOv2
//! transformer makes features of the patches, of which four layers go to a DPT head that puts them
//! together at 4, 2, 1 and 1/2 px a patch, the smallest first. V1 and V2 have the same tensors and
//! take other layers, which is why the [`Version`] has to be given. What comes out is disparity
//! without unit: `1 / depth` but for a scale and a shift that differ from photo to photo.
//!
//! Numbers are those of Hugging Face's transformers, up to f32's rounding. The authors' own code
//! differs in two places from it and from here: it resizes photos in float by OpenCV, and places
//! position embeddings 0.1 patches further apart.

mod model;
mod network;
mod photo;
mod tensors;
#[cfg(test)]
mod tests;

use crate::weights::{Licence, Weights, WeightsError, WeightsFault};
use model::PATCH;
pub use model::{DisparityError, ModelSize, Version};
use network::Network;
use std::path::PathBuf;
use tensors::{ADVICE, Architecture, Config, Reader};

/// The relative disparity of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Disparity {
    /// `[height, width]`, larger is nearer, without unit.
    pub values: Vec<f32>,
    /// px.
    pub width: usize,
    /// px.
    pub height: usize,
}

/// The network with its weights.
#[derive(Debug)]
pub struct DepthAnything {
    network: Network,
    /// Side of the training photos, px.
    side: usize,
    size: Option<ModelSize>,
}

impl DepthAnything {
    /// Reads published weights, safetensors or PyTorch's, from one file or several, with the names
    /// of Hugging Face's transformers or of the authors' code. The size is that of the tensors.
    /// Where transformers' `config.json` lies beside the first file, it is compared with the
    /// tensors and the version, and tells how many attention heads there are; else a head has 64
    /// channels, as in all published networks.
    ///
    /// Metric networks have the same tensors with another meaning; they are known by that
    /// `config.json` or their name.
    ///
    /// # Errors
    /// [`WeightsError`] if a file is no such file or damaged, a tensor is missing, of another shape
    /// or not finite, or the network is another one, metric, or of another version.
    pub fn read(files: &[PathBuf], version: Version) -> Result<Self, WeightsError> {
        let mut weights = Weights::open(files, ADVICE)?;
        let config = files.first().map(|file| Config::beside(file)).unwrap_or_default();
        let architecture = &Architecture::of(&weights, &config)?;
        for file in files {
            if let Some(what) = config.contradiction(file, architecture, version) {
                let fault = WeightsFault::Network { what, advice: ADVICE };
                return Err(WeightsError { files: vec![file.clone()], fault });
            }
        }
        let network = Reader { weights: &mut weights, architecture }.network(version)?;
        Ok(Self { network, side: PATCH * architecture.grid, size: architecture.size() })
    }

    /// Returns the published size that the network has, if any.
    #[must_use]
    pub const fn size(&self) -> Option<ModelSize> {
        self.size
    }

    /// Returns the licence of the published weights. For V2 it is stated in the README of
    /// <https://github.com/DepthAnything/Depth-Anything-V2> (LICENSE: "Small model is under the
    /// Apache-2.0 license. Base/Large/Giant models are under the CC-BY-NC-4.0 license") and for
    /// both on the models' pages at Hugging Face, for V1 `license: apache-2.0`.
    #[must_use]
    pub const fn licence(size: ModelSize, version: Version) -> Licence {
        match (version, size) {
            (Version::V1, _) | (Version::V2, ModelSize::Small) => Licence::Apache2,
            (Version::V2, ModelSize::Base | ModelSize::Large) => Licence::CcByNc4,
        }
    }

    /// Returns the source of these weights for [`fetch`](crate::weights::fetch::fetch). Their
    /// checksum is not known here.
    #[cfg(feature = "fetch")]
    #[must_use]
    pub fn source(size: ModelSize, version: Version) -> crate::weights::fetch::DownloadSource {
        let (word, title) = match size {
            ModelSize::Small => ("small", "Small"),
            ModelSize::Base => ("base", "Base"),
            ModelSize::Large => ("large", "Large"),
        };
        let (repository, number) = match version {
            Version::V1 => (format!("LiheYoung/depth-anything-{word}-hf"), 1),
            Version::V2 => (format!("depth-anything/Depth-Anything-V2-{title}-hf"), 2),
        };
        crate::weights::fetch::DownloadSource {
            url: format!("https://huggingface.co/{repository}/resolve/main/model.safetensors"),
            file_name: format!("depth-anything-v{number}-{word}.safetensors"),
            checksum: None,
        }
    }

    /// Returns width and height of the output of [`Self::predict`], px: multiples of 14. The side
    /// that changes less becomes 518, that of the training photos: the shorter side of a larger
    /// photo, the longer side of a smaller one.
    ///
    /// # Errors
    /// [`DisparityError`] if a side is below 14 px or the longer one over
    /// [`model::MAX_ASPECT_RATIO`] times the other.
    pub(crate) fn network_size(&self, width: usize, height: usize) -> Result<(usize, usize), DisparityError> {
        photo::size(width, height, self.side)
    }

    /// Returns the disparity of a photo at the network's size, 0 or above. The photo is `[H, W,
    /// 3]`, display-referred, 0-1 (other values are clamped; values are rounded to 8 bit as in the
    /// reference).
    ///
    /// Runs on the threads of the current rayon pool; their number does not change the result.
    ///
    /// # Errors
    /// [`DisparityError`] if the photo's size is none for the network, or its numbers overflow.
    ///
    /// # Panics
    /// If the photo is not whole rows of `width`.
    pub fn predict(&self, rgb: &[f32], width: usize) -> Result<Disparity, DisparityError> {
        let height = if width == 0 { 0 } else { rgb.len() / (3 * width) };
        assert_eq!(rgb.len(), 3 * width * height, "whole rows of pixels");
        let to = self.network_size(width, height)?;
        let image = self.network.disparity(&photo::normalized(rgb, width, height, to));
        if !image.values.iter().all(|value| value.is_finite()) {
            return Err(DisparityError::NotFinite);
        }
        Ok(Disparity { values: image.values, width: image.width, height: image.height })
    }
}
