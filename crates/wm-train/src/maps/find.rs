//! Finds the map of a photo in a folder.

use super::{MapError, MapFault};
use std::path::{Component, Path, PathBuf};

/// Extensions of maps, in lower case.
pub const EXTENSIONS: [&str; 5] = ["npy", "exr", "tiff", "tif", "png"];

/// The map of a photo in `folder`: the photo's name with the extension of a map, folders in it kept, so that
/// `a/b.jpg` has `a/b.npy`. `None` if there is none.
///
/// # Errors
/// [`MapFault::Two`] if two files have such a name.
pub fn find_map(folder: &Path, photo: &str) -> Result<Option<PathBuf>, MapError> {
    // Names come from files of others, which may name places outside of the folder.
    let parts = Path::new(photo).components().filter(|part| matches!(part, Component::Normal(_)));
    let place = folder.join(parts.collect::<PathBuf>());
    if place.file_name().is_none() || place == folder {
        return Ok(None);
    }
    let mut found: Option<PathBuf> = None;
    for extension in EXTENSIONS {
        let path = place.with_extension(extension);
        if !path.is_file() {
            continue;
        }
        if let Some(first) = &found {
            let other = first.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Err(MapError { path, fault: MapFault::Two(other) });
        }
        found = Some(path);
    }
    Ok(found)
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
        for name in ["a/b.npy", "c.1.png", "d.exr", "d.tif", "e.txt"] {
            fs::write(at(name), "").unwrap();
        }
        let find = |photo: &str| find_map(folder.path(), photo);
        assert_eq!(find("a/b.jpg"), Ok(Some(at("a/b.npy"))));
        assert_eq!(find("c.1.JPG"), Ok(Some(at("c.1.png"))));
        assert_eq!(find("../a/b.jpg"), Ok(Some(at("a/b.npy"))));
        for nothing in ["b.jpg", "e.jpg", "c.jpg", "..", "", "/"] {
            assert_eq!(find(nothing), Ok(None), "{nothing}");
        }
        let error = find("d.png").unwrap_err().to_string();
        assert!(
            error.ends_with("d.tif: lies beside d.exr, a map of the same photo; remove one of them"),
            "{error}"
        );
    }
}
