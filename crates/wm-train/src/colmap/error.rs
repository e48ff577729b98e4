//! The error of a run of COLMAP.

use super::progress::ColmapStep;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use thiserror::Error;
use wm_base::FormatError;

/// A reason why COLMAP makes no capture.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ColmapError {
    /// There is neither COLMAP nor pycolmap.
    #[error(
        "neither COLMAP nor pycolmap is installed, and photos alone have no cameras; install one with `{INSTALL}`, or give a \
         data set that has a COLMAP model or a transforms.json"
    )]
    NotInstalled,
    /// A photo is too small.
    #[error("{}: {width}x{height} px is too small to find its camera; give a larger photo, or remove it", photo.display())]
    SmallPhoto {
        /// The photo.
        photo: PathBuf,
        /// The width, px.
        width: u32,
        /// The height, px.
        height: u32,
    },
    /// The folder has too few photos.
    #[error("{}: {found}, at least 3 are needed", folder.display())]
    FewPhotos {
        /// The folder.
        folder: PathBuf,
        /// The number of photos that were found, in words.
        found: String,
    },
    /// The folder, or one in it, cannot be read.
    #[error(transparent)]
    Folder(#[from] FormatError),
    /// Something lies where the run would write.
    #[error("{}: it is there already and no run of COLMAP; choose another folder", .0.display())]
    Occupied(PathBuf),
    /// A file or folder cannot be used.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// The program does not start.
    #[error("{}: cannot be started: {reason}", program.display())]
    Start {
        /// The program.
        program: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// A command failed.
    #[error("COLMAP failed while {} ({status}{said}); all it said is in {}", step.name(), log.display())]
    Failed {
        /// The step that failed.
        step: ColmapStep,
        /// The exit status of the command.
        status: ExitStatus,
        /// The last error of the program, after `: `, if it named one.
        said: String,
        /// The log with the rest of its output.
        log: PathBuf,
    },
    /// No model came out.
    #[error(
        "COLMAP found no cameras: the photos share too little, or hold too little detail; take more, with more \
         overlap ({shared}its log is {})", log.display()
    )]
    NothingRegistered {
        /// The points that the photos share, followed by `; `, if they are known.
        shared: String,
        /// The log.
        log: PathBuf,
    },
    /// Whoever asked for it wants it no more.
    #[error("stopped while {}; started again it goes on with what is in {}", step.name(), folder.display())]
    Stopped {
        /// The step that was stopped.
        step: ColmapStep,
        /// The folder of the run.
        folder: PathBuf,
    },
}

/// The command that installs pycolmap, which works wherever Python is.
const INSTALL: &str = "pip install pycolmap";

pub(super) fn make_folder(path: &Path) -> Result<(), ColmapError> {
    fs::create_dir_all(path).map_err(|e| file_error(path, e))
}

pub(super) fn file_error(path: &Path, reason: std::io::Error) -> ColmapError {
    ColmapError::File { path: path.into(), reason }
}
