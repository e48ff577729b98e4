//! Files beside a scene file, also where the scene file is a symbolic link.

use std::fs;
use std::path::{Path, PathBuf};
use wm_base::files;

/// Returns the places of a scene file, beside which its further files are looked for in this order:
/// its path, then, behind symbolic links, the file itself.
pub(crate) fn places(scene_file: &Path) -> Vec<PathBuf> {
    let given = scene_file.to_path_buf();
    match fs::canonicalize(scene_file) {
        Ok(real) if real != given => vec![given, real],
        _ => vec![given],
    }
}

/// Returns the path of the file `name` in the folder of a scene file: the first of its [`places`]
/// that has it, else that beside its path.
pub(crate) fn beside(scene_file: &Path, name: &Path) -> PathBuf {
    let places = places(scene_file);
    let mut paths = places.iter().map(|place| place.parent().unwrap_or(place).join(name));
    let found = paths.clone().find(|path| files::is_there(path));
    found.or_else(|| paths.next()).unwrap_or_else(|| name.to_path_buf())
}
