//! Priors from a network that tells how near each pixel of one photo is.

#[cfg(feature = "nets")]
mod with_networks;
#[cfg(not(feature = "nets"))]
mod without_networks;

#[cfg(feature = "nets")]
pub use with_networks::open;
#[cfg(not(feature = "nets"))]
pub use without_networks::open;

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Which network, and where its weights are from.
#[derive(Args, Clone, Debug)]
pub struct NetworkArgs {
    /// Size of the network, Depth Anything: small (25 million weights), base (97) or large (335) [default: that of
    /// --weights, else small]
    #[arg(long, value_name = "SIZE", help_heading = "Network")]
    network: Option<SizeArg>,
    /// Version of Depth Anything that the weights are of: v2 or v1
    #[arg(
        long = "version",
        id = "network_version",
        value_name = "VERSION",
        default_value = "v2",
        help_heading = "Network"
    )]
    version: VersionArg,
    /// File of its weights (safetensors, or .pth of PyTorch), several if they lie in several; without it they are
    /// downloaded once, after what they are is said
    #[arg(long, value_name = "FILE", help_heading = "Network")]
    weights: Vec<PathBuf>,
    /// SHA-256 that the file of weights must have
    #[arg(long, value_name = "SHA256", help_heading = "Network")]
    checksum: Option<String>,
    /// Download nothing: weights must be given, or there from an earlier time
    #[arg(long, help_heading = "Network")]
    offline: bool,
}

/// A network's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SizeArg {
    /// ViT-S.
    Small,
    /// ViT-B.
    Base,
    /// ViT-L.
    Large,
}

/// A network's version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum VersionArg {
    /// January 2024.
    V1,
    /// June 2024.
    V2,
}

impl NetworkArgs {
    /// The first option that asks for a network.
    pub fn given(&self) -> Option<&'static str> {
        let all = [
            (!self.weights.is_empty(), "--weights"),
            (self.network.is_some(), "--network"),
            (self.checksum.is_some(), "--checksum"),
            (self.offline, "--offline"),
        ];
        all.into_iter().find(|(is_given, _)| *is_given).map(|(_, name)| name)
    }
}
