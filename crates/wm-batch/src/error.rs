//! Errors of data sets.

use std::path::PathBuf;
use thiserror::Error;
use wm_base::FormatError;

/// Why a data set cannot be written or read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SetError {
    /// A layout cannot hold a set.
    #[error("layout {layout}: {problem}")]
    Layout {
        /// The layout's name.
        layout: &'static str,
        /// The part of the set that it cannot hold, and what to do.
        problem: String,
    },
    /// A picture could not be encoded.
    #[error("a picture of sensor \"{sensor}\" cannot be encoded: {problem}")]
    Picture {
        /// The sensor.
        sensor: String,
        /// The problem.
        problem: String,
    },
    /// A file could not be written.
    #[error("{}: {problem}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// The clips of a set cannot be had; their source says why.
    #[error("{0}")]
    Clips(String),
    /// A file of a log is wrong: path, place and what to do.
    #[error(transparent)]
    File(#[from] FormatError),
}

impl From<SetError> for wm_place::Error {
    fn from(error: SetError) -> Self {
        Self::Work(Box::new(error))
    }
}
