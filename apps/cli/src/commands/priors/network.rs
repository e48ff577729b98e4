//! Priors from a network that estimates relative depth in one photo.

mod args;
#[cfg(feature = "nets")]
mod with_networks;
#[cfg(not(feature = "nets"))]
mod without_networks;

pub(crate) use args::NetworkArgs;
#[cfg(feature = "nets")]
pub(crate) use with_networks::open;
#[cfg(not(feature = "nets"))]
pub(crate) use without_networks::open;
