//! COLMAP models: `cameras`, `images` and `points3D`, binary (`.bin`) or text (`.txt`).
//!
//! COLMAP's axes are those of [`Camera`](wm_scene::Camera): x right, y down, z forward; a pose is
//! camera_from_world as a wxyz quaternion and a translation; the centre of the top left pixel is
//! (0.5, 0.5). So nothing is converted. Pinhole cameras are read, and those whose distortion is of
//! the form of [`Distortion`](wm_scene::camera::Distortion); the others are refused with the
//! command that undistorts the photos. Of the 2D points those are kept that belong to a 3D point.

mod binary;
mod records;
#[cfg(test)]
mod tests;
mod text;
pub mod write;

use super::{Capture, CaptureOptions, ReadScope, foreign::model_below, places};
use records::{Cameras, Images, NumberedPoints, Places};
use std::path::{Path, PathBuf};
use wm_base::{FormatError, Problem, source::Source};
use wm_scene::{Remark, SparsePoints};

/// The folders below the given one that may hold a model, in the order in which they are tried.
/// `*` stands for all folders, of which the one with most photos is taken.
const FOLDERS: [&str; 7] = ["", "sparse/*", "sparse", "0", "colmap/sparse/*", "colmap/sparse", "sparse_txt"];

/// One of the two ways in which a model is stored.
struct Kind {
    cameras: &'static str,
    images: &'static str,
    points: &'static str,
    read_cameras: fn(&mut Source) -> Result<Cameras, FormatError>,
    /// The number of photos, without reading them.
    count_images: fn(&mut Source) -> Result<u64, FormatError>,
    read_images: fn(&mut Source, &Cameras, &Places) -> Result<Images, FormatError>,
    read_points: fn(&mut Source) -> Result<NumberedPoints, FormatError>,
}

const KINDS: [Kind; 2] = [
    Kind {
        cameras: "cameras.bin",
        images: "images.bin",
        points: "points3D.bin",
        read_cameras: binary::read_cameras,
        count_images: binary::count_images,
        read_images: binary::read_images,
        read_points: binary::read_points,
    },
    Kind {
        cameras: "cameras.txt",
        images: "images.txt",
        points: "points3D.txt",
        read_cameras: text::read_cameras,
        count_images: text::count_images,
        read_images: text::read_images,
        read_points: text::read_points,
    },
];

pub(super) fn read(
    dataset: &Path,
    options: &CaptureOptions,
    scope: ReadScope,
) -> Result<Option<Capture>, FormatError> {
    let Some(Model { place, kind, remarks }) = choose_model(dataset, options)? else { return Ok(None) };
    let mut remarks = Vec::from_iter(remarks);
    let cameras = (kind.read_cameras)(&mut Source::open(&place.join(kind.cameras))?)?;
    let file = place.join(kind.points);
    let (points, indices) = if scope == ReadScope::Everything && file.is_file() {
        let (points, indices) = (kind.read_points)(&mut Source::open(&file)?)?;
        (points, Some(indices))
    } else {
        (SparsePoints::default(), None)
    };
    let mut images = Source::open(&place.join(kind.images))?;
    let (mut views, observations) = (kind.read_images)(&mut images, &cameras, &indices)?;
    if views.is_empty() {
        let problem = "no image is registered in the model; reconstruct the capture again";
        return Err(images.whole(Problem::Value(problem.into())));
    }
    // The folder of the model itself may have been given: its data set is one or two above.
    let full = std::path::absolute(dataset).unwrap_or_else(|_| dataset.into());
    let roots: Vec<&Path> = std::iter::once(dataset).chain(full.ancestors().skip(1).take(2)).collect();
    let (images, found) = places::find(&roots, options, &places::IMAGES, &mut views)?;
    remarks.extend(found);
    Ok(Some(Capture { images, views, points, observations, remarks, ..Capture::default() }))
}

/// Reads the points of a model alone.
///
/// # Errors
/// [`FormatError`] if there is no model, or it is broken.
pub(super) fn read_points(dataset: &Path, options: &CaptureOptions) -> Result<SparsePoints, FormatError> {
    let Some(Model { place, kind, .. }) = choose_model(dataset, options)? else {
        return Err(FormatError::whole(dataset, Problem::NoCapture));
    };
    Ok((kind.read_points)(&mut Source::open(&place.join(kind.points))?)?.0)
}

/// A model that was chosen.
struct Model {
    place: PathBuf,
    kind: &'static Kind,
    /// A remark on the models that were passed over.
    remarks: Option<Remark>,
}

/// Chooses the model of a data set: of the first folder that has one, or of several models beside
/// each other the one with most photos. `None` if there is none.
fn choose_model(dataset: &Path, options: &CaptureOptions) -> Result<Option<Model>, FormatError> {
    let groups: Vec<Vec<PathBuf>> = match &options.model {
        Some(folder) => vec![vec![dataset.join(folder)]],
        None => FOLDERS
            .iter()
            .map(|folder| match folder.strip_suffix("/*") {
                Some(parent) => folders_in(&dataset.join(parent)),
                None => vec![dataset.join(folder)],
            })
            .collect(),
    };
    // Half a model is taken only where there is no whole one: opening it names the missing file.
    for wanted in [2, 1] {
        for group in &groups {
            let mut there: Vec<(&PathBuf, &'static Kind)> = Vec::new();
            for place in group {
                let count = |kind: &&Kind| {
                    [kind.cameras, kind.images].iter().filter(|file| place.join(file).is_file()).count()
                };
                there.extend(KINDS.iter().find(|kind| count(kind) == wanted).map(|kind| (place, kind)));
            }
            if let [(place, kind)] = there[..] {
                return Ok(Some(Model { place: place.clone(), kind, remarks: None }));
            }
            let mut counted = Vec::new();
            for (place, kind) in there {
                let images = place.join(kind.images);
                let count = if wanted == 2 { (kind.count_images)(&mut Source::open(&images)?)? } else { 0 };
                counted.push((count, place, kind));
            }
            // Of equal ones the first.
            let Some(&(most, place, kind)) = counted.iter().rev().max_by_key(|(count, ..)| *count) else {
                continue;
            };
            let name = |place: &Path| place.strip_prefix(dataset).unwrap_or(place).display().to_string();
            let others: Vec<String> = (counted.iter().filter(|(_, other, _)| *other != place))
                .map(|(count, other, _)| format!("{} ({count} photos)", name(other)))
                .collect();
            let text = format!(
                "of the models in {} {} is read, which has most photos ({most}); {} passed over, --model chooses another",
                dataset.display(),
                name(place),
                match &others[..] {
                    [other] => format!("{other} is"),
                    [first, .., last] if others.len() > 3 => format!("{first} to {last} are"),
                    _ => format!("{} are", others.join(", ")),
                }
            );
            return Ok(Some(Model {
                place: place.clone(),
                kind,
                remarks: Some(Remark::note("other-models", text)),
            }));
        }
    }
    let Some(folder) = options.model.as_ref().filter(|_| dataset.is_dir()) else { return Ok(None) };
    let mut what = "no COLMAP model is there, which has cameras and images, .bin or .txt".to_string();
    if let Some(other) = model_below(dataset) {
        what += &format!("; there is one in {}", dataset.join(other).display());
    }
    Err(FormatError::value(&dataset.join(folder), what))
}

/// The folders in a folder, numbers by their value and before other names; none if it does not
/// exist.
fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u64>().ok();
    folders.sort_by_cached_key(|path| (number(path).unwrap_or(u64::MAX), path.clone()));
    folders
}
