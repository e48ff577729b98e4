//! The run folder: configuration, checkpoint, metrics, priors and registered photos of a session.

use super::error::SessionError;
use crate::checkpoint::{self, CheckpointHead};
use crate::config::TrainConfig;
use crate::trainer::TrainState;
use serde_json::Value;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use thiserror::Error;
use wm_scene::files::write_atomically;

/// The name of the checkpoint in a run folder.
pub const CHECKPOINT: &str = "checkpoint.wmtrain";

/// The choice between starting anew and continuing the training in the run folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resume {
    /// It starts anew; an unfinished training in the folder is refused.
    #[default]
    Never,
    /// It continues from the checkpoint, which must exist.
    Always,
}

/// The place where a session keeps its files.
pub(super) enum RunFolder {
    /// In a folder of the user's.
    Kept { path: PathBuf, resume: Resume },
    /// In a temporary folder for priors and registered photos; nothing else is written.
    Temporary(TempDir),
}

impl RunFolder {
    /// Looks at the folder; a training in it is only continued if `resume` says so.
    pub fn open(path: Option<&Path>, resume: Resume) -> Result<Self, SessionError> {
        let Some(path) = path else {
            let folder = tempfile::tempdir();
            let folder =
                folder.map_err(|reason| SessionError::Folder { path: std::env::temp_dir(), reason })?;
            return Ok(Self::Temporary(folder));
        };
        let checkpoint = path.join(CHECKPOINT);
        match (resume, checkpoint.is_file()) {
            (Resume::Always, false) => return Err(SessionError::NothingToResume(path.to_owned())),
            (Resume::Never, true) => {
                let read = checkpoint::read(&checkpoint);
                let (head, _) = read.map_err(|reason| SessionError::BadCheckpoint {
                    folder: path.to_owned(),
                    reason: reason.into(),
                })?;
                if head.step() < head.config.steps {
                    return Err(SessionError::Unfinished(path.to_owned()));
                }
            }
            _ => {}
        }
        Ok(Self::Kept { path: path.to_owned(), resume })
    }

    /// Makes the folder, if it does not exist.
    pub fn make(&self) -> Result<(), SessionError> {
        let path = self.path();
        fs::create_dir_all(path).map_err(|reason| SessionError::Folder { path: path.to_owned(), reason })
    }

    pub fn path(&self) -> &Path {
        match self {
            Self::Kept { path, .. } => path,
            Self::Temporary(folder) => folder.path(),
        }
    }

    pub fn resumes(&self) -> bool {
        matches!(self, Self::Kept { resume: Resume::Always, .. })
    }

    /// Returns the place of the checkpoint; `None` in a temporary folder.
    pub fn checkpoint(&self) -> Option<PathBuf> {
        matches!(self, Self::Kept { .. }).then(|| self.path().join(CHECKPOINT))
    }

    /// Reads the checkpoint to resume from.
    pub fn resumed(&self) -> Result<Option<(CheckpointHead, TrainState)>, SessionError> {
        match self.checkpoint().filter(|_| self.resumes()) {
            Some(path) => Ok(Some(checkpoint::read(&path)?)),
            None => Ok(None),
        }
    }

    /// Writes the configuration.
    pub fn write_config(&self, config: &TrainConfig) -> Result<(), SessionError> {
        let Self::Kept { path, .. } = self else { return Ok(()) };
        write_atomically(&path.join("config.json"), |out| {
            let text = serde_json::to_string_pretty(config).map_err(io::Error::from)?;
            Ok(writeln!(out, "{text}")?)
        })?;
        Ok(())
    }

    /// Opens the metrics: anew, or after the lines up to `step`. Of a finished training (`steps`) the last
    /// evaluation is left out, since it is made again.
    pub fn metrics(&self, step: u32, steps: u32) -> Result<Metrics, SessionError> {
        let Self::Kept { path, .. } = self else { return Ok(Metrics(None)) };
        let path = path.join("metrics.jsonl");
        let fault = |reason| SessionError::Metrics { path: path.clone(), reason };
        let mut kept = Vec::new();
        if step > 0 && path.exists() {
            for line in BufReader::new(File::open(&path).map_err(fault)?).lines() {
                let line = line.map_err(fault)?;
                // A line that was cut off by a crash is no JSON.
                let Ok(value) = serde_json::from_str::<Value>(&line) else { continue };
                let is_last = |at| at == u64::from(steps) && value.get("held_out").is_some();
                if value["step"].as_u64().is_some_and(|at| at <= u64::from(step) && !is_last(at)) {
                    kept.push(line);
                }
            }
        }
        let file = OpenOptions::new().create(true).write(true).truncate(true).open(&path).map_err(fault)?;
        let mut metrics = Metrics(Some((file, path)));
        for line in kept {
            metrics.line(&line)?;
        }
        Ok(metrics)
    }
}

/// Appends JSON objects to the metrics, one a line.
pub(super) struct Metrics(Option<(File, PathBuf)>);

impl Metrics {
    pub fn add(&mut self, value: &Value) -> Result<(), SessionError> {
        self.line(&value.to_string())
    }

    fn line(&mut self, line: &str) -> Result<(), SessionError> {
        let Some((file, path)) = &mut self.0 else { return Ok(()) };
        writeln!(file, "{line}").map_err(|reason| SessionError::Metrics { path: path.clone(), reason })
    }
}

/// A configuration file that cannot be used.
#[derive(Debug, Error)]
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
    /// Reads a configuration from a JSON file, such as the `config.json` of a run folder, and checks it.
    ///
    /// # Errors
    /// [`ConfigFileError`] says what is wrong with the file.
    pub fn read(path: &Path) -> Result<Self, ConfigFileError> {
        let text = fs::read_to_string(path)
            .map_err(|reason| ConfigFileError::Read { path: path.to_owned(), reason })?;
        let config: Self = serde_json::from_str(&text)
            .map_err(|reason| ConfigFileError::Json { path: path.to_owned(), reason })?;
        config.check().map_err(|reason| ConfigFileError::Value { path: path.to_owned(), reason })?;
        Ok(config)
    }
}
