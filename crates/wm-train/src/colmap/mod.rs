//! A capture from a plain folder of photos, by the COLMAP or the pycolmap that is installed.
//!
//! Four steps run one after another: features, matches, cameras, and photos without distortion.
//! Each is a command of COLMAP (`feature_extractor`, a matcher, `mapper`, `image_undistorter`), or
//! a run of Python with a script for pycolmap. Everything they write, and all they say, lies in one
//! folder:
//! ```text
//! colmap.log       the commands and what they said
//! find_cameras.py  the script for pycolmap
//! database.db      features and matches; kept, so that a run that was stopped goes on from there
//! models/0...      what the mapper made; the one with the most photos is taken
//! dataset/         images/ and sparse/, undistorted: the capture
//! done             written last; a run for the same photos takes the capture as it is
//! ```

mod database;
mod error;
mod progress;
mod runner;
#[cfg(all(test, unix))]
mod tests;
mod tool;

pub use error::ColmapError;
use error::{file_error, make_folder};
pub use progress::{ColmapProgress, ColmapStep};
pub(crate) use runner::Running;
use tool::CameraTool;
pub(crate) use tool::on_path;

use crate::checkpoint::{FNV_START, hash};
use crate::photos::photos_in;
use database::SharedPoints;
use rayon::prelude::*;
use runner::{DONE_FILE, LOG_FILE, Runner};
use std::{
    collections::BTreeSet,
    fmt,
    fs::{self, File},
    io::Read,
    path::{Path, PathBuf},
    time::UNIX_EPOCH,
};
use tool::{RunPaths, SCRIPT, SCRIPT_NAME, StepCommands};
use wm_base::files::write_atomically;
use wm_capture::{self as capture, CaptureOptions};
use wm_image::header::read_header;

/// Options of COLMAP.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ColmapOptions {
    /// The program; `None` looks for it, see `CameraTool::find`.
    pub(crate) tool: Option<CameraTool>,
    /// The pairs of photos that are compared.
    pub(crate) matching: Matching,
}

/// The pairs of photos that are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Matching {
    /// Each with each up to 300 photos, else each with those that follow it.
    #[default]
    Auto,
    /// Each with each: the most reliable, and its time grows with the square of their number.
    Exhaustive,
    /// Each with those that follow it in the order of their names: for frames of a video.
    Sequential,
}

/// Most photos of which each is compared with each.
pub(crate) const MAX_EXHAUSTIVE_PHOTOS: usize = 300;

/// The result of a run of COLMAP.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Reconstruction {
    /// The data set: undistorted photos and their model.
    pub(crate) dataset: PathBuf,
    /// Photos that were given.
    pub(crate) photos: usize,
    /// Photos whose camera was found.
    pub(crate) registered: usize,
    /// The other photos.
    pub(crate) unregistered: Vec<UnregisteredPhoto>,
}

/// A photo whose camera was not found. Displays what it shares with others.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnregisteredPhoto {
    /// The name of the photo.
    pub photo: String,
    /// The photos that share the most points with it, and the number of points; the best first.
    pub neighbours: Vec<(String, u32)>,
}

impl fmt::Display for UnregisteredPhoto {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { photo, neighbours } = self;
        let shares: Vec<String> = neighbours
            .iter()
            .take(NAMED_NEIGHBOURS)
            .map(|(name, points)| format!("{points} points with {name}"))
            .collect();
        match shares.is_empty() {
            true => write!(f, "{photo} shares no points with another"),
            false => write!(f, "{photo} shares {}", shares.join(" and ")),
        }
    }
}

/// Neighbours of a photo that are named in messages.
const NAMED_NEIGHBOURS: usize = 2;

/// Shortest side of a photo in which features are looked for, px.
const MIN_SIDE_PX: u32 = 16;

/// Makes a capture of the photos in a folder and those below it; everything goes to the folder
/// `run`.
///
/// `progress` is called often. When `is_stopped` says so the command that runs is ended.
///
/// # Errors
/// [`ColmapError`] in one line.
pub(crate) fn reconstruct(
    photos: &Path,
    run: &Path,
    options: &ColmapOptions,
    progress: &mut dyn FnMut(ColmapProgress),
    is_stopped: &dyn Fn() -> bool,
) -> Result<Reconstruction, ColmapError> {
    // First, since nobody should install a program for an empty folder.
    let files = enough_photos_in(photos)?;
    let sizes = sizes_of(&files)?;
    let photos = absolute(photos)?;
    let folder = absolute(run)?;
    let title = title(&photos, &files);
    let paths = RunPaths {
        photos,
        database: folder.join("database.db"),
        models: folder.join("models"),
        dataset: folder.join("dataset"),
        script: folder.join(SCRIPT_NAME),
    };
    let (database, models, dataset) = (paths.database.clone(), paths.models.clone(), paths.dataset.clone());
    if fs::read_to_string(folder.join(DONE_FILE)).is_ok_and(|done| done == title)
        && let Ok(made) = result(files.len(), &dataset, &database)
    {
        return Ok(made);
    }
    let tool = options.tool.clone().or_else(CameraTool::find).ok_or(ColmapError::NotInstalled)?;
    let program = tool.program().to_owned();
    let is_script = matches!(tool, CameraTool::Pycolmap(_));
    let script = paths.script.clone();
    // Also whether the program starts at all, before anything is written.
    let commands = StepCommands::new(tool, paths)?;
    let mut runner = Runner::new(program, folder, &title, files.len(), progress, is_stopped)?;
    if is_script {
        fs::write(&script, SCRIPT).map_err(|e| file_error(&script, e))?;
    }
    runner.run(ColmapStep::Features, commands.extract(have_one_size(&sizes)))?;
    let is_exhaustive = match options.matching {
        Matching::Exhaustive => true,
        Matching::Sequential => false,
        Matching::Auto => files.len() <= MAX_EXHAUSTIVE_PHOTOS,
    };
    runner.run(ColmapStep::Matches, commands.compare(is_exhaustive))?;
    make_folder(&models)?;
    match runner.run(ColmapStep::Cameras, commands.map()) {
        // COLMAP fails where it finds no camera, pycolmap does not.
        Err(ColmapError::Failed { said, .. }) if said.contains("failed to create sparse model") => {}
        done => done?,
    }
    let log = runner.folder.join(LOG_FILE);
    let model = largest_model(&models).ok_or_else(|| nothing_registered(&database, log))?;
    make_folder(&dataset)?;
    runner.run(ColmapStep::Undistortion, commands.undistort(&model))?;
    let made = result(files.len(), &dataset, &database)?;
    write_atomically(&runner.folder.join(DONE_FILE), |out| Ok(out.write_all(title.as_bytes())?))?;
    Ok(made)
}

/// Returns the line that tells these photos from others: their folder, names, sizes and times of
/// change.
fn title(photos: &Path, files: &[PathBuf]) -> String {
    let mut sum = FNV_START;
    for file in files {
        let about = fs::metadata(file).ok();
        let bytes = about.as_ref().map_or(0, fs::Metadata::len);
        let changed = about.and_then(|about| about.modified().ok()?.duration_since(UNIX_EPOCH).ok());
        let nanos = changed.map_or(0, |changed| changed.as_nanos() as u64);
        let name = file.as_os_str().as_encoded_bytes();
        for part in [name, &bytes.to_le_bytes(), &nanos.to_le_bytes()] {
            sum = hash(sum, part);
        }
    }
    format!("photos: {} of {} ({sum:016x})\n", files.len(), photos.display())
}

/// Reads what a run made.
fn result(photos: usize, dataset: &Path, database: &Path) -> Result<Reconstruction, ColmapError> {
    let capture = capture::read(dataset, &CaptureOptions::default())?;
    let found: BTreeSet<&str> = capture.views.iter().map(|view| view.name.as_str()).collect();
    let shared = SharedPoints::read(database).unwrap_or_default();
    let missing = shared.names.values().filter(|name| !found.contains(name.as_str()));
    let mut unregistered: Vec<UnregisteredPhoto> =
        missing.map(|name| UnregisteredPhoto { photo: name.clone(), neighbours: shared.of(name) }).collect();
    unregistered.sort_by(|a, b| a.photo.cmp(&b.photo));
    Ok(Reconstruction { dataset: dataset.to_owned(), photos, registered: capture.views.len(), unregistered })
}

/// Returns the error of photos of which no camera is found, with what they share.
fn nothing_registered(database: &Path, log: PathBuf) -> ColmapError {
    let shared = SharedPoints::read(database);
    let shared = shared
        .as_ref()
        .and_then(SharedPoints::best)
        .map_or_else(String::new, |(a, b, points)| format!("{a} and {b} share the most, {points} points; "));
    ColmapError::NothingRegistered { shared, log }
}

/// Photos in a folder and those below it, as COLMAP will find them: three or more.
fn enough_photos_in(folder: &Path) -> Result<Vec<PathBuf>, ColmapError> {
    let (found, others) = photos_in(folder)?;
    if found.len() >= 3 {
        return Ok(found);
    }
    let others = if others > 0 { format!(" and {others} other files") } else { String::new() };
    let plural = if found.len() == 1 { "" } else { "s" };
    let found = format!("{} photo{plural} (JPEG or PNG){others}", found.len());
    Err(ColmapError::FewPhotos { folder: folder.into(), found })
}

/// Returns the sizes of photos, px; `None` for one whose header cannot be read, which COLMAP leaves
/// out.
fn sizes_of(files: &[PathBuf]) -> Result<Vec<Option<(u32, u32)>>, ColmapError> {
    let size = |file: &PathBuf| read_header(file).ok().map(|header| (header.width, header.height));
    let sizes: Vec<Option<(u32, u32)>> = files.par_iter().map(size).collect();
    for (photo, size) in files.iter().zip(&sizes) {
        if let Some((width, height)) = *size
            && width.min(height) < MIN_SIDE_PX
        {
            return Err(ColmapError::SmallPhoto { photo: photo.clone(), width, height });
        }
    }
    Ok(sizes)
}

fn have_one_size(sizes: &[Option<(u32, u32)>]) -> bool {
    let mut known = sizes.iter().flatten();
    let first = known.next();
    known.all(|size| Some(size) == first)
}

/// The model with the most photos among those that the mapper wrote.
fn largest_model(models: &Path) -> Option<PathBuf> {
    let folders = fs::read_dir(models).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let counted = folders.filter_map(|folder| {
        let mut count = [0; 8];
        File::open(folder.join("images.bin")).ok()?.read_exact(&mut count).ok()?;
        let count = usize::try_from(u64::from_le_bytes(count)).ok()?;
        (count > 0).then_some((folder, count))
    });
    // Of equal ones that which the mapper made first.
    counted.max_by(|a, b| a.1.cmp(&b.1).then_with(|| b.0.cmp(&a.0))).map(|(model, _)| model)
}

fn absolute(path: &Path) -> Result<PathBuf, ColmapError> {
    std::path::absolute(path).map_err(|e| file_error(path, e))
}
