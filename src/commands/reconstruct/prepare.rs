//! Makes what weather must know of a new scene, so that its first pictures do not wait.

use crate::interrupt;
use crate::progress::Reporter;
use crate::scene::{AssetFolder, RunArgs, read_options};
use anyhow::Result;
use std::path::Path;
use weather_magician::{PlaceOptions, Weather};
use wm_scene::formats::read_scene;

/// The presets whose assets are made: rain under a cloudy sky, and lying snow.
const PRESETS: [&str; 2] = ["heavy-rain", "snow-covered"];

/// Makes the assets of rain, clouds and lying snow for the scene of a file. Ctrl-C leaves them out: weather makes them later.
pub fn prepare(out: &Path, run: &RunArgs) -> Result<()> {
    let options = PlaceOptions { assets: AssetFolder::default().folder(out), ..PlaceOptions::default() };
    let mut renderer = run.renderer()?;
    let mut place = renderer.load_with(read_scene(out, &read_options(None))?, &options)?;
    for preset in PRESETS {
        if interrupt::asked() {
            return Ok(());
        }
        let done = renderer.prepare(&mut place, &Weather::preset(preset)?, &mut Reporter::default());
        match done {
            Err(weather_magician::Error::Stopped) => return Ok(()),
            done => done?,
        }
    }
    Ok(())
}
