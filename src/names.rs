//! Names of output files.

use std::path::{Path, PathBuf};

/// The name of a scene, to name outputs after: that of the file, or of a training's folder.
pub fn stem_of(scene: &Path) -> String {
    let canonical = scene.canonicalize().unwrap_or_else(|_| scene.into());
    let part = if canonical.is_dir() { canonical.file_name() } else { canonical.file_stem() };
    part.map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

/// `path` with `.kind.extension` for its extension: `a.png` and depth give `a.depth.png`.
pub fn beside(path: &Path, kind: &str, extension: &str) -> PathBuf {
    path.with_extension(format!("{kind}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_are_named_after_the_scene() {
        assert_eq!(stem_of(Path::new("somewhere/garden.ply")), "garden");
        assert_eq!(beside(Path::new("out/a.png"), "depth", "exr"), Path::new("out/a.depth.exr"));
    }
}
