//! A capture from a plain folder of photos, by the COLMAP that is installed.
//!
//! Four of its commands run one after another: `feature_extractor`, a matcher, `mapper` and
//! `image_undistorter`. Everything they write, and all they say, lies in one folder:
//! ```text
//! colmap.log    the commands and what they said
//! database.db   features and matches; kept, so that a run that was stopped goes on from there
//! models/0...   what the mapper made; the one with the most photos is taken
//! dataset/      images/ and sparse/, undistorted: the capture
//! ```

mod progress;
#[cfg(all(test, unix))]
mod tests;

pub use progress::ColmapProgress;

use crate::photos::photos_in;
use rayon::prelude::*;
use std::{
    fs::{self, File, OpenOptions},
    io::{Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus, Stdio},
    time::Duration,
};
use thiserror::Error;
use wm_scene::FormatError;
use wm_scene::capture::header::read_header;

/// Options of COLMAP.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColmapOptions {
    /// The program; `None` looks for it, see [`find`].
    pub program: Option<PathBuf>,
    /// The pairs of photos that are compared.
    pub matching: Matching,
    /// The device that finds and compares features.
    pub device: ColmapDevice,
}

/// The pairs of photos that are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Matching {
    /// Each with each up to [`MOST_EXHAUSTIVE`] photos, else each with those that follow it.
    #[default]
    Auto,
    /// Each with each: the most reliable, and its time grows with the square of their number.
    Exhaustive,
    /// Each with those that follow it in the order of their names: for frames of a video.
    Sequential,
}

/// The device on which COLMAP finds and compares features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColmapDevice {
    /// On the CPU, which works without a display and with every build of COLMAP.
    #[default]
    Cpu,
    /// On the GPU.
    Gpu,
}

/// Most photos of which each is compared with each.
pub const MOST_EXHAUSTIVE: usize = 300;

/// The result of a run of COLMAP.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reconstruction {
    /// The data set: undistorted photos and their model.
    pub dataset: PathBuf,
    /// Photos that were given.
    pub photos: usize,
    /// Photos whose camera was found.
    pub registered: usize,
}

/// One of the four commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColmapStep {
    /// Finds features in each photo.
    Features,
    /// Finds them again in other photos.
    Matches,
    /// Finds cameras and points.
    Cameras,
    /// Makes photos without distortion.
    Undistortion,
}

impl ColmapStep {
    /// Returns the name of the step for people, such as "matching photos".
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Features => "finding features",
            Self::Matches => "matching photos",
            Self::Cameras => "finding cameras",
            Self::Undistortion => "undistorting photos",
        }
    }
}

/// A reason why COLMAP makes no capture.
#[derive(Debug, Error)]
pub enum ColmapError {
    /// There is no COLMAP.
    #[error(
        "COLMAP is not installed, and photos alone are no capture; install it ({INSTALL}), or set COLMAP to the \
         program, or give a data set that has a COLMAP model or a transforms.json"
    )]
    NotInstalled,
    /// The folder has too few photos.
    #[error("{}: {found}, at least 3 are needed", folder.display())]
    FewPhotos {
        /// The folder.
        folder: PathBuf,
        /// The number of photos that were found, in words.
        found: String,
    },
    /// The folder, or one in it, cannot be read.
    #[error(transparent)]
    Folder(#[from] FormatError),
    /// Something lies where the run would write.
    #[error("{}: it is there already and no run of COLMAP; choose another folder", .0.display())]
    Occupied(PathBuf),
    /// A file or folder cannot be used.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// The program does not start.
    #[error("{}: cannot be started: {reason}", program.display())]
    Start {
        /// The program.
        program: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// A command failed.
    #[error("COLMAP failed while {} ({status}{said}); all it said is in {}", step.name(), log.display())]
    Failed {
        /// The step that failed.
        step: ColmapStep,
        /// The exit status of the command.
        status: ExitStatus,
        /// Its last error, after `: `, if it named one.
        said: String,
        /// The log with the rest of its output.
        log: PathBuf,
    },
    /// No model came out.
    #[error(
        "COLMAP found no cameras: the photos share too little, or hold too little detail; take more, with more \
         overlap (its log is {})", .0.display()
    )]
    NothingRegistered(PathBuf),
    /// Whoever asked for it wants it no more.
    #[error("stopped while {}; started again it goes on with what is in {}", step.name(), folder.display())]
    Stopped {
        /// The step that was stopped.
        step: ColmapStep,
        /// The folder of the run.
        folder: PathBuf,
    },
}

const INSTALL: &str = if cfg!(target_os = "macos") {
    "brew install colmap"
} else if cfg!(windows) {
    "unpack the Windows zip from github.com/colmap/colmap/releases and add its folder to PATH"
} else {
    "sudo apt install colmap, or the package of your system"
};

/// The file that says what was run.
const LOG: &str = "colmap.log";

/// The time between two looks at a running command.
const PAUSE: Duration = Duration::from_millis(50);

/// The COLMAP to use: what the environment variable `COLMAP` says, else the first on `PATH`.
#[must_use]
pub fn find() -> Option<PathBuf> {
    if let Some(given) = std::env::var_os("COLMAP").filter(|v| !v.is_empty()) {
        return Some(given.into());
    }
    let names: &[&str] =
        if cfg!(windows) { &["colmap.exe", "COLMAP.bat", "colmap.bat"] } else { &["colmap"] };
    let path = std::env::var_os("PATH")?;
    let places = std::env::split_paths(&path);
    places.flat_map(|place| names.iter().map(move |name| place.join(name))).find(|file| file.is_file())
}

/// Makes a capture of the photos in a folder and those below it; everything goes to the folder `run`.
///
/// `progress` is called often. When `is_stopped` says so the command that runs is ended.
///
/// # Errors
/// [`ColmapError`] in one line.
pub fn reconstruct(
    photos: &Path,
    run: &Path,
    options: &ColmapOptions,
    progress: &mut dyn FnMut(ColmapProgress),
    is_stopped: &dyn Fn() -> bool,
) -> Result<Reconstruction, ColmapError> {
    // First, since nobody should install a program for an empty folder.
    let files = enough_photos_in(photos)?;
    let program = options.program.clone().or_else(find).ok_or(ColmapError::NotInstalled)?;
    let photos = absolute(photos)?;
    let folder = absolute(run)?;
    // Also whether the program starts at all, before anything is written.
    let (features, matches) = gpu_options(&program)?;
    let mut runner = Runner::new(program, folder, &photos, files.len(), progress, is_stopped)?;
    let use_gpu = match options.device {
        ColmapDevice::Cpu => "0",
        ColmapDevice::Gpu => "1",
    };
    let (database, models, dataset) =
        (runner.folder.join("database.db"), runner.folder.join("models"), runner.folder.join("dataset"));
    let image_path = photos.as_os_str();
    let mut extract = Command::new(&runner.program);
    extract
        .arg("feature_extractor")
        .arg("--database_path")
        .arg(&database)
        .arg("--image_path")
        .arg(image_path);
    // OPENCV holds the lenses of phones and cameras; one camera for all makes it certain, but is only
    // allowed for photos of one size.
    let is_one_camera = if have_one_size(&files) { "1" } else { "0" };
    extract.args(["--ImageReader.camera_model", "OPENCV", "--ImageReader.single_camera", is_one_camera]);
    extract.args([&features, use_gpu]);
    runner.run(ColmapStep::Features, extract)?;

    let is_exhaustive = match options.matching {
        Matching::Exhaustive => true,
        Matching::Sequential => false,
        Matching::Auto => files.len() <= MOST_EXHAUSTIVE,
    };
    let mut compare = Command::new(&runner.program);
    compare.arg(if is_exhaustive { "exhaustive_matcher" } else { "sequential_matcher" });
    compare.arg("--database_path").arg(&database).args([&matches, use_gpu]);
    runner.run(ColmapStep::Matches, compare)?;

    make_folder(&models)?;
    let mut map = Command::new(&runner.program);
    map.arg("mapper").arg("--database_path").arg(&database).arg("--image_path").arg(image_path);
    map.arg("--output_path").arg(&models);
    runner.run(ColmapStep::Cameras, map)?;
    let (model, registered) =
        largest_model(&models).ok_or_else(|| ColmapError::NothingRegistered(runner.folder.join(LOG)))?;

    make_folder(&dataset)?;
    let mut undistort = Command::new(&runner.program);
    undistort.arg("image_undistorter").arg("--image_path").arg(image_path).arg("--input_path").arg(&model);
    undistort.arg("--output_path").arg(&dataset).args(["--output_type", "COLMAP"]);
    runner.run(ColmapStep::Undistortion, undistort)?;
    Ok(Reconstruction { dataset, photos: files.len(), registered })
}

/// Returns the names of the options that say whether the GPU is used: they changed with
/// COLMAP 3.13, and a name that is not known ends a command.
fn gpu_options(program: &Path) -> Result<(String, String), ColmapError> {
    let output = Command::new(program).args(["feature_extractor", "-h"]).stdin(Stdio::null()).output();
    let output = output.map_err(|reason| ColmapError::Start { program: program.to_owned(), reason })?;
    let said = [output.stdout, output.stderr].concat();
    let is_new = String::from_utf8_lossy(&said).contains("--FeatureExtraction.use_gpu");
    let names =
        if is_new { ["FeatureExtraction", "FeatureMatching"] } else { ["SiftExtraction", "SiftMatching"] };
    let [features, matches] = names.map(|name| format!("--{name}.use_gpu"));
    Ok((features, matches))
}

/// A run in its folder.
struct Runner<'a> {
    program: PathBuf,
    folder: PathBuf,
    photos: usize,
    progress: &'a mut dyn FnMut(ColmapProgress),
    is_stopped: &'a dyn Fn() -> bool,
}

impl<'a> Runner<'a> {
    fn new(
        program: PathBuf,
        folder: PathBuf,
        photos: &Path,
        count: usize,
        progress: &'a mut dyn FnMut(ColmapProgress),
        is_stopped: &'a dyn Fn() -> bool,
    ) -> Result<Self, ColmapError> {
        let log = folder.join(LOG);
        let title = format!("photos: {} of {}\n", count, photos.display());
        if log.is_file() {
            // What an earlier run made: all of it is of our own making. Features and matches of the
            // same photos are kept.
            let old = fs::read(&log).map_err(|e| file_error(&log, e))?;
            for part in ["models", "dataset"] {
                remove(&folder.join(part))?;
            }
            if !old.starts_with(title.as_bytes()) {
                remove(&folder.join("database.db"))?;
            }
        } else if fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(ColmapError::Occupied(folder));
        }
        make_folder(&folder)?;
        fs::write(&log, title).map_err(|e| file_error(&log, e))?;
        Ok(Self { program, folder, photos: count, progress, is_stopped })
    }

    /// Runs a command to its end; all it says goes to the log, from where progress is read.
    fn run(&mut self, step: ColmapStep, mut command: Command) -> Result<(), ColmapError> {
        let log = self.folder.join(LOG);
        let fault = |e| file_error(&log, e);
        let mut out = OpenOptions::new().append(true).open(&log).map_err(fault)?;
        writeln!(out, "\n$ {}", line_of(&command)).map_err(fault)?;
        let mut reader = File::open(&log).map_err(fault)?;
        reader.seek(SeekFrom::End(0)).map_err(fault)?;
        let said_by_both = out.try_clone().map_err(fault)?;
        command.stdin(Stdio::null()).stdout(out).stderr(said_by_both);
        let child = command.spawn();
        let child = child.map_err(|reason| ColmapError::Start { program: self.program.clone(), reason })?;
        let mut child = Running(child);
        let mut lines = progress::Lines::default();
        (self.progress)(ColmapProgress { step, done: 0, total: None });
        let status = loop {
            let ended = child.0.try_wait().map_err(fault)?;
            let mut said = Vec::new();
            reader.read_to_end(&mut said).map_err(fault)?;
            for at in lines.take(&said).filter_map(|line| progress::of(step, &line, self.photos)) {
                (self.progress)(at);
            }
            if let Some(status) = ended {
                break status;
            }
            if (self.is_stopped)() {
                drop(child);
                return Err(ColmapError::Stopped { step, folder: self.folder.clone() });
            }
            std::thread::sleep(PAUSE);
        };
        if status.success() {
            return Ok(());
        }
        // An interrupt from the keyboard reaches the child as well, and it may end first.
        if (self.is_stopped)() {
            return Err(ColmapError::Stopped { step, folder: self.folder.clone() });
        }
        let said = lines.last_error().map(|line| format!(": {line}")).unwrap_or_default();
        Err(ColmapError::Failed { step, status, said, log })
    }
}

/// A command that does not outlive whoever started it.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself; there is nobody to tell.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The command as one would type it.
fn line_of(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args()).map(|word| {
        let word = word.to_string_lossy();
        if word.contains(' ') { format!("\"{word}\"") } else { word.into_owned() }
    });
    words.collect::<Vec<_>>().join(" ")
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

fn have_one_size(files: &[PathBuf]) -> bool {
    let sizes: Vec<Option<(u32, u32)>> = files
        .par_iter()
        .map(|file| read_header(file).ok().map(|header| (header.width, header.height)))
        .collect();
    let mut known = sizes.into_iter().flatten();
    let first = known.next();
    known.all(|size| Some(size) == first)
}

/// The model with the most photos among those that the mapper wrote.
fn largest_model(models: &Path) -> Option<(PathBuf, usize)> {
    let folders = fs::read_dir(models).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let counted = folders.filter_map(|folder| {
        let mut count = [0; 8];
        File::open(folder.join("images.bin")).ok()?.read_exact(&mut count).ok()?;
        let count = usize::try_from(u64::from_le_bytes(count)).ok()?;
        (count > 0).then_some((folder, count))
    });
    // Of equal ones that which the mapper made first.
    counted.max_by(|a, b| a.1.cmp(&b.1).then_with(|| b.0.cmp(&a.0)))
}

fn absolute(path: &Path) -> Result<PathBuf, ColmapError> {
    std::path::absolute(path).map_err(|e| file_error(path, e))
}

fn make_folder(path: &Path) -> Result<(), ColmapError> {
    fs::create_dir_all(path).map_err(|e| file_error(path, e))
}

fn remove(path: &Path) -> Result<(), ColmapError> {
    let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match removed {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(file_error(path, error)),
        _ => Ok(()),
    }
}

fn file_error(path: &Path, reason: std::io::Error) -> ColmapError {
    ColmapError::File { path: path.into(), reason }
}
