//! The kind of a report, by its text.

use crate::carla::{CarlaParameters, preset_names};
use crate::metar::begins;
use serde_json::Value;

/// A kind of weather report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportKind {
    /// METAR or SPECI of an airport.
    Metar,
    /// Weather parameters of CARLA, or one of its presets.
    Carla,
    /// A code of present weather, WMO table 4677.
    PresentWeather,
    /// Plain words.
    Words,
    /// A table of hours as JSON, as Open-Meteo has it.
    HourlyJson,
    /// A table of hours as CSV.
    HourlyCsv,
}

/// Returns the kind of report that a text is. What looks like no other kind is words.
///
/// ```
/// use wm_reports::{ReportKind, recognise};
///
/// assert_eq!(recognise("LSZH 291850Z 00000KT CAVOK 05/02 Q1018"), ReportKind::Metar);
/// assert_eq!(recognise("CARLA HardRainNoon"), ReportKind::Carla);
/// assert_eq!(recognise("wmo 75"), ReportKind::PresentWeather);
/// assert_eq!(recognise("light rain at dusk"), ReportKind::Words);
/// ```
#[must_use]
pub fn recognise(text: &str) -> ReportKind {
    let text = text.trim_start_matches('\u{feff}').trim();
    if text.starts_with(['{', '[']) {
        return if is_carla(text) { ReportKind::Carla } else { ReportKind::HourlyJson };
    }
    let text = after_comments(text);
    let first_line = text.lines().next().unwrap_or_default();
    let first = first_line.split_whitespace().next().unwrap_or_default();
    if begins(first_line) {
        return ReportKind::Metar;
    }
    let lower = first.to_lowercase();
    let is_code = |word: &str| !word.is_empty() && word.bytes().all(|b| b.is_ascii_digit());
    if matches!(&lower[..], "ww" | "wmo" | "wmo4677" | "weather_code" | "weathercode")
        || lower.strip_prefix("ww").is_some_and(is_code)
    {
        return ReportKind::PresentWeather;
    }
    if lower.starts_with("carla")
        || text.starts_with("WeatherParameters")
        || preset_names().any(|name| name == first)
    {
        return ReportKind::Carla;
    }
    let names = |part: &str| {
        let name = part.split(['=', ':']).next().unwrap_or_default().trim();
        part.contains(['=', ':']) && CarlaParameters::NAMES.contains(&name)
    };
    if text.split([',', ' ']).any(names) {
        return ReportKind::Carla;
    }
    if is_table(text) { ReportKind::HourlyCsv } else { ReportKind::Words }
}

/// Returns true for an object of single values one of which has the name of a parameter of CARLA,
/// or nearly.
fn is_carla(json: &str) -> bool {
    let Ok(Value::Object(map)) = serde_json::from_str(json) else { return false };
    let is_flat = !map.values().any(|value| value.is_object() || value.is_array());
    is_flat && map.keys().any(|key| CarlaParameters::is_named(key))
}

/// Returns true for lines of cells: the first with a name that tables have, or as many cells in
/// both of the first two, a number among the second's.
fn is_table(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let (Some(first), Some(second)) = (lines.next(), lines.next()) else { return false };
    let cells = |line: &'_ str| -> Vec<String> {
        line.split([',', ';', '\t']).map(|cell| cell.trim().trim_matches('"').to_lowercase()).collect()
    };
    let (first, second) = (cells(first), cells(second));
    let is_name = |name: &String| {
        matches!(&name[..], "time" | "date" | "latitude" | "datetime" | "valid_time" | "year")
    };
    let has_numbers = || second.iter().any(|cell| cell.parse::<f64>().is_ok());
    first.len() > 1 && first.iter().any(is_name)
        || first.len() > 2 && first.len() == second.len() && has_numbers()
}

/// A text without what may stand before a report: lines of comment, and the line with the date that
/// NOAA puts before a METAR (`2024/01/15 18:51`).
pub(crate) fn after_comments(text: &str) -> &str {
    let mut rest = text;
    loop {
        let (line, others) = rest.split_once('\n').unwrap_or((rest, ""));
        let shape = line.trim().replace(|c: char| c.is_ascii_digit(), "0");
        if !line.starts_with('#') && shape != "0000/00/00 00:00" {
            return rest;
        }
        rest = others.trim_start();
    }
}
