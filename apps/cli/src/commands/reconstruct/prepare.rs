//! Makes what weather must know of a new scene, so that its first pictures do not wait.

use crate::interrupt;
use crate::progress::Reporter;
use crate::scene::{AssetFolder, RunArgs};
use anyhow::Result;
use std::path::Path;
use weather_magician::levels::LevelBudget;
use weather_magician::{PlaceOptions, Weather};

/// The presets whose assets are made: rain under a cloudy sky, and lying snow.
const PRESETS: [&str; 2] = ["heavy-rain", "snow-covered"];

/// Makes the assets of rain, clouds and lying snow for the scene of a file. Ctrl-C leaves them out:
/// weather makes them later.
pub(crate) fn prepare(out: &Path, run: &RunArgs) -> Result<()> {
    let options = PlaceOptions { assets: AssetFolder::default().folder(out), ..PlaceOptions::default() };
    let mut renderer = run.renderer()?;
    // A scene in levels that does not fit the memory is prepared about the cameras that are there
    // later.
    let mut place = renderer.open(out, &options, &LevelBudget::default())?;
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
