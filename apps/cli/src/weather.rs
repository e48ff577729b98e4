//! Options of a weather.

use crate::commands::weather::summary;
use anyhow::Result;
use clap::Args;
use std::path::{Path, PathBuf};
use weather_magician::Weather;
use weather_magician::panorama_file::read_panorama;
use weather_magician::reports::find_weather;

/// The weather and its parameters.
#[derive(Args, Debug)]
pub(crate) struct WeatherArgs {
    /// The weather: a name from the list below (--help), a TOML file, or a weather report or its
    /// file, as `weather from` takes it [default: clear]
    #[arg(short, long, value_name = "NAME|FILE|REPORT", help_heading = "Weather")]
    weather: Option<String>,
    /// Change a parameter and turn its effect on: fog.mor=120, or keyframes fog.mor=0:2000,5:60
    #[arg(short, long = "set", value_name = "KEY=VALUE", help_heading = "Weather")]
    set: Vec<String>,
}

impl WeatherArgs {
    /// Returns true if an option was given.
    pub(crate) fn is_given(&self) -> bool {
        self.weather.is_some() || !self.set.is_empty()
    }

    /// Reads the weather and its panoramas.
    pub(crate) fn read(&self) -> Result<Weather> {
        Ok(self.read_with_files()?.0)
    }

    /// Reads the weather and its panoramas; also returns the paths of the files that were read.
    pub(crate) fn read_with_files(&self) -> Result<(Weather, Vec<PathBuf>)> {
        let mut files: Vec<PathBuf> = self.weather.iter().map(PathBuf::from).collect();
        let mut weather = match &self.weather {
            Some(name) => find(name)?,
            None => Weather::clear(),
        };
        for text in &self.set {
            weather.set_text(text)?;
        }
        weather.load_images(|path| {
            files.push(path.to_path_buf());
            read_panorama(path)
        })?;
        if weather.effects().next().is_some() && self.weather.is_none() {
            weather.name = weather.effects().map(|(effect, _)| effect.name).collect::<Vec<_>>().join("-");
        }
        Ok((weather, files))
    }
}

/// The weather of a preset's name, of a weather file, or of a report or its file.
fn find(name: &str) -> Result<Weather> {
    let found = find_weather(name, Path::new(""))?;
    if let Some(report) = &found.report {
        eprintln!("weather report: {}; `weather-magician weather from` shows its file", summary(report));
    }
    Ok(found.weather)
}
