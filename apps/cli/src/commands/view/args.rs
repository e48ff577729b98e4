//! Options of `view`.

use crate::commands::render::camera::ViewpointArgs;
use crate::level_args::LevelArgs;
use crate::scene::{OwnSkyArgs, RunArgs, SceneArgs};
use crate::viewer::server::ServerArgs;
use crate::weather::WeatherArgs;
use clap::Args;
use std::path::PathBuf;

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
    pub(super) weather: WeatherArgs,
    /// Panorama that the page offers as a sky, in addition to the weather's; may be given several
    /// times
    #[arg(long, value_name = "FILE", help_heading = "Weather")]
    pub(super) panorama: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) viewpoint: ViewpointArgs,
    #[command(flatten)]
    pub(crate) server: ServerArgs,
    #[command(flatten)]
    pub(crate) run: RunArgs,
}
