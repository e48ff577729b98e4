//! The run folder: configuration, checkpoint, metrics, priors and registered photos of a session.

use super::error::SessionError;
use crate::checkpoint::{self, CheckpointHead};
use crate::config::TrainConfig;
use crate::files::write_json;
use crate::trainer::TrainState;
use serde_json::Value;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use thiserror::Error;
use wm_base::files::{lock_folder, write_atomically};

/// The name of the checkpoint in a run folder.
pub const CHECKPOINT: &str = "checkpoint.wmtrain";
/// The name of the configuration.
const CONFIG: &str = "config.json";
/// The folder of the photos whose cameras were found.
pub(super) const COLMAP: &str = "colmap";
/// The folder of the frames of a video.
pub(super) const FRAMES: &str = "frames";

/// The choice between starting anew and continuing the training in the run folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resume {
    /// It starts anew; a folder that holds a training is refused.
    #[default]
    Never,
    /// It continues from the checkpoint, or starts anew if the training in the folder was ended
    /// before its first one. The folder must have been begun.
    Always,
    /// It starts anew and replaces a training in the folder. The old checkpoint stays until the
    /// first new one is written.
    Overwrite,
}

/// The place where a session keeps its files.
pub(crate) enum RunFolder {
    /// In a folder of the user's.
    Kept {
        path: PathBuf,
        start: Start,
        /// Keeps other trainings out.
        lock: Option<File>,
    },
    /// In a temporary folder for priors and registered photos; nothing else is written.
    Temporary(TempDir),
}

/// The beginning of a training in a run folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Start {
    /// The first step.
    Anew,
    /// The first step again, since the training was ended before its first checkpoint.
    Again,
    /// The checkpoint.
    Checkpoint,
}

impl RunFolder {
    /// Looks at the folder; a training in it is only continued or replaced if `resume` says so.
    pub(crate) fn open(path: Option<&Path>, resume: Resume) -> Result<Self, SessionError> {
        let Some(path) = path else {
            let folder = tempfile::tempdir();
            let folder =
                folder.map_err(|reason| SessionError::Folder { path: std::env::temp_dir(), reason })?;
            return Ok(Self::Temporary(folder));
        };
        let checkpoint = path.join(CHECKPOINT);
        let start = match (resume, checkpoint.is_file()) {
            (Resume::Always, true) => Start::Checkpoint,
            (Resume::Always, false) if is_begun(path) => Start::Again,
            (Resume::Always, false) => return Err(SessionError::NothingToResume(path.to_owned())),
            (Resume::Never, true) => {
                let read = checkpoint::read(&checkpoint);
                let (head, _) = read.map_err(|reason| SessionError::BadCheckpoint {
                    folder: path.to_owned(),
                    reason: reason.into(),
                })?;
                let folder = path.to_owned();
                return Err(match head.step() < head.config.steps {
                    true => SessionError::Unfinished(folder),
                    false => SessionError::Finished(folder),
                });
            }
            (Resume::Never, false) | (Resume::Overwrite, _) => Start::Anew,
        };
        Ok(Self::Kept { path: path.to_owned(), start, lock: None })
    }

    /// Makes the folder, if it does not exist, locks it, and removes what is left of checkpoints
    /// that were not completed.
    pub(crate) fn make(&mut self) -> Result<(), SessionError> {
        let path = self.path().to_owned();
        let fault = |reason| SessionError::Folder { path: path.clone(), reason };
        fs::create_dir_all(&path).map_err(fault)?;
        if let Self::Kept { lock, .. } = self {
            *lock = lock_folder(&path).map_err(|reason| match reason.kind() {
                io::ErrorKind::WouldBlock => SessionError::InUse(path.clone()),
                _ => fault(reason),
            })?;
        }
        for entry in fs::read_dir(&path).into_iter().flatten().flatten() {
            // What a training that was killed had begun to write; it may be large.
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name.starts_with(CHECKPOINT) && name.ends_with(".part") {
                // What cannot be removed does no harm.
                let _ = fs::remove_file(entry.path());
            }
        }
        Ok(())
    }

    pub(crate) fn path(&self) -> &Path {
        match self {
            Self::Kept { path, .. } => path,
            Self::Temporary(folder) => folder.path(),
        }
    }

    /// Returns true if the training continues from a checkpoint.
    pub(crate) fn resumes(&self) -> bool {
        matches!(self, Self::Kept { start: Start::Checkpoint, .. })
    }

    /// Returns true if the training was begun before, and ended before its first checkpoint.
    pub(crate) fn starts_again(&self) -> bool {
        matches!(self, Self::Kept { start: Start::Again, .. })
    }

    /// Returns the place of the checkpoint; `None` in a temporary folder.
    pub(crate) fn checkpoint(&self) -> Option<PathBuf> {
        matches!(self, Self::Kept { .. }).then(|| self.path().join(CHECKPOINT))
    }

    /// Reads the checkpoint to resume from.
    pub(crate) fn resumed(&self) -> Result<Option<(CheckpointHead, TrainState)>, SessionError> {
        match self.checkpoint().filter(|_| self.resumes()) {
            Some(path) => Ok(Some(checkpoint::read(&path)?)),
            None => Ok(None),
        }
    }

    /// Writes the configuration.
    pub(crate) fn write_config(&self, config: &TrainConfig) -> Result<(), SessionError> {
        let Self::Kept { path, .. } = self else { return Ok(()) };
        write_atomically(&path.join(CONFIG), |out| Ok(write_json(config, out)?))?;
        Ok(())
    }

    /// Opens the metrics: anew, or after the lines up to `step`. Of a finished training (`steps`)
    /// the last evaluation is left out, since it is made again. The old lines are there until the
    /// new file is.
    pub(crate) fn metrics(&self, step: u32, steps: u32) -> Result<Metrics, SessionError> {
        let Self::Kept { path, .. } = self else { return Ok(Metrics(None)) };
        let path = path.join("metrics.jsonl");
        let fault = |reason| SessionError::Metrics { path: path.clone(), reason };
        let mut kept = Vec::new();
        if step > 0 && path.exists() {
            let old = fs::read(&path).map_err(fault)?;
            for line in old.split(|byte| *byte == b'\n') {
                // A line that was cut off by a crash is no JSON, perhaps not even text.
                let Ok(value) = serde_json::from_slice::<Value>(line) else { continue };
                let is_last = |at| at == u64::from(steps) && value.get("held_out").is_some();
                if value["step"].as_u64().is_some_and(|at| at <= u64::from(step) && !is_last(at)) {
                    kept.extend_from_slice(line);
                    kept.push(b'\n');
                }
            }
        }
        write_atomically(&path, |out| Ok(out.write_all(&kept)?))?;
        let file = OpenOptions::new().append(true).open(&path).map_err(fault)?;
        Ok(Metrics(Some((file, path))))
    }
}

/// Returns true if the files of a training were begun in a folder: it is empty, or holds one that
/// is written before the first checkpoint.
fn is_begun(folder: &Path) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    let mut names = entries.filter_map(|entry| Some(entry.ok()?.file_name())).peekable();
    names.peek().is_none()
        || names.any(|name| {
            let is_of_checkpoint = name.to_string_lossy().starts_with(CHECKPOINT);
            let is_config = name.to_string_lossy().starts_with(CONFIG);
            is_config || is_of_checkpoint || name == COLMAP || name == FRAMES
        })
}

/// Appends JSON objects to the metrics, one a line.
pub(crate) struct Metrics(Option<(File, PathBuf)>);

impl Metrics {
    pub(crate) fn add(&mut self, value: &Value) -> Result<(), SessionError> {
        let Some((file, path)) = &mut self.0 else { return Ok(()) };
        writeln!(file, "{value}").map_err(|reason| SessionError::Metrics { path: path.clone(), reason })
    }
}

/// A configuration file that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConfigFileError {
    /// It cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        reason: io::Error,
    },
    /// It is not the JSON of a configuration.
    #[error("{}: is no configuration of a training: {reason}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// The place and the fault.
        reason: serde_json::Error,
    },
    /// A value is out of range.
    #[error("{}: {reason}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The value and its range.
        reason: crate::check::ConfigError,
    },
}

impl TrainConfig {
    /// Reads a configuration from a JSON file, such as the `config.json` of a run folder, and
    /// checks it.
    ///
    /// # Errors
    /// [`ConfigFileError`] says what is wrong with the file.
    pub fn read(path: &Path) -> Result<Self, ConfigFileError> {
        let text = wm_base::files::read_text(path, wm_base::files::SMALL_TEXT)
            .map_err(|reason| ConfigFileError::Read { path: path.to_owned(), reason })?;
        let config: Self = serde_json::from_str(&text)
            .map_err(|reason| ConfigFileError::Json { path: path.to_owned(), reason })?;
        config.check().map_err(|reason| ConfigFileError::Value { path: path.to_owned(), reason })?;
        Ok(config)
    }
}
