//! What can go wrong while writing, each in one line: which file, what happened, what to do.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A picture or video that could not be written.
#[derive(Debug, Error)]
pub enum MediaError {
    /// The directory to write into is not there.
    #[error("{}: the directory {} does not exist: create it first", path.display(), directory.display())]
    MissingDirectory {
        /// The file to be written.
        path: PathBuf,
        /// Its missing directory.
        directory: PathBuf,
    },
    /// A directory is in the place of the file.
    #[error("{}: is a directory: name a file in it", path.display())]
    IsDirectory {
        /// The file to be written.
        path: PathBuf,
    },
    /// A device, pipe or socket is in the place of the file: it cannot be replaced by renaming.
    #[error("{}: is not a regular file: name a new file", path.display())]
    NotRegular {
        /// The file to be written.
        path: PathBuf,
    },
    /// No right to write there.
    #[error("{}: not writable ({source}): change the rights of its directory or write elsewhere", path.display())]
    NotWritable {
        /// The file to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// No room.
    #[error("{}: the disk is full: free some space or write elsewhere", path.display())]
    DiskFull {
        /// The file to be written.
        path: PathBuf,
    },
    /// Anything else the system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file to be written.
        path: PathBuf,
        /// What was tried: "write", "rename", ...
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// A tag that the format cannot hold.
    #[error("{}: cannot store the tag {key:?}: {reason}", path.display())]
    Tag {
        /// The file to be written.
        path: PathBuf,
        /// Name of the tag.
        key: String,
        /// Why not.
        reason: String,
    },
    /// The picture's format refused.
    #[error("{}: cannot write {format}: {reason}", path.display())]
    Format {
        /// The file to be written.
        path: PathBuf,
        /// "PNG", "EXR", "MP4", ...
        format: &'static str,
        /// What its encoder said.
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
    #[error("{}: the built-in encoder takes {limits}, not {width}x{height} pixels: use --encoder ffmpeg", path.display())]
    EncoderSize {
        /// The file to be written.
        path: PathBuf,
        /// What it takes, in words.
        limits: &'static str,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A frame rate that is no positive number, or out of reach of the container.
    #[error("{text:?} is not a frame rate: use frames per second such as 30, 29.97 or 24000/1001")]
    FrameRate {
        /// What was given.
        text: String,
    },
    /// This build has no encoder of its own.
    #[error(
        "{}: this program was built without its H.264 encoder: use --encoder ffmpeg, write PNG frames, \
         or build it with `--features h264`",
        path.display()
    )]
    NoBuiltinEncoder {
        /// The file to be written.
        path: PathBuf,
    },
    /// `--encoder ffmpeg` without ffmpeg.
    #[error("{}: cannot start ffmpeg ({source}): install it, or use --encoder builtin", path.display())]
    NoFfmpeg {
        /// The file to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The video encoder gave up.
    #[error("{}: {encoder} failed at frame {frame}: {reason}", path.display())]
    Encode {
        /// The file to be written.
        path: PathBuf,
        /// Its name.
        encoder: &'static str,
        /// Index of the frame, from 0.
        frame: u64,
        /// What it said.
        reason: String,
    },
    /// A video without a frame.
    #[error("{}: no frame to write: a video needs at least one", path.display())]
    NoFrames {
        /// The file to be written.
        path: PathBuf,
    },
}

impl MediaError {
    /// The error for `source` while doing `action` ("write", "rename", ...) for `path`.
    pub(super) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        use io::ErrorKind::{IsADirectory, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
        let path = path.to_path_buf();
        match source.kind() {
            StorageFull | QuotaExceeded => Self::DiskFull { path },
            PermissionDenied | ReadOnlyFilesystem => Self::NotWritable { path, source },
            IsADirectory => Self::IsDirectory { path },
            _ => Self::Io { path, action, source },
        }
    }
}
