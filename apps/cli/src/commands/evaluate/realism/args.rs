//! Options of the comparison of pictures.

use crate::choices::first_given;
use crate::weights::WeightsArgs;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;

/// Options that have no meaning when pictures are compared.
const OF_SCENES: [&str; 10] = [
    "scene",
    "level",
    "repair",
    "FactArgs",
    "dataset",
    "eval_every",
    "eval_from",
    "exposure_fit",
    "TruthArgs",
    "report",
];

/// The pictures that are compared.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Realism")]
pub(crate) struct RealismArgs {
    /// Compare pictures with photographs by CMMD, instead of a scene with its photos: folders of
    /// pictures (JPEG, PNG) or NPY files of embeddings, each compared with --real
    #[arg(
        long,
        value_name = "PICTURES",
        num_args = 1..,
        requires = "real",
        conflicts_with = "paper",
        conflicts_with_all = OF_SCENES
    )]
    pub(crate) pictures: Vec<PathBuf>,
    /// Make the paper's tables of CMMD and UVQ from these folders, one per method, beside the
    /// paper's own numbers; each contains folders fog, rain and snow with pictures, or with one
    /// folder of pictures per scene (docs/guide/evaluate.md)
    #[arg(long, value_name = "FOLDER", num_args = 0.., conflicts_with_all = OF_SCENES)]
    pub(crate) paper: Option<Vec<PathBuf>>,
    /// Photographs of real weather: a folder or an NPY file; for --paper a folder with fog, rain
    /// and snow in it
    #[arg(long, value_name = "PICTURES")]
    pub(super) real: Option<PathBuf>,
    /// Scores from the UVQ program: CSV or JSON (docs/guide/evaluate.md)
    #[arg(long, value_name = "FILE", requires = "paper")]
    pub(super) uvq: Vec<PathBuf>,
    /// Keep embeddings in this folder, as NPY files: stopped work can be continued, and no picture
    /// is embedded twice
    #[arg(long, value_name = "FOLDER", requires = "real")]
    pub(super) embeddings: Option<PathBuf>,
    /// Write the numbers to this CSV file
    #[arg(long, value_name = "FILE")]
    pub(super) csv: Option<PathBuf>,
    /// Write the tables to this Markdown file
    #[arg(long, value_name = "FILE")]
    pub(super) markdown: Option<PathBuf>,
    #[command(flatten)]
    pub(super) weights: WeightsArgs,
}

impl RealismArgs {
    /// Returns true if pictures are compared, not a scene.
    pub(crate) fn asked(&self) -> bool {
        !self.pictures.is_empty() || self.paper.is_some()
    }

    /// Returns an option that was given and has no meaning without pictures.
    fn idle(&self) -> Option<&'static str> {
        let own = first_given([
            (self.real.is_some(), "--real"),
            (self.csv.is_some(), "--csv"),
            (self.markdown.is_some(), "--markdown"),
        ]);
        own.or(self.weights.given())
    }

    /// Returns an error for options that have no meaning for a scene.
    pub(crate) fn check_idle(&self) -> Result<()> {
        if let Some(option) = self.idle() {
            bail!("{option} goes with --pictures or --paper; give one of them, or leave it out");
        }
        Ok(())
    }
}
