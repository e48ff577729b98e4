//! `reconstruct`: makes a scene from photos.

mod blocks;
mod console;
mod explain;
mod log;
mod lpips;
mod prepare;
pub(crate) mod watch;

pub(crate) use weather_magician::train::session::CHECKPOINT;

use crate::choices::{Choice, one_of};
use crate::commands::convert::levels::{self, is_levels};
use crate::dataset::{DatasetArgs, DatasetReadOptions, HeldOutArgs};
use crate::names::{stem_of, with_behind};
use crate::overwrite::OverwriteArgs;
use crate::scene::RunArgs;
use anyhow::{Context, Result, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;
use console::TrainingConsole;
use explain::explain;
use std::path::{Path, PathBuf};
use std::time::Duration;
use weather_magician::Metadata;
use weather_magician::train::blocks::PLAN;
use weather_magician::train::config::{
    BackgroundKind, Densify, ExposureMode, HazeMode, MoverMode, Resolution,
};
use weather_magician::train::photos::PhotoSize;
use weather_magician::train::session::{PoorPhotoMode, PriorSource, Resume};
use weather_magician::train::{Preset, Session, SessionOptions, TrainConfig, TrainPlan};
use wm_base::files::check_writable;
use wm_scene::Rasterization;
use wm_scene::formats;

/// Options of `reconstruct`.
#[derive(Args, Clone, Debug)]
pub(crate) struct ReconstructArgs {
    /// The data set: a folder with a COLMAP model or a transforms.json; a driving log of KITTI,
    /// nuScenes, Argoverse 2 or drivestudio; or a plain folder of photos, or a video, if COLMAP or
    /// pycolmap is installed
    dataset: PathBuf,
    /// Scene file to write, or FOLDER/lod-meta.json for levels of detail [default: named after the
    /// data set, in this folder]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Folder for checkpoint, metrics and previews [default: the name of the scene, or of its
    /// folder, followed by .run]
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    run_folder: Option<PathBuf>,
    /// Continue the training in the run folder
    #[arg(long, help_heading = "Output")]
    resume: bool,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Longest time between two checkpoints, seconds
    #[arg(long, value_name = "S", default_value_t = 45.0, help_heading = "Output")]
    checkpoint_every: f64,
    #[command(flatten)]
    log: log::LogArgs,
    #[command(flatten)]
    photos: PhotoArgs,
    #[command(flatten)]
    blocks: blocks::BlockArgs,
    #[command(flatten)]
    training: TrainingArgs,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    facts: crate::scene::FactArgs,
    /// Height of the cameras above the ground, metres: sets the scale if nothing else does, and
    /// takes precedence over GPS if given. Needs level photos that show the ground [default: 1.6]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Scene")]
    camera_height: Option<f64>,
    /// Do not compute what rain and snow need to know of the scene (SCENE.assets); the first
    /// picture with weather then waits for it
    #[arg(long, help_heading = "Output")]
    no_assets: bool,
    #[command(flatten)]
    watch: watch::WatchArgs,
    /// Device and threads.
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// The photos that are used, and their size.
#[derive(Args, Clone, Debug)]
#[command(mut_arg("eval_every", |arg| {
    arg.help("Hold out every N-th photo (in the order of names) and measure on it; 0 holds out none")
}))]
struct PhotoArgs {
    #[command(flatten)]
    set: DatasetArgs,
    #[command(flatten)]
    held_out: HeldOutArgs,
    /// Also compute the LPIPS of the held-out photos at the end, with weights from this file
    /// (safetensors, or .pth of PyTorch): torchvision's AlexNet and the heads of lpips v0.1; give
    /// it twice for two files
    #[arg(long, value_name = "WEIGHTS", help_heading = "Photos")]
    lpips: Vec<PathBuf>,
}

/// Options of the training.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Training")]
struct TrainingArgs {
    /// Speed or quality: draft (600 steps, a first look), quick (2,000), standard (7,000) or best
    /// (30,000); fewer for few photos
    #[arg(long, value_name = "PRESET", default_value = "standard", value_parser = one_of(PRESETS))]
    preset: Preset,
    /// Number of steps, each with one photo [default: the preset's, at most 100 a photo, but 2000
    /// in any case]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    steps: Option<u32>,
    /// Maximum number of splats [default: 50,000, 100,000, 300,000 or 1,000,000 by preset, at most
    /// one per 15 pixels that confirm what two others show]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=20_000_000))]
    max_splats: Option<u32>,
    /// Densification strategy: mcmc (a fixed budget), adaptive (as first published) or fixed (no
    /// splats are added)
    #[arg(long, value_name = "STRATEGY", default_value = "mcmc", value_parser = PossibleValuesParser::new(Densify::NAMES))]
    densify: String,
    /// Highest degree of the spherical harmonics
    #[arg(long, value_name = "DEGREE", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: u8,
    /// Sizes of photos over time: coarse (a quarter, half, full) or full [default: the preset's]
    #[arg(long, value_name = "SIZES", value_parser = one_of(RESOLUTIONS))]
    resolution: Option<Resolution>,
    /// Exposure correction, for cameras that set it automatically: photo (one for each photo),
    /// shared (one for all), or auto (photo if the points of the model are brighter in some photos
    /// than in others, else shared)
    #[arg(long, value_name = "WHOSE", default_value = "auto", value_parser = one_of(EXPOSURES))]
    exposure: ExposureMode,
    /// Pixels that show people, cars and what else is in one photo and not in others: auto (found
    /// and left out) or keep
    #[arg(long, value_name = "CHOICE", default_value = "auto", value_parser = one_of(MOVERS))]
    movers: MoverMode,
    /// Photos that are blurred, or white or black over much of the picture: auto (found and left
    /// out) or keep
    #[arg(long, value_name = "CHOICE", default_value = "auto", value_parser = one_of(POOR_PHOTOS))]
    poor_photos: PoorPhotoMode,
    /// Haze in which the photos were taken: auto (looked for, measured and taken out), keep (a part
    /// of the scene), or its meteorological optical range in metres, which is taken out
    #[arg(long, value_name = "auto|keep|METRES", default_value = "auto", value_parser = parse_haze)]
    haze: HazeMode,
    /// Background behind the splats during training: black or random
    #[arg(long, value_name = "COLOR", default_value = "random", value_parser = one_of(BACKGROUNDS))]
    background: BackgroundKind,
    /// Rendering of splats smaller than a pixel: classic or antialiased
    #[arg(long, value_name = "MODE", default_value = "classic", value_parser = super::render::parse_rasterization)]
    rasterization: Rasterization,
    /// Read all training options from this JSON file, such as a run folder's config.json; the other
    /// options of this group are ignored
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Seed of all random choices
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    seed: u64,
}

/// Presets.
const PRESETS: &[Choice<Preset>] = &[
    ("draft", "", Preset::Draft),
    ("quick", "", Preset::Quick),
    ("standard", "", Preset::Standard),
    ("best", "", Preset::Best),
];
/// Sizes of photos over time.
const RESOLUTIONS: &[Choice<Resolution>] =
    &[("coarse", "", Resolution::Coarse), ("full", "", Resolution::Full)];
/// Exposures of photos.
const EXPOSURES: &[Choice<ExposureMode>] = &[
    ("shared", "", ExposureMode::Shared),
    ("photo", "", ExposureMode::Photo),
    ("auto", "", ExposureMode::Auto),
];
/// Treatments of movers.
const MOVERS: &[Choice<MoverMode>] = &[("auto", "", MoverMode::Auto), ("keep", "", MoverMode::Keep)];
/// Treatments of poor photos.
const POOR_PHOTOS: &[Choice<PoorPhotoMode>] =
    &[("auto", "", PoorPhotoMode::Auto), ("keep", "", PoorPhotoMode::Keep)];
/// Backgrounds behind the splats.
const BACKGROUNDS: &[Choice<BackgroundKind>] =
    &[("black", "", BackgroundKind::Black), ("random", "", BackgroundKind::Random)];

impl TrainingArgs {
    /// Returns the preset with its changes, except those of the loss and the sky.
    fn plan(&self) -> TrainPlan {
        TrainPlan {
            preset: self.preset,
            steps: self.steps,
            max_splats: self.max_splats.map(|most| most as usize),
            densify: self.densify.clone(),
            sh_degree: self.sh_degree,
            resolution: self.resolution,
            exposure: self.exposure,
            movers: self.movers,
            haze: self.haze,
            background: self.background,
            rasterization: self.rasterization,
            seed: self.seed,
            ..TrainPlan::default()
        }
    }
}

/// The priors, and their weights.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Geometry")]
struct GeometryArgs {
    /// Depth, normals and sky of the photos: a folder that `priors` wrote, photos (computed from
    /// the photos themselves) or none [default: priors in the data set if it exists, else photos]
    #[arg(long, value_name = "FOLDER|photos|none")]
    priors: Option<PathBuf>,
    /// Number of splats of the sky, on a hemisphere around the scene; 0 for none
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    sky_splats: u32,
    /// Weight or other parameter of a loss term, by its name in config.json, such as depth=0.1 or
    /// normal=0; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = parse_loss)]
    loss: Vec<(String, f64)>,
}

fn parse_haze(text: &str) -> Result<HazeMode, String> {
    match text {
        "auto" => Ok(HazeMode::Auto),
        "keep" => Ok(HazeMode::Keep),
        metres => match metres.parse() {
            Ok(mor) if (1.0..=1e6).contains(&mor) => Ok(HazeMode::Mor(mor)),
            _ => Err("write auto, keep, or a meteorological optical range of 1 to 1000000 m".into()),
        },
    }
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
    fn options(&self, facts: Metadata, config: Option<TrainConfig>, run_folder: &Path) -> SessionOptions {
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
}

impl ReconstructArgs {
    /// Refuses to write into the folder of a training that is neither continued nor replaced; the
    /// session explains it better, but later.
    fn check_run_folder(&self, run_folder: &Path) -> Result<()> {
        if !self.resume && !self.overwrite.overwrite && run_folder.join(CHECKPOINT).is_file() {
            bail!(
                "{}: it holds a training; continue it with --resume, replace it with --overwrite, or choose another --run-folder",
                run_folder.display()
            );
        }
        Ok(())
    }
}

/// Runs the command.
pub(crate) fn run(args: &ReconstructArgs) -> Result<()> {
    if !(args.checkpoint_every.is_finite() && args.checkpoint_every > 0.0) {
        bail!("--checkpoint-every {}: must be a number of seconds above 0", args.checkpoint_every);
    }
    args.watch.check()?;
    let facts = args.facts.metadata()?;
    let lpips = lpips::read(args)?;
    let config = args.training.config.as_deref().map(TrainConfig::read).transpose()?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.ply", stem_of(&args.dataset))));
    let beside = if is_levels(&out) {
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
        folder.with_context(|| format!("{}: give it a folder of its own", out.display()))?.to_path_buf()
    } else {
        formats::format_for(&out)?;
        out.clone()
    };
    check_writable(&beside)?;
    // The scene of the training that is continued may be written again.
    if args.blocks.writes_scene() && (!args.resume || args.run_folder.is_some()) {
        let other = "continue its training with --resume, give another name with --out";
        let other = if args.resume { "give another name with --out" } else { other };
        args.overwrite.check(&out, &[&args.dataset], other)?;
    }
    let run_folder = args.run_folder.clone().unwrap_or_else(|| with_behind(&beside, ".run"));
    let (dataset, facts) = match args.log.open(&args.dataset, args.photos.set.skip_bad)? {
        None => (args.dataset.clone(), facts),
        Some(log) => {
            args.check_run_folder(&run_folder)?;
            let keeps = args.resume || (args.blocks.is_given() && !args.overwrite.overwrite);
            let with_priors = args.geometry.priors.is_none();
            let (photos, held_out) = (&args.photos.set, args.photos.held_out.held_out());
            let made = log::prepare(&log, &run_folder, keeps, with_priors, photos, held_out)?;
            (made.folder, facts.or(made.facts))
        }
    };
    let options = args.options(facts, config, &run_folder);
    let mut console = TrainingConsole::new(args, &run_folder);
    let scene = if args.blocks.is_given() {
        let Some(scene) = blocks::train(args, &dataset, &options, &run_folder)? else { return Ok(()) };
        scene
    } else {
        if run_folder.join(PLAN).is_file() {
            bail!(
                "{}: it holds a training in blocks; continue it with --blocks, or choose another --run-folder",
                run_folder.display()
            );
        }
        let mut session = Session::new(&dataset).options(options);
        if let Some(lpips) = lpips {
            session = session.metric(lpips);
        }
        let done = session.run(&mut console);
        console.clear();
        done.map_err(explain)?
    };
    if is_levels(&out) {
        println!("{}", levels::write(&out, scene, Vec::new(), None, &args.run)?);
    } else {
        scene.save(&out)?;
        println!("{}: {} splats", out.display(), scene.splats.len());
    }
    console.end(&out);
    if !args.no_assets
        && let Err(error) = prepare::prepare(&out, &args.run)
    {
        eprintln!("warning: {}: weather is not prepared: {error:#}", out.display());
    }
    Ok(())
}
