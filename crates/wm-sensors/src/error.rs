//! Errors of lidars.

use std::path::PathBuf;
use thiserror::Error;
use wm_scene::FormatError;

/// The errors of this crate; each message is one line.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LidarError {
    /// There is no such preset.
    #[error("`{name}` is no lidar; {advice}")]
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
    /// A text makes no lidar.
    #[error("{name}{location}: {problem}")]
    Model {
        /// The file or the name.
        name: String,
        /// The line, if it is known.
        location: String,
        /// The problem.
        problem: String,
    },
    /// A file name has the extension of no format of points.
    #[error("{}: points are written to names that end in .ply, .pcd, .npy, .las or .bin", .0.display())]
    Extension(PathBuf),
    /// A file of points cannot be written.
    #[error(transparent)]
    Write(#[from] FormatError),
    /// The points do not fit a file format.
    #[error("{}: {problem}", path.display())]
    Points {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
}
