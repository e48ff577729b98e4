//! Sizes of the files of scenes.

use std::path::Path;

/// Returns the size of a file, bytes; 0 if there is none.
pub(super) fn file_size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |about| about.len())
}

/// Returns the size of the JSON and the pictures of a SOG folder, bytes.
pub(super) fn folder_size(main: &Path) -> u64 {
    let entries = main.parent().and_then(|folder| std::fs::read_dir(folder).ok());
    let paths = entries.into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    paths
        .filter(|path| path == main || path.extension().is_some_and(|e| e == "webp"))
        .map(|path| file_size(&path))
        .sum()
}
