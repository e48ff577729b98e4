//! Errors of radars.

use std::path::PathBuf;
use thiserror::Error;
use wm_scene::FormatError;

/// The errors of radars; each message is one line.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RadarError {
    /// There is no such preset.
    #[error("`{name}` is no radar; {advice}")]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// Near names, or all.
        advice: String,
    },
    /// The file of a model cannot be read.
    #[error("{}: cannot be read: {error}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        error: std::io::Error,
    },
    /// A text makes no radar.
    #[error("{name}{location}: {problem}")]
    Model {
        /// The file or the name.
        name: String,
        /// The line, if it is known.
        location: String,
        /// The problem.
        problem: String,
    },
    /// A file name has the extension of no format of detections.
    #[error("{}: detections are written to names that end in .ply, .pcd or .npy", .0.display())]
    Extension(PathBuf),
    /// A file of detections cannot be written.
    #[error(transparent)]
    Write(#[from] FormatError),
}
