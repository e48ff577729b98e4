//! Options of `render`.

use super::camera::CameraArgs;
use super::device::DeviceArgs;
use super::output_args::OutputArgs;
use crate::level_args::LevelArgs;
use crate::scene::{OwnSkyArgs, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Options of `render`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub(crate) struct RenderArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    pub(super) sky: OwnSkyArgs,
    #[command(flatten)]
    pub(super) levels: LevelArgs,
    /// Levels of detail that a sequence is drawn at: shot (those that suit all of its frames, so
    /// that nothing changes its level on the way) or frame (those of each frame, which are finer)
    #[arg(long, value_name = "HOW", default_value = "shot", help_heading = "Scene")]
    pub(super) lod: LodChoice,
    #[command(flatten)]
    pub(super) weather: WeatherArgs,
    #[command(flatten)]
    pub(super) camera: CameraArgs,
    #[command(flatten)]
    pub(super) device: DeviceArgs,
    /// Make the pictures and lidar sweeps of all sensors of a rig (TOML), a folder each in the
    /// folder --out
    #[arg(long, value_name = "FILE", help_heading = "Camera")]
    pub(super) rig: Option<PathBuf>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
    #[command(flatten)]
    pub(super) pairs: PairsArgs,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

/// The frames that share one cut of the levels of detail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum LodChoice {
    /// All of a sequence.
    Shot,
    /// None: each has its own.
    Frame,
}

/// Options of data sets.
#[derive(Args, Clone, Debug)]
pub(crate) struct PairsArgs {
    /// Cameras of --pairs: capture (the scene's photos, or those of --views)
    #[arg(long, value_name = "SET", help_heading = "Camera")]
    cameras: Option<CameraSet>,
    /// Write a data set into the folder --out: for every camera of --cameras, at --time, the
    /// picture with and without the weather, depth, transmittance and a mask of particles; three
    /// renders per camera
    #[arg(long, help_heading = "Output")]
    pairs: bool,
}

/// Sets of cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum CameraSet {
    /// The cameras of the photos.
    Capture,
}

impl PairsArgs {
    /// Returns true if a data set is requested.
    ///
    /// # Errors
    /// One of the options is given without the other.
    pub(crate) fn is_asked_for(&self) -> Result<bool> {
        match (self.pairs, self.cameras) {
            (true, None) => bail!("--pairs needs cameras: add --cameras capture for those of the photos"),
            (false, Some(_)) => bail!("--cameras is for data sets: add --pairs, or choose one with --camera"),
            (asked, _) => Ok(asked),
        }
    }
}
