//! Builds without networks.

use super::super::PriorsArgs;
use super::super::work::PriorEstimator;
use anyhow::{Result, bail};

/// Returns an error that describes the alternatives.
pub(crate) fn open(args: &PriorsArgs) -> Result<Box<dyn PriorEstimator>> {
    let option = args.network.given().unwrap_or("--source network");
    bail!(
        "{option}: this build has no neural networks; build it with `--features nets`, or take --source photos, or \
         --depth with maps that another program made"
    )
}
