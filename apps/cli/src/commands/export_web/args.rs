//! Options of `export-web`.

use super::assets::AssetBudget;
use crate::commands::render::camera::ViewpointArgs;
use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::scene::{OwnSkyArgs, RunArgs, SceneArgs};
use crate::weather::WeatherArgs;
use anyhow::{Result, bail};
use clap::Args;
use std::path::PathBuf;
use weather_magician::Weather;
use weather_magician::levels::parse_memory;

/// Options of `export-web`.
#[derive(Args, Debug)]
#[command(after_help = "weather-magician export-web garden.ply --weather fog --out site/\n\
                  weather-magician export-web garden.ply --weather moderate-rain --set wind.speed=6 --single-file --out garden.html\n\n\
                  Put the folder on any static host, or look at it here: python3 -m http.server -d site/\n\
                  docs/guide/web.md says what runs where, and how the player is built.")]
pub(crate) struct ExportWebArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    #[command(flatten)]
    pub(super) sky: OwnSkyArgs,
    #[command(flatten)]
    pub(super) weather: WeatherArgs,
    /// Time of the weather at which the page opens, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0.0,
        allow_negative_numbers = true,
        help_heading = "Weather"
    )]
    pub(super) time: f64,
    /// Weathers that the page has the prepared data of, beside its first: auto (those of common
    /// presets, as far as they fit --asset-megabytes), all (of every preset, as far as they fit),
    /// none, or a list of presets and weather files. The browser makes what is not prepared when it
    /// is asked for
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "auto",
        help_heading = "Weather"
    )]
    pub(super) prepare: Vec<String>,
    /// Most of those data, megabytes [default: 128, with --single-file 12]; those of the first
    /// weather are always there but with --single-file
    #[arg(long, value_name = "N", help_heading = "Weather")]
    asset_megabytes: Option<u32>,
    #[command(flatten)]
    pub(super) viewpoint: ViewpointArgs,
    /// Output folder, or the HTML file with --single-file [default: named after scene and weather,
    /// in this folder]
    #[arg(short, long, value_name = "PATH", help_heading = "Output")]
    out: Option<PathBuf>,
    #[command(flatten)]
    pub(super) overwrite: OverwriteArgs,
    /// Write one HTML file with everything in it, 40 MB at most; it also opens from a disk
    #[arg(long, help_heading = "Output")]
    pub(super) single_file: bool,
    /// Folder with player.js and player_bg.wasm [default: those of the program, or web-player
    /// beside it]
    #[arg(long, value_name = "FOLDER", help_heading = "Output")]
    pub(super) player: Option<PathBuf>,
    /// Leave out the video, which browsers show that cannot run the player
    #[arg(long, help_heading = "Output")]
    pub(super) no_video: bool,
    /// Leave out the small pictures of the presets
    #[arg(long, help_heading = "Output")]
    pub(super) no_thumbnails: bool,
    /// Memory that the page may take for a scene in levels of detail, such as 2GiB or 800MB
    /// [default: 1GiB]
    #[arg(long, value_name = "BYTES", value_parser = parse_memory, help_heading = "Output")]
    pub(super) memory: Option<u64>,
    #[command(flatten)]
    pub(super) run: RunArgs,
}

impl ExportWebArgs {
    /// Checks the options that do not depend on the scene.
    pub(super) fn check(&self) -> Result<()> {
        self.viewpoint.check()?;
        if !self.time.is_finite() || self.time.abs() > 1e6 {
            bail!("--time {}: give seconds, such as 0 or 12.5", self.time);
        }
        if self.scene.assets.is_some() {
            bail!("--assets: a site has a folder of its own for them; leave it out");
        }
        Ok(())
    }

    /// Returns the bytes that prepared data may take.
    pub(super) fn asset_budget(&self) -> AssetBudget {
        let megabytes = self.asset_megabytes.unwrap_or(if self.single_file { 12 } else { 128 });
        AssetBudget { most: u64::from(megabytes) * 1_000_000, is_strict: self.single_file }
    }

    /// Returns the output path.
    pub(super) fn out(&self, weather: &Weather) -> Result<PathBuf> {
        let named = || {
            let name = format!("{}-{}", stem_of(&self.scene.scene), weather.name);
            PathBuf::from(if self.single_file { name + ".html" } else { name + "-site" })
        };
        let out = self.out.clone().unwrap_or_else(named);
        let is_html = out.extension().is_some_and(|e| e.eq_ignore_ascii_case("html"));
        match (self.single_file, is_html) {
            (true, false) => bail!("{}: --single-file writes a .html file; name one", out.display()),
            (false, true) => {
                bail!("{}: a site is a folder; give --single-file for one HTML file", out.display())
            }
            _ => Ok(out),
        }
    }
}
