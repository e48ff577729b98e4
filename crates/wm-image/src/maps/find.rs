//! Finds the map of a photo in a folder.

use super::error::{MapError, MapFault};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wm_base::file_index::{FileIndex, FileKind};

/// Extensions of maps, in lower case.
pub const EXTENSIONS: [&str; 5] = ["npy", "exr", "tiff", "tif", "png"];

/// Names of maps: those of their photos, perhaps with an ending.
const MAP: FileKind = FileKind {
    extensions: &EXTENSIONS,
    endings: &["_depth", "_normal", "_normals", "_sky", "_mask", "_label", "_semantic"],
    skipped: &[],
};

/// A folder of maps that are named after photos.
#[derive(Clone, Debug)]
pub struct MapFolder(Arc<FileIndex>);

impl MapFolder {
    /// A folder, which is listed when the first map is looked for.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self(Arc::new(FileIndex::new(folder, MAP)))
    }

    /// The folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.0.folder()
    }

    /// The map of a photo: `a/b.npy` of `a/b.jpg`, or what else [`FileIndex::find`] takes for it.
    /// `None` if there is none.
    ///
    /// # Errors
    /// [`MapFault::Ambiguous`] if two files could be the map.
    pub fn find(&self, photo: &str) -> Result<Option<PathBuf>, MapError> {
        let fault = |error: wm_base::file_index::Ambiguity| MapError {
            path: self.path().into(),
            fault: MapFault::Ambiguous(error.to_string()),
        };
        Ok(self.0.find(photo).map_err(fault)?.map(|found| found.path))
    }
}

impl PartialEq for MapFolder {
    fn eq(&self, other: &Self) -> bool {
        self.path() == other.path()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn maps_are_found_by_the_name_of_their_photo() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("a")).unwrap();
        for name in ["a/b.npy", "c.1.png", "d.exr", "d.tif", "e.txt", "f_depth.EXR"] {
            fs::write(at(name), "").unwrap();
        }
        let maps = MapFolder::new(folder.path());
        for (photo, map) in [
            ("a/b.jpg", Some("a/b.npy")),
            ("images/a/b.jpg", Some("a/b.npy")),
            ("b.jpg", Some("a/b.npy")),
            ("c.1.JPG", Some("c.1.png")),
            ("../a/b.jpg", Some("a/b.npy")),
            ("f.png", Some("f_depth.EXR")),
            ("e.jpg", None),
            ("c.jpg", None),
            ("..", None),
            ("", None),
            ("/", None),
        ] {
            assert_eq!(maps.find(photo), Ok(map.map(at)), "{photo}");
        }
        let error = maps.find("d.png").unwrap_err().to_string();
        assert!(error.contains("could both be \"d.png\"; rename or remove one of them"), "{error}");
    }
}
