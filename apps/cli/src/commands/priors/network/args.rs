//! Options of the network that estimates depth.

use crate::weights::WeightsArgs;
use clap::{Args, ValueEnum};

/// The network, and the source of its weights.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Network")]
pub(crate) struct NetworkArgs {
    /// Size of the network, Depth Anything: small (25 million weights), base (97) or large (335)
    /// [default: the size of --weights, else small]
    #[arg(long, value_name = "SIZE")]
    pub(super) network: Option<SizeArg>,
    /// Version of Depth Anything of the weights: v2 or v1
    #[arg(long = "version", id = "network_version", value_name = "VERSION", default_value = "v2")]
    pub(super) version: VersionArg,
    #[command(flatten)]
    pub(super) weights: WeightsArgs,
}

/// A network's size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SizeArg {
    /// ViT-S.
    Small,
    /// ViT-B.
    Base,
    /// ViT-L.
    Large,
}

/// A network's version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum VersionArg {
    /// January 2024.
    V1,
    /// June 2024.
    V2,
}

impl NetworkArgs {
    /// Returns the name of the first option that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        self.weights.given().or(self.network.map(|_| "--network"))
    }
}
