//! Errors of writing pictures and videos, each in one line: the file, the problem, the remedy.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;
use wm_base::files::WriteFault;

/// A picture or video that could not be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MediaError {
    /// The system refuses the file.
    #[error("{}: {fault}", path.display())]
    Write {
        /// The file to be written.
        path: PathBuf,
        /// The reason, and the remedy.
        fault: WriteFault,
    },
    /// A tag that the format cannot hold.
    #[error("{}: cannot store the tag {key:?}: {reason}", path.display())]
    Tag {
        /// The file to be written.
        path: PathBuf,
        /// Name of the tag.
        key: String,
        /// The reason.
        reason: String,
    },
    /// The picture's format refused.
    #[error("{}: cannot write {format}: {reason}", path.display())]
    Format {
        /// The file to be written.
        path: PathBuf,
        /// "PNG", "EXR", "MP4", ...
        format: &'static str,
        /// The message of its encoder.
        reason: String,
    },
    /// Chroma has half the resolution, so a video has no odd sides.
    #[error(
        "{}: a video of {width}x{height} pixels has an odd side: use {}x{}",
        path.display(), width.next_multiple_of(2), height.next_multiple_of(2)
    )]
    OddSize {
        /// The file to be written.
        path: PathBuf,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Larger or smaller than the encoder takes.
    #[cfg(feature = "h264")]
    #[error("{}: the built-in encoder takes {limits}, not {width}x{height} pixels: use --encoder ffmpeg", path.display())]
    EncoderSize {
        /// The file to be written.
        path: PathBuf,
        /// The accepted sizes, in words.
        limits: &'static str,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A frame rate that is no positive number, or out of reach of the container.
    #[error("{0:?} is not a frame rate: use frames per second such as 30, 29.97 or 24000/1001")]
    FrameRate(String),
    /// This build has no encoder of its own.
    #[cfg(not(feature = "h264"))]
    #[error(
        "{}: this program was built without its H.264 encoder: use --encoder ffmpeg, write PNG frames, \
         or build it with `--features h264`",
        .0.display()
    )]
    NoBuiltinEncoder(PathBuf),
    /// `--encoder ffmpeg` without ffmpeg.
    #[error("{}: cannot start ffmpeg ({reason}): install it, or use --encoder builtin", path.display())]
    NoFfmpeg {
        /// The file to be written.
        path: PathBuf,
        /// The message of the system; it is part of this error's message, so it is not a source of
        /// its own.
        reason: io::Error,
    },
    /// The video encoder gave up.
    #[error("{}: {encoder} failed at frame {frame}: {reason}", path.display())]
    Encode {
        /// The file to be written.
        path: PathBuf,
        /// Name of the encoder.
        encoder: &'static str,
        /// Index of the frame, from 0.
        frame: u64,
        /// The message of the encoder.
        reason: String,
    },
    /// A video without a frame.
    #[error("{}: no frame to write: a video needs at least one", .0.display())]
    NoFrames(PathBuf),
}

impl MediaError {
    /// The error for what the system refuses of `path`.
    pub(crate) fn write(path: &Path, fault: impl Into<WriteFault>) -> Self {
        Self::Write { path: path.to_path_buf(), fault: fault.into() }
    }
}
