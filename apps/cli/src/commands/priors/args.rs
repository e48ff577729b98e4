//! Options of `priors`.

use super::data::PhotoArgs;
use super::files::FileArgs;
use super::network::NetworkArgs;
use crate::overwrite::OverwriteArgs;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use weather_magician::train::priors::folder::PriorsError;
use weather_magician::train::priors::{FOLDER, PriorsWriter};
use wm_base::FormatError;
use wm_capture::folder_of;

/// Options of `priors`.
#[derive(Args, Clone, Debug)]
pub(crate) struct PriorsArgs {
    /// The data set: a folder with a COLMAP model or a transforms.json
    pub(super) dataset: PathBuf,
    /// Output folder [default: priors in the data set, where `reconstruct` finds them]
    #[arg(short, long, value_name = "FOLDER", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Continue stopped work, or add new photos; the other options must be the same
    #[arg(long, help_heading = "Output")]
    pub(super) resume: bool,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    /// Also write a preview of each photo with its depth, normals and sky; preview.png always shows
    /// six of them
    #[arg(long, help_heading = "Output")]
    pub(super) preview: bool,
    /// Maximum number of pixels of a map that is written
    #[arg(long, value_name = "N", default_value_t = 300_000, value_parser = clap::value_parser!(u32).range(64..=64_000_000), help_heading = "Output")]
    pub(super) map_pixels: u32,
    /// Source of the priors: photos (stereo and colours), network (relative depth of each photo,
    /// fitted to the points) or files (maps that you have) [default: files if --depth, --normal or
    /// --sky is given, network if --weights or --network is, else photos]
    #[arg(long, value_name = "SOURCE")]
    source: Option<SourceArg>,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Run")]
    pub(super) threads: Option<u16>,
    #[command(flatten)]
    pub(super) photos: PhotoArgs,
    #[command(flatten)]
    pub(super) network: NetworkArgs,
    #[command(flatten)]
    pub(super) files: FileArgs,
}

/// The source of priors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SourceArg {
    /// The photos.
    Photos,
    /// A network.
    Network,
    /// Maps.
    Files,
}

impl PriorsArgs {
    /// Returns the source that is asked for.
    ///
    /// # Errors
    /// Options of another source are given, or maps are missing.
    pub(super) fn source(&self) -> Result<SourceArg> {
        let (files, network) = (self.files.given(), self.network.given());
        let usual = match (files, network) {
            (Some(_), _) => SourceArg::Files,
            (None, Some(_)) => SourceArg::Network,
            (None, None) => SourceArg::Photos,
        };
        let source = self.source.unwrap_or(usual);
        let wrong = match source {
            SourceArg::Photos => files.or(network),
            SourceArg::Network => files,
            SourceArg::Files => network,
        };
        if let Some(option) = wrong {
            let name =
                source.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
            bail!("{option} cannot be used with the source {name}; leave one of them out");
        }
        if source == SourceArg::Files && files.is_none() {
            bail!("--source files needs maps; name their folders with --depth, --normal or --sky");
        }
        Ok(source)
    }

    /// Returns the output folder.
    pub(super) fn out(&self) -> PathBuf {
        self.out.clone().unwrap_or_else(|| folder_of(&self.dataset).join(FOLDER))
    }

    /// Returns the writer; its errors advise another folder if the folder is the default.
    pub(super) fn writer(&self, source: String) -> Result<PriorsWriter> {
        let folder = self.out();
        let writer = match self.resume {
            true => PriorsWriter::resumed(&folder, &source),
            false => PriorsWriter::new(&folder, source).map_err(PriorsError::from),
        };
        let is_default = self.out.is_none();
        writer.map_err(|error| match error {
            PriorsError::File(FormatError { .. }) if is_default => {
                anyhow::anyhow!("{error}; give another folder with -o")
            }
            error => error.into(),
        })
    }
}
