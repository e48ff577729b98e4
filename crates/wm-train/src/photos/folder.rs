//! Photos that lie in a folder.

use std::fs;
use std::path::{Path, PathBuf};
use wm_base::FormatError;

/// The photos in a folder and those below it, by their names (`.jpg`, `.jpeg`, `.png`), sorted; and
/// how many other files there are.
///
/// # Errors
/// [`FormatError`] with the folder that cannot be read.
pub fn photos_in(folder: &Path) -> Result<(Vec<PathBuf>, usize), FormatError> {
    /// Deeper folders are no photo collection, but may be a link to themselves.
    const MAX_DEPTH: usize = 16;
    let (mut found, mut others) = (Vec::new(), 0);
    let mut open = vec![(folder.to_path_buf(), 0)];
    while let Some((place, depth)) = open.pop() {
        let reading = |error| FormatError::reading(&place, error);
        for entry in fs::read_dir(&place).map_err(reading)? {
            let path = entry.map_err(reading)?.path();
            let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            if path.is_dir() {
                if depth < MAX_DEPTH {
                    open.push((path, depth + 1));
                }
            } else if matches!(extension.as_str(), "jpg" | "jpeg" | "png") {
                found.push(path);
            } else {
                others += 1;
            }
        }
    }
    found.sort();
    Ok((found, others))
}
