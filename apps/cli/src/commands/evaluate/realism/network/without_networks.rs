//! Builds without networks.

use crate::weights::WeightsArgs;
use anyhow::{Result, bail};
use std::path::Path;

/// A type without values: this build has no networks.
pub(crate) enum Embedder {}

/// Returns an error that describes the alternatives.
pub(crate) fn open(_: &WeightsArgs, pictures: &Path) -> Result<Box<Embedder>> {
    bail!(
        "{}: this build has no neural networks to embed pictures with; build it with `--features nets`, or give an NPY file \
         of embeddings that another program made",
        pictures.display()
    )
}

impl Embedder {
    pub(crate) fn width(&self) -> usize {
        match *self {}
    }

    pub(crate) fn identity(&self) -> u64 {
        match *self {}
    }

    pub(crate) fn embed(&self, _: &[u8], _: usize) -> Result<Vec<f32>> {
        match *self {}
    }
}
