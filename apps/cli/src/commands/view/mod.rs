//! `view`: shows a scene and its weather in a browser.

mod args;

pub(crate) use args::ViewArgs;

use crate::viewer;
use anyhow::{Context, Result};
use std::collections::BTreeMap;
use std::path::PathBuf;
use weather_magician::panorama_file::read_panorama;
use wm_base::FormatError;
use wm_viewer::catalog::{panorama_name, panoramas_of};

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
