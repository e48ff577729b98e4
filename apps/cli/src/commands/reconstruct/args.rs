//! Options of `reconstruct`.

use super::block_args::BlockArgs;
use super::log::LogArgs;
use super::training_args::TrainingArgs;
use super::watch::WatchArgs;
use crate::dataset::{DatasetArgs, DatasetReadOptions, HeldOutArgs};
use crate::overwrite::OverwriteArgs;
use crate::scene::{FactArgs, RunArgs};
use anyhow::{Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::Duration;
use weather_magician::Metadata;
use weather_magician::train::photos::PhotoSize;
use weather_magician::train::session::{CHECKPOINT, PriorSource, Resume};
use weather_magician::train::{SessionOptions, TrainConfig, TrainPlan};

/// Options of `reconstruct`.
#[derive(Args, Clone, Debug)]
pub(crate) struct ReconstructArgs {
    /// The data set: a folder with a COLMAP model or a transforms.json; a driving log of KITTI,
    /// nuScenes, Argoverse 2 or drivestudio; or a plain folder of photos, or a video, if COLMAP or
    /// pycolmap is installed
    pub(super) dataset: PathBuf,
    /// Scene file to write, or FOLDER/lod-meta.json for levels of detail [default: named after the
    /// data set, in this folder]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub(super) out: Option<PathBuf>,
    /// Folder for checkpoint, metrics and previews [default: the name of the scene, or of its
    /// folder, followed by .run]
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    pub(super) run_folder: Option<PathBuf>,
    /// Continue the training in the run folder
    #[arg(long, help_heading = "Output")]
    pub(super) resume: bool,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    /// Longest time between two checkpoints, seconds
    #[arg(long, value_name = "S", default_value_t = 45.0, help_heading = "Output")]
    pub(super) checkpoint_every: f64,
    #[command(flatten)]
    pub(super) log: LogArgs,
    #[command(flatten)]
    pub(super) photos: PhotoArgs,
    #[command(flatten)]
    pub(super) blocks: BlockArgs,
    #[command(flatten)]
    pub(super) training: TrainingArgs,
    #[command(flatten)]
    pub(super) geometry: GeometryArgs,
    #[command(flatten)]
    pub(super) facts: FactArgs,
    /// Height of the cameras above the ground, metres: sets the scale if nothing else does, and
    /// takes precedence over GPS if given. Needs level photos that show the ground [default: 1.6]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Scene")]
    camera_height: Option<f64>,
    /// Do not compute what rain and snow need to know of the scene (SCENE.assets); the first
    /// picture with weather then waits for it
    #[arg(long, help_heading = "Output")]
    pub(super) no_assets: bool,
    #[command(flatten)]
    pub(super) watch: WatchArgs,
    /// Device and threads.
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The photos that are used, and their size.
#[derive(Args, Clone, Debug)]
#[command(mut_arg("eval_every", |arg| {
    arg.help("Hold out every N-th photo (in the order of names) and measure on it; 0 holds out none")
}))]
pub(super) struct PhotoArgs {
    #[command(flatten)]
    pub(super) set: DatasetArgs,
    #[command(flatten)]
    pub(super) held_out: HeldOutArgs,
    /// Also compute the LPIPS of the held-out photos at the end, with weights from this file
    /// (safetensors, or .pth of PyTorch): torchvision's AlexNet and the heads of lpips v0.1; give
    /// it twice for two files
    #[arg(long, value_name = "WEIGHTS", help_heading = "Photos")]
    pub(super) lpips: Vec<PathBuf>,
}

/// The priors, and their weights.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Geometry")]
pub(super) struct GeometryArgs {
    /// Depth, normals and sky of the photos: a folder that `priors` wrote, photos (computed from
    /// the photos themselves) or none [default: priors in the data set if it exists, else photos]
    #[arg(long, value_name = "FOLDER|photos|none")]
    pub(super) priors: Option<PathBuf>,
    /// Number of splats of the sky, on a hemisphere around the scene; 0 for none
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    sky_splats: u32,
    /// Weight or other parameter of a loss term, by its name in config.json, such as depth=0.1 or
    /// normal=0; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = parse_loss)]
    loss: Vec<(String, f64)>,
}

fn parse_loss(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE, such as depth=0.1")?;
    let value: f64 = value.trim().parse().map_err(|_| format!("{value} is not a number"))?;
    Ok((name.trim().to_owned(), value))
}

impl GeometryArgs {
    fn priors(&self) -> PriorSource {
        match self.priors.as_deref() {
            None => PriorSource::Auto,
            Some(given) if given == Path::new("none") => PriorSource::None,
            Some(given) if given == Path::new("photos") => PriorSource::Photos,
            Some(folder) => PriorSource::Folder(folder.to_owned()),
        }
    }
}

impl ReconstructArgs {
    /// Returns the options of the session.
    pub(super) fn options(
        &self,
        facts: Metadata,
        config: Option<TrainConfig>,
        run_folder: &Path,
    ) -> SessionOptions {
        let plan = TrainPlan {
            sky_splats: self.geometry.sky_splats,
            loss: self.geometry.loss.clone(),
            ..self.training.plan()
        };
        let set = &self.photos.set;
        let longest = set.longest.unwrap_or(plan.preset.longest_side());
        SessionOptions {
            dataset: DatasetReadOptions { size: PhotoSize::Longest(longest), ..set.options() },
            held_out: self.photos.held_out.held_out(),
            poor_photos: self.training.poor_photos,
            plan,
            config,
            priors: self.geometry.priors(),
            facts,
            camera_height: self.camera_height,
            run_folder: Some(run_folder.to_owned()),
            resume: match (self.resume, self.overwrite.overwrite) {
                (true, _) => Resume::Always,
                (false, true) => Resume::Overwrite,
                (false, false) => Resume::Never,
            },
            checkpoint_every: Duration::try_from_secs_f64(self.checkpoint_every).unwrap_or(Duration::MAX),
            device: self.run.device.clone(),
            cpu: self.run.cpu(),
            part: None,
        }
    }

    /// Refuses to write into the folder of a training that is neither continued nor replaced; the
    /// session explains it better, but later.
    pub(super) fn check_run_folder(&self, run_folder: &Path) -> Result<()> {
        if !self.resume && !self.overwrite.overwrite && run_folder.join(CHECKPOINT).is_file() {
            bail!(
                "{}: it holds a training; continue it with --resume, replace it with --overwrite, or choose another --run-folder",
                run_folder.display()
            );
        }
        Ok(())
    }
}
