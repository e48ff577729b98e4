//! The photos that priors are made of.

use crate::dataset::{Dataset, DatasetArgs, HeldOut};
use anyhow::{Result, bail};
use clap::Args;
use std::path::Path;
use wm_train::photos::Check;

/// Which photos, and how large.
#[derive(Args, Clone, Debug)]
pub struct PhotoArgs {
    /// Where they are.
    #[command(flatten)]
    pub set: DatasetArgs,
    /// Do not look at every N-th photo (in the order of names): those that `reconstruct` holds out with the same
    /// number; 0 looks at all
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Photos")]
    eval_every: u32,
    /// The first photo that is not looked at, from 0
    #[arg(long, value_name = "K", default_value_t = 0, help_heading = "Photos")]
    eval_from: u32,
}

/// Opens a data set. Warns on the error stream.
pub fn open(dataset: &Path, args: &PhotoArgs) -> Result<Dataset> {
    let capture = args.set.capture(dataset)?;
    let photos = args.set.photos(dataset, &capture, Check::default())?;
    let (_, places) = HeldOut { every: args.eval_every, from: args.eval_from }.split(&photos);
    if places.is_empty() {
        bail!(
            "{}: --eval-every {} leaves no photo to look at; give a larger number",
            dataset.display(),
            args.eval_every
        );
    }
    Ok(Dataset { capture, photos, places })
}
