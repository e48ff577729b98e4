//! `view`: shows a scene and its weather in a browser.

use super::render::camera::ViewpointArgs;
use crate::level_args::LevelArgs;
use crate::scene::{OwnSkyArgs, RunArgs, SceneArgs};
use crate::viewer::{self, server::ServerArgs};
use crate::weather::WeatherArgs;
use anyhow::{Context, Result};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;
use weather_magician::panorama_file::read_panorama;
use wm_base::FormatError;
use wm_viewer::catalog::{panorama_name, panoramas_of};

/// Options of `view`.
#[derive(Args, Debug)]
#[command(after_long_help = wm_weather::reference_page::help())]
pub(crate) struct ViewArgs {
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    #[command(flatten)]
    pub(crate) sky: OwnSkyArgs,
    #[command(flatten)]
    pub(crate) levels: LevelArgs,
    #[command(flatten)]
    weather: WeatherArgs,
    /// Panorama that the page offers as a sky, in addition to the weather's; may be given several
    /// times
    #[arg(long, value_name = "FILE", help_heading = "Weather")]
    panorama: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) viewpoint: ViewpointArgs,
    #[command(flatten)]
    pub(crate) server: ServerArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}

/// Runs the command.
pub(crate) fn run(args: &ViewArgs) -> Result<()> {
    args.viewpoint.check()?;
    args.server.guard()?;
    let mut weather = args.weather.read()?;
    // Saved files are in another folder than the weather that was read.
    let here = std::env::current_dir().context("cannot find the current folder")?;
    weather.resolve_images(&here);
    let panorama = |path: &PathBuf| -> Result<_> {
        Ok((panorama_name(&here.join(path)).map_err(anyhow::Error::msg)?, read_panorama(path)?))
    };
    let mut panoramas = args.panorama.iter().map(panorama).collect::<Result<BTreeMap<_, _>>>()?;
    panoramas.extend(panoramas_of(&weather).map_err(anyhow::Error::msg)?);
    std::fs::metadata(&args.scene.scene).map_err(|error| FormatError::reading(&args.scene.scene, error))?;
    viewer::run(args, weather, panoramas)
}
