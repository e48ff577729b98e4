//! Weathers as people name them: presets, weather files, reports and their files.

use crate::{ReportError, ReportKind, ReportOptions, WeatherReport, recognise};
use std::path::Path;
use wm_weather::Weather;
use wm_weather::presets::PRESETS;

/// A weather that was found by what a user gave.
#[derive(Clone, Debug)]
pub struct FoundWeather {
    /// The weather.
    pub weather: Weather,
    /// The report that it was read from, if it was one.
    pub report: Option<WeatherReport>,
}

/// Finds the weather of a preset's name, of a weather file, or of a report or its file. Paths are
/// from `folder`.
///
/// ```
/// use std::path::Path;
///
/// let found = wm_reports::find_weather("light snow, -3 C", Path::new(""))?;
/// assert!(found.report.is_some() && found.weather.has(wm_weather::EffectRole::Falls));
/// let wrong = wm_reports::find_weather("fogg", Path::new("plans")).unwrap_err().to_string();
/// assert!(wrong.contains("there is no weather `fogg`, did you mean `fog`?"));
/// # Ok::<(), wm_reports::ReportError>(())
/// ```
///
/// # Errors
/// [`ReportError`] of the report or of the weather.
pub fn find_weather(name: &str, folder: &Path) -> Result<FoundWeather, ReportError> {
    if PRESETS.iter().any(|(known, _)| *known == name) {
        return Ok(FoundWeather { weather: Weather::preset(name)?, report: None });
    }
    let path = folder.join(name);
    let is_toml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let report = if is_toml && !name.contains('\n') {
        return Ok(FoundWeather { weather: Weather::read(&path)?, report: None });
    } else if looks_like_path(name) {
        WeatherReport::read_file(&path, &ReportOptions::default())?
    } else if !path.exists()
        // A misspelt name of a preset is one word, and a report of one word has a form of its own.
        && (name.trim().contains(char::is_whitespace) || recognise(name) != ReportKind::Words)
    {
        WeatherReport::read(name, "report", &ReportOptions::default())?
    } else {
        // A name that is neither gets the nearest preset.
        let weather = if path.exists() { Weather::read(&path)? } else { Weather::find(name)? };
        return Ok(FoundWeather { weather, report: None });
    };
    Ok(FoundWeather { weather: report.weather().clone(), report: Some(report) })
}

/// Returns true if a text that is no file was meant to be one.
#[must_use]
pub fn looks_like_path(text: &str) -> bool {
    let has_ending = |ending: &str| text.to_lowercase().ends_with(ending);
    !text.contains(['\n', '{']) && [".json", ".csv", ".txt", ".metar"].iter().any(|ending| has_ending(ending))
}
