//! The network that makes embeddings of pictures.

#[cfg(feature = "nets")]
mod with_networks;
#[cfg(not(feature = "nets"))]
mod without_networks;

#[cfg(feature = "nets")]
pub(crate) use with_networks::{Embedder, open};
#[cfg(not(feature = "nets"))]
pub(crate) use without_networks::{Embedder, open};
