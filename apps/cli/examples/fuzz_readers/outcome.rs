//! Ends of runs, and files of seeds.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// The end of a run: that the input was read, or one line of error.
pub type Outcome = Result<(), String>;

/// The path of a seed, which is read.
pub type SeedPath = Result<PathBuf, Box<dyn Error + Send + Sync>>;

/// Returns the end of a run that has read something, or failed.
pub fn done<T>(outcome: Result<T, impl std::fmt::Display>) -> Outcome {
    outcome.map(drop).map_err(|error| error.to_string())
}

/// Writes a file of a seed, which is read.
pub fn put(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> SeedPath {
    let path = folder.join(name);
    fs::write(&path, content)?;
    Ok(path)
}
