//! Builds without networks.

use super::super::source::PriorEstimator;
use super::args::NetworkArgs;
use anyhow::{Result, bail};

/// Returns an error that describes the alternatives.
pub(crate) fn open(args: &NetworkArgs, _: u32) -> Result<Box<dyn PriorEstimator>> {
    let option = args.given().unwrap_or("--source network");
    bail!(
        "{option}: this build has no neural networks; build it with `--features nets`, or take --source photos, or \
         --depth with maps that another program made"
    )
}
