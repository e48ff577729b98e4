//! Builds with networks: CLIP.

use crate::weights::{PublishedWeights, WeightsArgs};
use anyhow::Result;
use std::path::Path;
use wm_nets::Clip;

/// Makes embeddings.
pub(crate) type Embedder = Clip;

/// Reads the weights, after downloading them if necessary. Prints what is downloaded.
pub(crate) fn open(weights: &WeightsArgs, _: &Path) -> Result<Box<Embedder>> {
    let files = weights.files(PublishedWeights {
        name: "CLIP ViT-L/14 at 336 px".into(),
        bytes: Clip::PUBLISHED_BYTES,
        licence: Clip::licence(),
        source: Clip::source(),
    })?;
    let network = Clip::read(&files)?;
    if !network.is_published() {
        eprintln!(
            "warning: {}: is not CLIP ViT-L/14 at 336 px, which CMMD is defined by; the numbers are not comparable with others",
            files[0].display()
        );
    }
    Ok(Box::new(network))
}
