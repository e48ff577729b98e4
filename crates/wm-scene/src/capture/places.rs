//! The folders in which data sets keep their photos and masks.

use super::{CaptureOptions, CaptureView};
use crate::{FormatError, Problem};
use std::path::{Path, PathBuf};

/// The usual folders of photos in a data set, the likeliest first; the last is the data set itself.
const IMAGES: [&str; 8] = ["images", "input", "rgb", "images_2", "images_4", "images_8", "photos", ""];

/// Extensions that a photo or a mask may have instead of the one in its name.
const EXTENSIONS: [&str; 6] = ["jpg", "JPG", "png", "PNG", "jpeg", "JPEG"];

/// The file itself if it exists, else the same with another extension of pictures.
pub(super) fn with_any_extension(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return Some(path.into());
    }
    // Appended as well: some names have no extension, and a dot of their own.
    let appended = EXTENSIONS.iter().map(|extension| {
        let mut name = path.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    });
    let replaced = EXTENSIONS.iter().map(|extension| path.with_extension(extension));
    replaced.chain(appended).find(|path| path.is_file())
}

/// The folders of photos and masks for `views`, looked for in `roots` in turn.
///
/// The first folder that has the photo of one of the first views; if none has, the first that is
/// there, so that the message about a missing photo names a sensible place.
///
/// # Errors
/// [`FormatError`] if a folder in the options does not exist.
pub(super) fn find(
    roots: &[&Path],
    options: &CaptureOptions,
    views: &[CaptureView],
) -> Result<(PathBuf, Option<PathBuf>), FormatError> {
    let images = match &options.images {
        Some(name) => asked_for(roots, name)?,
        None => {
            let folders = || roots.iter().flat_map(|root| IMAGES.iter().map(move |name| root.join(name)));
            let has_photos = |folder: &PathBuf| {
                views.iter().take(3).any(|view| with_any_extension(&folder.join(&view.file)).is_some())
            };
            let found = folders().find(has_photos).or_else(|| folders().find(|folder| folder.is_dir()));
            found.unwrap_or_else(|| roots.first().map_or_else(PathBuf::new, |root| root.join(IMAGES[0])))
        }
    };
    let masks = match &options.masks {
        Some(name) => Some(asked_for(roots, name)?),
        None => {
            // `images_4` has its masks in `masks_4`, where there are some.
            let name = images.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let reduced =
                name.strip_prefix("images").filter(|rest| rest.starts_with('_')).unwrap_or_default();
            let names = [format!("masks{reduced}"), "masks".into(), "mask".into()];
            let beside = images.parent().into_iter().chain(roots.first().copied());
            beside
                .flat_map(|root| names.iter().map(move |name| root.join(name)))
                .find(|folder| folder.is_dir())
        }
    };
    Ok((images, masks))
}

fn asked_for(roots: &[&Path], name: &Path) -> Result<PathBuf, FormatError> {
    let found = roots.iter().map(|root| root.join(name)).find(|folder| folder.is_dir());
    found.ok_or_else(|| {
        let place = roots.first().map_or_else(|| name.into(), |root| root.join(name));
        FormatError::whole(&place, Problem::Missing)
    })
}
