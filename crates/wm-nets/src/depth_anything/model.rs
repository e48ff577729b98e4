//! The published networks, the photos that they take, and the error of those that they do not.

use thiserror::Error;

/// Pixels of a patch's side.
pub(crate) const PATCH: usize = 14;

/// Largest aspect ratio of a photo: the cost of attention grows with its square.
pub(crate) const MAX_ASPECT_RATIO: usize = 4;

/// The family of the weights. Their tensors do not tell it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Version {
    /// January 2024: taught on real photos with measured depth.
    V1,
    /// June 2024: taught on rendered pictures, with finer edges.
    #[default]
    V2,
}

/// The size of the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ModelSize {
    /// 25 million weights, ViT-S.
    #[default]
    Small,
    /// 97 million weights, ViT-B.
    Base,
    /// 335 million weights, ViT-L.
    Large,
}

/// A reason why a photo has no disparity.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum DisparityError {
    /// The photo is smaller than a patch.
    #[error(
        "a photo of {width}x{height} px is too small; the depth network takes {0}x{0} px and more",
        PATCH
    )]
    Small {
        /// px.
        width: usize,
        /// px.
        height: usize,
    },
    /// The photo is too long.
    #[error(
        "a photo of {width}x{height} px is too long; the depth network takes sides of up to {MAX_ASPECT_RATIO}:1, so cut it up"
    )]
    Long {
        /// px.
        width: usize,
        /// px.
        height: usize,
    },
    /// The result is not finite.
    #[error(
        "the depth network's numbers overflow; its weights are not those of Depth Anything, so get them again"
    )]
    NotFinite,
}
