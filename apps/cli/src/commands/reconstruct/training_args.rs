//! Options of a training.

use crate::choices::{Choice, one_of};
use clap::Args;
use clap::builder::PossibleValuesParser;
use std::path::PathBuf;
use weather_magician::train::config::{
    BackgroundKind, Densify, ExposureMode, HazeMode, MoverMode, Resolution,
};
use weather_magician::train::session::PoorPhotoMode;
use weather_magician::train::{Preset, TrainPlan};
use wm_scene::Rasterization;

/// Options of the training.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Training")]
pub(super) struct TrainingArgs {
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
    pub(super) poor_photos: PoorPhotoMode,
    /// Haze in which the photos were taken: auto (looked for, measured and taken out), keep (a part
    /// of the scene), or its meteorological optical range in metres, which is taken out
    #[arg(long, value_name = "auto|keep|METRES", default_value = "auto", value_parser = parse_haze)]
    haze: HazeMode,
    /// Background behind the splats during training: black or random
    #[arg(long, value_name = "COLOR", default_value = "random", value_parser = one_of(BACKGROUNDS))]
    background: BackgroundKind,
    /// Rendering of splats smaller than a pixel: classic or antialiased
    #[arg(long, value_name = "MODE", default_value = "classic", value_parser = crate::commands::render::parse_rasterization)]
    rasterization: Rasterization,
    /// Read all training options from this JSON file, such as a run folder's config.json; the other
    /// options of this group are ignored
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
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
    pub(super) fn plan(&self) -> TrainPlan {
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
