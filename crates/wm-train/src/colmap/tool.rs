//! The program that finds cameras, and its commands.

use super::error::ColmapError;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The program that finds cameras.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum CameraTool {
    /// COLMAP: its program.
    Colmap(PathBuf),
    /// pycolmap, on the CPU: the Python that has it.
    Pycolmap(PathBuf),
}

/// The script that runs a step with pycolmap.
pub(super) const SCRIPT: &str = include_str!("find_cameras.py");
/// The name of the script in the folder of a run.
pub(super) const SCRIPT_NAME: &str = "find_cameras.py";

impl CameraTool {
    /// Returns the program that the environment variable `COLMAP` names, else the first COLMAP on
    /// `PATH`, else the first Python on `PATH` that can import pycolmap.
    pub(crate) fn find() -> Option<Self> {
        if let Some(given) = std::env::var_os("COLMAP").filter(|given| !given.is_empty()) {
            return Some(Self::Colmap(given.into()));
        }
        let (programs, pythons): (&[&str], &[&str]) = if cfg!(windows) {
            (&["colmap.exe", "COLMAP.bat", "colmap.bat"], &["python3.exe", "python.exe"])
        } else {
            (&["colmap"], &["python3", "python"])
        };
        let colmap = programs.iter().find_map(|name| on_path(name)).map(Self::Colmap);
        let python = || pythons.iter().filter_map(|name| on_path(name)).find(|python| has_pycolmap(python));
        colmap.or_else(|| python().map(Self::Pycolmap))
    }

    /// Returns the program that is started.
    pub(super) fn program(&self) -> &Path {
        match self {
            Self::Colmap(program) | Self::Pycolmap(program) => program,
        }
    }
}

/// Returns the first file of a name in the folders of `PATH`.
pub(crate) fn on_path(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}

fn has_pycolmap(python: &Path) -> bool {
    let mut import = Command::new(python);
    import.args(["-c", "import pycolmap"]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    import.status().is_ok_and(|status| status.success())
}

/// The files and folders of a run.
pub(super) struct RunPaths {
    /// The photos.
    pub(crate) photos: PathBuf,
    /// Features and matches.
    pub(crate) database: PathBuf,
    /// The folder of the models that the mapper makes.
    pub(crate) models: PathBuf,
    /// The undistorted capture.
    pub(crate) dataset: PathBuf,
    /// The script for pycolmap.
    pub(crate) script: PathBuf,
}

/// Makes the commands of the four steps.
pub(super) struct StepCommands {
    tool: CameraTool,
    paths: RunPaths,
    /// COLMAP's options that say whether the GPU is used, of features and of matches.
    gpu_options: [String; 2],
}

impl StepCommands {
    /// Checks that the program starts.
    pub(crate) fn new(tool: CameraTool, paths: RunPaths) -> Result<Self, ColmapError> {
        let gpu_options = gpu_options(&tool)?;
        Ok(Self { tool, paths, gpu_options })
    }

    /// Finds features.
    pub(crate) fn extract(&self, has_one_camera: bool) -> Command {
        let RunPaths { photos, database, .. } = &self.paths;
        let mut command = self.command("feature_extractor");
        command.arg("--database_path").arg(database).arg("--image_path").arg(photos);
        // OPENCV holds the lenses of phones and cameras; one camera for all makes it certain, but
        // is only allowed for photos of one size.
        let single = if has_one_camera { "1" } else { "0" };
        command.args(["--ImageReader.camera_model", "OPENCV", "--ImageReader.single_camera", single]);
        // The CPU works without a display and with every build of COLMAP.
        command.args([&self.gpu_options[0], "0"]);
        command
    }

    /// Matches the features of pairs of photos.
    pub(crate) fn compare(&self, is_exhaustive: bool) -> Command {
        let name = if is_exhaustive { "exhaustive_matcher" } else { "sequential_matcher" };
        let mut command = self.command(name);
        command.arg("--database_path").arg(&self.paths.database).args([&self.gpu_options[1], "0"]);
        command
    }

    /// Finds cameras.
    pub(crate) fn map(&self) -> Command {
        let RunPaths { photos, database, models, .. } = &self.paths;
        let mut command = self.command("mapper");
        command.arg("--database_path").arg(database).arg("--image_path").arg(photos);
        command.arg("--output_path").arg(models);
        command
    }

    /// Makes photos without distortion.
    pub(crate) fn undistort(&self, model: &Path) -> Command {
        let RunPaths { photos, dataset, .. } = &self.paths;
        let mut command = self.command("image_undistorter");
        command.arg("--image_path").arg(photos).arg("--input_path").arg(model);
        command.arg("--output_path").arg(dataset).args(["--output_type", "COLMAP"]);
        command
    }

    /// Begins a command of COLMAP, which the script for pycolmap knows too.
    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(self.tool.program());
        if let CameraTool::Pycolmap(_) = self.tool {
            command.arg(&self.paths.script);
        }
        command.arg(name);
        command
    }
}

/// Returns COLMAP's options that say whether the GPU is used: they changed with COLMAP 3.13, and a
/// name that is not known ends a command. The script for pycolmap takes either.
fn gpu_options(tool: &CameraTool) -> Result<[String; 2], ColmapError> {
    let is_new = match tool {
        CameraTool::Colmap(program) => {
            let output =
                Command::new(program).args(["feature_extractor", "-h"]).stdin(Stdio::null()).output();
            let output =
                output.map_err(|reason| ColmapError::Start { program: program.to_owned(), reason })?;
            let said = [output.stdout, output.stderr].concat();
            String::from_utf8_lossy(&said).contains("--FeatureExtraction.use_gpu")
        }
        CameraTool::Pycolmap(_) => true,
    };
    let names =
        if is_new { ["FeatureExtraction", "FeatureMatching"] } else { ["SiftExtraction", "SiftMatching"] };
    Ok(names.map(|name| format!("--{name}.use_gpu")))
}
