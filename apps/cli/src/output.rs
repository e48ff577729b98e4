//! Folders, texts and JSON that commands write or print.

use anyhow::{Context, Result};
use serde::Serialize;
use std::path::Path;
use wm_base::files::write_atomically;

/// Makes a folder, with those that it lies in.
pub(crate) fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))
}

/// Writes a text in place of a file.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<()> {
    Ok(write_atomically(path, |out| Ok(out.write_all(text.as_bytes())?))?)
}

/// Returns a value as a JSON file for people.
pub(crate) fn json_text(value: &(impl Serialize + ?Sized)) -> Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

/// Prints a value as JSON.
pub(crate) fn print_json(value: &(impl Serialize + ?Sized)) -> Result<()> {
    println!("{}", json_text(value)?.trim_end());
    Ok(())
}
