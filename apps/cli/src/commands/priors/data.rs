//! The photos for which priors are made.

use crate::dataset::{Dataset, DatasetArgs, HeldOutArgs};
use anyhow::{Result, bail};
use clap::Args;
use std::path::Path;

/// The photos for which priors are made, and their size.
#[derive(Args, Clone, Debug)]
#[command(mut_arg("eval_every", |arg| {
    arg.help("Make no priors of every N-th photo (in the order of names): those that `reconstruct` holds out with the same \
              number; 0 uses all photos")
}))]
#[command(mut_arg("eval_from", |arg| arg.help("The first photo that is left out, from 0")))]
pub(crate) struct PhotoArgs {
    /// The data set.
    #[command(flatten)]
    pub(crate) set: DatasetArgs,
    /// The photos without priors.
    #[command(flatten)]
    held_out: HeldOutArgs,
}

/// Opens a data set. Prints warnings on the error stream.
pub(crate) fn open(dataset: &Path, args: &PhotoArgs) -> Result<Dataset> {
    let (capture, photos) = args.set.open(dataset)?;
    let (_, places) = args.held_out.held_out().split(&photos);
    if places.is_empty() {
        bail!(
            "{}: --eval-every {} leaves no photo to look at; give a larger number",
            dataset.display(),
            args.held_out.eval_every
        );
    }
    Ok(Dataset { capture, photos, places })
}
