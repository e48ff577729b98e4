//! Names of output files.

use std::path::{Path, PathBuf};

/// Returns the name of a scene for output files: that of the file, of the training's folder, or of
/// the folder for files that have the same name in every folder, such as `meta.json`.
pub(crate) fn stem_of(scene: &Path) -> String {
    let canonical = scene.canonicalize().unwrap_or_else(|_| scene.into());
    let is_main = canonical.file_name().is_some_and(|name| name == "meta.json" || name == "lod-meta.json");
    let named = if is_main { canonical.parent().unwrap_or(&canonical) } else { &canonical };
    let part = if named.is_dir() { named.file_name() } else { named.file_stem() };
    let name = part.map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned());
    name.strip_suffix(".compressed").map_or(name.clone(), str::to_owned)
}

/// Returns a path with a text behind its name, which may contain dots.
pub(crate) fn with_behind(path: &Path, text: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(text);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_the_scene() {
        assert_eq!(stem_of(Path::new("somewhere/garden.ply")), "garden");
        assert_eq!(stem_of(Path::new("somewhere/garden.compressed.ply")), "garden");
        assert_eq!(stem_of(Path::new("garden/meta.json")), "garden");
    }
}
