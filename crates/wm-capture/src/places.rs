//! The folders in which data sets keep their photos, masks and originals, and the files in them.

use super::{CaptureOptions, CaptureView};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use wm_base::file_index::{Ambiguity, FileIndex, FileKind, FilePlace, plain};
use wm_base::{FormatError, Problem};
use wm_scene::Remark;

/// The usual folders of photos in a data set, the likeliest first; the last is the data set itself.
pub(super) const IMAGES: [&str; 8] =
    ["images", "input", "rgb", "images_2", "images_4", "images_8", "photos", ""];

/// Number of photos by which a folder is chosen.
const SAMPLE_PHOTOS: usize = 16;

/// Returns the photo that a view names in `folder` or below.
pub(super) fn photo(folder: &Path, view: &CaptureView) -> Option<PathBuf> {
    let path = folder.join(&view.file);
    path.is_file().then_some(path)
}

/// Finds the photos, masks and originals of `views`, and writes their paths into them. The first of
/// `roots` is the data set, `usual` the names of folders in which its photos may be. Returns the
/// folder of the photos, and remarks on how many files were found.
///
/// # Errors
/// [`FormatError`] if a folder in the options does not exist or has no file of any view, or a file
/// could be of two views.
pub(super) fn find(
    roots: &[&Path],
    options: &CaptureOptions,
    usual: &[&str],
    views: &mut [CaptureView],
) -> Result<(PathBuf, Vec<Remark>), FormatError> {
    let names: Vec<String> = views.iter().map(|view| view.file.to_string_lossy().into_owned()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut remarks = Vec::new();
    let index = match &options.images {
        Some(name) => FileIndex::new(asked_for(roots, name)?, FileKind::PHOTO),
        None => usual_images(roots, usual, &names),
    };
    let images = index.folder().to_path_buf();
    let found = index.find_all(&names).map_err(|e| refused(&images, &e))?;
    let mut elsewhere = Vec::new();
    let mut files = HashSet::new();
    for ((view, found), name) in views.iter_mut().zip(found).zip(&names) {
        let whole = Path::new(name);
        let path = match found {
            _ if whole.is_absolute() && whole.is_file() => whole.to_path_buf(),
            Some(found) => {
                if found.place == FilePlace::Elsewhere || whole.is_absolute() || drive(name) {
                    elsewhere.push(*name);
                }
                found.path
            }
            None => {
                view.file = plain(name).into();
                continue;
            }
        };
        view.file = path.strip_prefix(&images).map_or_else(|_| path.clone(), Path::to_path_buf);
        files.insert(path);
    }
    if files.is_empty() && options.images.is_some() {
        return Err(none_in(&images, "photo", &names));
    }
    if let Some(first) = elsewhere.first() {
        let (count, all, place) = (elsewhere.len(), views.len(), images.display());
        remarks.push(Remark::note(
            "photos-by-name",
            format!("{count} of {all} photos were found in {place} by their names, since the capture has other folders, such as {first:?}"),
        ));
    }
    let home = home_of(&files).unwrap_or_else(|| images.clone());
    remarks.extend(unused(&files, &home, roots));
    remarks.extend(masks(roots, options, &images, &home, &names, views)?);
    if let Some(folder) = &options.originals {
        let found =
            FileIndex::new(folder, FileKind::PHOTO).find_all(&names).map_err(|e| refused(folder, &e))?;
        for (view, found) in views.iter_mut().zip(found) {
            view.original = found.map(|found| found.path);
        }
        let count = views.iter().filter(|view| view.original.is_some()).count();
        if count == 0 {
            return Err(none_in(folder, "original", &names));
        }
        let text =
            format!("originals of {count} of {} photos were found in {}", views.len(), folder.display());
        remarks.push(Remark::note("originals", text));
    }
    shorten_names(views);
    Ok((images, remarks))
}

/// Returns true if a path begins with a drive of Windows.
fn drive(path: &str) -> bool {
    matches!(path.as_bytes(), [letter, b':', b'/' | b'\\', ..] if letter.is_ascii_alphabetic())
}

fn refused(folder: &Path, error: &Ambiguity) -> FormatError {
    FormatError::value(folder, error.to_string())
}

/// The error of a folder that was asked for and has no file of any view.
fn none_in(folder: &Path, kind: &str, names: &[&str]) -> FormatError {
    let first = names.first().map(|name| plain(name)).unwrap_or_default();
    let what = format!(
        "no {kind} of any of the {} photos is in it, such as of {first:?}; name another folder",
        names.len()
    );
    FormatError::value(folder, what)
}

/// The folder of photos that has most of the names; if none has any, the first that is there, so
/// that the message about a missing photo names a sensible place.
fn usual_images(roots: &[&Path], usual: &[&str], names: &[&str]) -> FileIndex {
    let sample: Vec<&str> = names.iter().step_by(names.len() / SAMPLE_PHOTOS + 1).copied().collect();
    let mut best: Option<(usize, FileIndex)> = None;
    for (up, root) in roots.iter().enumerate() {
        for name in usual {
            let index = FileIndex::new(root.join(name), FileKind::PHOTO);
            if !index.folder().is_dir() {
                continue;
            }
            // Above the data set lie other data sets, whose photos have the same names.
            let is_there = |name: &&&str| match up {
                0 => matches!(index.find(name), Ok(Some(_))),
                _ if index.folder() == *root => index.folder().join(plain(name)).is_file(),
                _ => matches!(index.find(name), Ok(Some(found)) if found.place >= FilePlace::WithoutLeading),
            };
            let count = sample.iter().filter(is_there).count();
            if count == sample.len() {
                return index;
            }
            if best.as_ref().is_none_or(|(most, _)| count > *most) {
                best = Some((count, index));
            }
        }
    }
    best.map(|(_, index)| index).unwrap_or_else(|| {
        let usual = roots.first().map_or_else(PathBuf::new, |root| root.join(IMAGES[0]));
        FileIndex::new(usual, FileKind::PHOTO)
    })
}

/// The folder that has all of the files in it or below.
fn home_of(files: &HashSet<PathBuf>) -> Option<PathBuf> {
    let mut home = files.iter().next()?.parent()?;
    while !files.iter().all(|file| file.starts_with(home)) {
        home = home.parent()?;
    }
    Some(home.to_path_buf())
}

/// A remark on the photos in a folder that no view has.
fn unused(files: &HashSet<PathBuf>, home: &Path, roots: &[&Path]) -> Option<Remark> {
    if files.is_empty() {
        return None;
    }
    let is_root = roots.contains(&home);
    let parents: HashSet<&Path> = files.iter().filter_map(|file| file.parent()).collect();
    let masks = FileIndex::new(home, FileKind::MASK_BESIDE);
    let is_mask: HashSet<&String> = masks.files().iter().filter(|file| is_named_mask(file)).collect();
    let index = FileIndex::new(home, FileKind::PHOTO);
    let others = index.files().iter().filter(|file| !is_mask.contains(file)).filter(|file| {
        let path = home.join(file);
        // The data set itself holds other pictures, too.
        !files.contains(&path) && (!is_root || path.parent().is_some_and(|parent| parents.contains(parent)))
    });
    let (used, unused) = (files.len(), others.count());
    let all = used + unused;
    let text = format!("{used} of the {all} photos in {} have a camera", home.display());
    match unused {
        0 => None,
        _ if 2 * used < all => Some(Remark::doubt(
            "photos-unused",
            format!("{text}; find the cameras of the others, or choose another model with --model"),
        )),
        _ => Some(Remark::note("photos-unused", format!("{text}, the others are not used"))),
    }
}

/// Returns true if a picture among photos is called a mask.
fn is_named_mask(file: &str) -> bool {
    let name = file.to_lowercase();
    let stem = name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem);
    FileKind::MASK.endings.iter().any(|ending| stem.ends_with(ending))
}

/// Writes the masks of `views` into them; see [`find`].
fn masks(
    roots: &[&Path],
    options: &CaptureOptions,
    images: &Path,
    home: &Path,
    names: &[&str],
    views: &mut [CaptureView],
) -> Result<Vec<Remark>, FormatError> {
    let root = roots.first().copied().unwrap_or(images);
    let mut remarks = Vec::new();
    let mut folders = Vec::new();
    let mut missing = Vec::new();
    if let Some(name) = &options.masks {
        folders.push(asked_for(roots, name)?);
    } else if views.iter().any(|view| view.mask.is_some()) {
        let index = FileIndex::new(root, FileKind::MASK);
        for view in views.iter_mut() {
            let Some(name) = view.mask.take().map(|path| path.to_string_lossy().into_owned()) else {
                continue;
            };
            let whole = Path::new(&name);
            view.mask = if whole.is_absolute() && whole.is_file() {
                Some(whole.to_path_buf())
            } else {
                index.find(&name).map_err(|e| refused(root, &e))?.map(|found| found.path)
            };
            if view.mask.is_none() {
                missing.push(name);
            }
        }
        if let Some(first) = missing.first() {
            let count = missing.len();
            remarks.push(Remark::doubt(
                "masks-missing",
                format!("{count} masks that the capture names are missing, such as {first:?}, and those photos are used without; copy them, or give their folder with --masks"),
            ));
        }
    } else {
        // `images_4` has its masks in `masks_4`, where there are some.
        let reduced = images.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let reduced = reduced.strip_prefix("images").filter(|rest| rest.starts_with('_')).unwrap_or_default();
        let usual = [format!("masks{reduced}"), "masks".into(), "mask".into()];
        let beside = images.parent().into_iter().chain([root]);
        folders = beside.flat_map(|root| usual.iter().map(move |name| root.join(name))).collect();
        folders.retain(|folder| folder.is_dir());
    }
    let mut used = None;
    for folder in &folders {
        let found =
            FileIndex::new(folder, FileKind::MASK).find_all(names).map_err(|e| refused(folder, &e))?;
        if found.iter().any(Option::is_some) {
            let found = found.into_iter().map(|found| found.map(|found| found.path));
            views.iter_mut().zip(found).for_each(|(view, found)| view.mask = found);
            used = Some(folder.as_path());
            break;
        }
    }
    if let (None, Some(folder)) = (used, folders.first()) {
        if options.masks.is_some() {
            return Err(none_in(folder, "mask", names));
        }
        let first = plain(names.first().unwrap_or(&""));
        remarks.push(Remark::doubt(
            "masks-unused",
            format!(
                "{} has no mask of any photo, and none is used; call them as the photos, such as {first}.png",
                folder.display()
            ),
        ));
    }
    if folders.is_empty() && views.iter().all(|view| view.mask.is_none()) && missing.is_empty() {
        let found =
            FileIndex::new(home, FileKind::MASK_BESIDE).find_all(names).map_err(|e| refused(home, &e))?;
        views.iter_mut().zip(found).for_each(|(view, found)| view.mask = found.map(|found| found.path));
        used = Some(home);
    }
    let count = views.iter().filter(|view| view.mask.is_some()).count();
    if count > 0 {
        let place = used.map(|folder| format!(", from {}", folder.display())).unwrap_or_default();
        let text = format!("masks of {count} of {} photos are used{place}", views.len());
        remarks.push(Remark::note("masks", text));
    }
    Ok(remarks)
}

/// Leaves out of the names that are whole paths the folders that all have.
fn shorten_names(views: &mut [CaptureView]) {
    let is_whole = |name: &str| name.starts_with('/') || name.starts_with("file:") || drive(name);
    let whole = |view: &CaptureView| is_whole(&view.name).then(|| plain(&view.name));
    let paths: Vec<String> = views.iter().filter_map(whole).collect();
    let Some(first) = paths.first() else { return };
    let mut common = first.rfind('/').map_or(0, |at| at + 1);
    while !paths.iter().all(|path| path.starts_with(&first[..common])) {
        common = first[..common - 1].rfind('/').map_or(0, |at| at + 1);
    }
    for view in views.iter_mut().filter(|view| is_whole(&view.name)) {
        // A drive that is left is a folder.
        view.name = plain(&view.name)[common..].replace(':', "");
    }
}

fn asked_for(roots: &[&Path], name: &Path) -> Result<PathBuf, FormatError> {
    let found = roots.iter().map(|root| root.join(name)).find(|folder| folder.is_dir());
    found.ok_or_else(|| {
        let place = roots.first().map_or_else(|| name.into(), |root| root.join(name));
        FormatError::whole(&place, Problem::Missing)
    })
}
