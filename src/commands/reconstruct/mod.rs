//! `reconstruct`: photos of a place into a scene.

mod data;
mod folder;
mod lpips;
mod priors;
mod training;
mod watch;

pub use folder::CHECKPOINT;

use crate::dataset::DatasetArgs;
use crate::names::stem_of;
use crate::scene::RunArgs;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use wm_scene::files::check_writable;
use wm_scene::{Rasterization, formats};
use wm_train::config::{BackgroundKind, Densify, Exposure, Resolution};
use wm_train::densify::{adaptive::AdaptiveConfig, mcmc::McmcConfig};
use wm_train::{Preset, TrainConfig};

/// Options of `reconstruct`.
#[derive(Args, Clone, Debug)]
pub struct ReconstructArgs {
    /// The data set: a folder with a COLMAP model or a transforms.json, or a plain folder of photos where
    /// COLMAP is installed
    dataset: PathBuf,
    /// Where the scene goes [default: named after the data set, in this folder]
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Folder for checkpoint, metrics and previews [default: the scene's name with .run behind it]
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    run_folder: Option<PathBuf>,
    /// Go on with the training in the run folder
    #[arg(long, help_heading = "Output")]
    resume: bool,
    /// Longest time between two checkpoints, seconds
    #[arg(long, value_name = "S", default_value_t = 45.0, help_heading = "Output")]
    checkpoint_every: f64,
    #[command(flatten)]
    photos: PhotoArgs,
    #[command(flatten)]
    training: TrainingArgs,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    facts: crate::scene::FactArgs,
    /// Height of the cameras above the ground, metres: the scale is from it where nothing else says it, and
    /// before GPS if it is given. It takes level photos that show the ground [default: 1.6]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Scene")]
    camera_height: Option<f64>,
    #[command(flatten)]
    watch: watch::WatchArgs,
    /// How it runs.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Which photos, and how large.
#[derive(Args, Clone, Debug)]
struct PhotoArgs {
    #[command(flatten)]
    set: DatasetArgs,
    /// Hold out every N-th photo (in the order of names) and measure on it; 0 holds out none
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Photos")]
    eval_every: u32,
    /// The first photo that is held out, from 0
    #[arg(long, value_name = "K", default_value_t = 0, help_heading = "Photos")]
    eval_from: u32,
    /// Also give the LPIPS of the held-out photos at the end, with weights from this file (safetensors, or .pth
    /// of PyTorch): torchvision's AlexNet and the heads of lpips v0.1; twice, if they lie in two files
    #[arg(long, value_name = "WEIGHTS", help_heading = "Photos")]
    lpips: Vec<PathBuf>,
}

/// How to train.
#[derive(Args, Clone, Debug)]
struct TrainingArgs {
    /// How much time it may take: quick (2,000 steps), standard (7,000) or best (30,000)
    #[arg(long, value_name = "PRESET", default_value = "standard", help_heading = "Training")]
    preset: PresetArg,
    /// Steps; each sees one photo [default: the preset's]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), help_heading = "Training")]
    steps: Option<u32>,
    /// Most splats [default: 100,000, 300,000 or 1,000,000 by preset, but one for 100 pixels of all photos]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(100..=20_000_000), help_heading = "Training")]
    max_splats: Option<u32>,
    /// How splats come and go: mcmc (a fixed budget), adaptive (as first published) or fixed
    #[arg(long, value_name = "STRATEGY", default_value = "mcmc", help_heading = "Training")]
    densify: DensifyArg,
    /// Highest degree of the spherical harmonics
    #[arg(long, value_name = "DEGREE", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=3), help_heading = "Training")]
    sh_degree: u8,
    /// Sizes of photos over time: coarse (a quarter, half, full) or full [default: the preset's]
    #[arg(long, value_name = "SIZES", help_heading = "Training")]
    resolution: Option<ResolutionArg>,
    /// Whether each photo has an exposure of its own, as cameras choose it by themselves: photo, or shared by all
    #[arg(long, value_name = "WHOSE", default_value = "photo", help_heading = "Training")]
    exposure: ExposureArg,
    /// What stands behind the splats while they learn: black or random
    #[arg(long, value_name = "COLOR", default_value = "random", help_heading = "Training")]
    background: BackgroundArg,
    /// How splats smaller than a pixel are drawn: classic or antialiased
    #[arg(long, value_name = "MODE", default_value = "classic", value_parser = super::render::parse_rasterization, help_heading = "Training")]
    rasterization: Rasterization,
    /// Take everything about the training from this JSON file, such as a run folder's config.json; the other
    /// options of this group are not looked at
    #[arg(long, value_name = "FILE", help_heading = "Training")]
    config: Option<PathBuf>,
    /// Which of the equally good runs
    #[arg(long, value_name = "SEED", default_value_t = 0, help_heading = "Training")]
    seed: u64,
}

macro_rules! choice {
    ($(#[$doc:meta])* $name:ident { $($variant:ident),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
        enum $name {
            $(
                #[doc = stringify!($variant)]
                $variant,
            )+
        }
    };
}

choice! {
    /// A preset's name.
    PresetArg { Quick, Standard, Best }
}
choice! {
    /// A strategy's name.
    DensifyArg { Mcmc, Adaptive, Fixed }
}
choice! {
    /// Sizes over time.
    ResolutionArg { Coarse, Full }
}
choice! {
    /// Whose exposure.
    ExposureArg { Shared, Photo }
}
choice! {
    /// The background's name.
    BackgroundArg { Black, Random }
}

impl TrainingArgs {
    /// The preset with what is changed of it, for photos of `pixels` in all.
    fn config(&self, pixels: u64) -> TrainConfig {
        let preset = match self.preset {
            PresetArg::Quick => Preset::Quick,
            PresetArg::Standard => Preset::Standard,
            PresetArg::Best => Preset::Best,
        };
        let mut config = TrainConfig::preset(preset);
        if let Some(steps) = self.steps {
            config.set_steps(steps);
        }
        let most = self.max_splats.map_or_else(|| preset.max_splats_for(pixels), |most| most as usize);
        config.densify = match self.densify {
            DensifyArg::Mcmc => Densify::Mcmc(McmcConfig::for_steps(config.steps, most)),
            DensifyArg::Adaptive => Densify::Adaptive(AdaptiveConfig::for_steps(config.steps, most)),
            DensifyArg::Fixed => Densify::Fixed,
        };
        config.sh_degree = self.sh_degree;
        config.resolution = match self.resolution {
            None => config.resolution,
            Some(ResolutionArg::Coarse) => Resolution::Coarse,
            Some(ResolutionArg::Full) => Resolution::Full,
        };
        config.exposure = match self.exposure {
            ExposureArg::Shared => Exposure::Shared,
            ExposureArg::Photo => Exposure::Photo,
        };
        config.background = match self.background {
            BackgroundArg::Black => BackgroundKind::Black,
            BackgroundArg::Random => BackgroundKind::Random,
        };
        config.rasterization = self.rasterization;
        config.seed = self.seed;
        config
    }
}

/// What is believed before training, and how much it weighs.
#[derive(Args, Clone, Debug)]
struct GeometryArgs {
    /// Depth, normals and sky that photos are believed to show: a folder that `priors` wrote, photos (found out from
    /// the photos themselves) or none [default: priors in the data set if it is there, else photos]
    #[arg(long, value_name = "FOLDER|photos|none", help_heading = "Geometry")]
    priors: Option<PathBuf>,
    /// Splats of the sky, on a half sphere about the place, where photos show it; 0 for none
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(0..=1_000_000), help_heading = "Geometry")]
    sky_splats: u32,
    /// Weight of a term of the loss, or another of its numbers, by its name in config.json, such as depth=0.1 or
    /// normal=0; may be given several times
    #[arg(long, value_name = "NAME=VALUE", value_parser = parse_loss, help_heading = "Geometry")]
    loss: Vec<(String, f64)>,
}

fn parse_loss(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("write NAME=VALUE, such as depth=0.1")?;
    let value: f64 = value.trim().parse().map_err(|_| format!("{value} is no number"))?;
    Ok((name.trim().to_owned(), value))
}

impl GeometryArgs {
    /// `config` with what is asked for.
    fn change(&self, mut config: TrainConfig) -> Result<TrainConfig> {
        config.sky_splats = self.sky_splats;
        for (name, value) in &self.loss {
            let mut loss = serde_json::to_value(config.loss)?;
            let table = if loss.get(name).is_some_and(serde_json::Value::is_number) {
                Some(&mut loss)
            } else {
                loss.get_mut("geometry").filter(|geometry| geometry.get(name).is_some())
            };
            let Some(table) = table else {
                let known = serde_json::to_value(config.loss.geometry)?;
                let known: Vec<&String> = known.as_object().into_iter().flat_map(|map| map.keys()).collect();
                bail!("--loss {name}: no term of that name; there are l1, ssim and {known:?}");
            };
            // Numbers of steps are whole.
            table[name] = if name == "every" { json_steps(*value)? } else { (*value).into() };
            config.loss = serde_json::from_value(loss)?;
        }
        config.check().map_err(|e| anyhow::anyhow!("--loss: {e}"))?;
        Ok(config)
    }
}

fn json_steps(value: f64) -> Result<serde_json::Value> {
    if value.fract() != 0.0 || !(1.0..=1e6).contains(&value) {
        bail!("--loss every={value}: must be a whole number of steps, 1 or more");
    }
    Ok((value as u32).into())
}

/// Runs the command.
pub fn run(args: &ReconstructArgs) -> Result<()> {
    if !(args.checkpoint_every.is_finite() && args.checkpoint_every > 0.0) {
        bail!("--checkpoint-every {}: must be a number of seconds above 0", args.checkpoint_every);
    }
    if let Some(height) = args.camera_height
        && !(height.is_finite() && height > 0.0)
    {
        bail!("--camera-height is {height}: it must be finite and above 0");
    }
    args.watch.check()?;
    let facts = args.facts.metadata()?;
    let lpips = lpips::Lpips::read(args)?;
    let given = args.training.config.as_deref().map(folder::read_config).transpose()?;
    let out = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.ply", stem_of(&args.dataset))));
    formats::format_for(&out)?;
    check_writable(&out)?;
    let run_folder = args.run_folder.clone().unwrap_or_else(|| with_behind(&out, ".run"));
    let folder = folder::RunFolder::open(&run_folder, args.resume)?;
    let data = data::Data::open(&args.dataset, &args.photos, &folder)?;
    if let Some(lpips) = &lpips {
        lpips.check(&data)?;
    }
    folder.make()?;
    let config = match given {
        Some(config) => config,
        None => args.geometry.change(args.training.config(data.pixels()))?,
    };
    if !args.resume {
        // What cannot be written is said before the photos are compared.
        folder.write_config(&config)?;
    }
    let priors = priors::open(args, &data, &folder)?;
    training::Run::new(config, &data, priors.as_ref(), &folder, args, lpips)?.go(&out, &facts)
}

fn with_behind(path: &Path, text: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(text);
    name.into()
}
