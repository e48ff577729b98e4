//! Errors of sensors.

use std::path::PathBuf;
use thiserror::Error;
use wm_base::FormatError;

/// The errors of this crate; each message is one line.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SensorError {
    /// There is no such preset.
    #[error("`{name}` is no {kind}; {advice}")]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// The kind of sensor: lidar or radar.
        kind: &'static str,
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
    /// A text makes no sensor.
    #[error("{name}{location}: {problem}")]
    Model {
        /// The file or the name.
        name: String,
        /// The line, if it is known.
        location: String,
        /// The problem.
        problem: String,
    },
    /// A file name has the extension of no format.
    #[error("{}: {formats}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// The names that are written to.
        formats: &'static str,
    },
    /// A file of points or detections cannot be written.
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
