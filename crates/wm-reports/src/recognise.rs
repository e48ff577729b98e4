//! The kind of a report, by its text.

use crate::carla::{CarlaParameters, preset_names};
use crate::metar::begins;

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
    if text.starts_with('{') || text.starts_with('[') {
        let has_hours = ["\"hourly\"", "\"time\""].iter().any(|key| text.contains(key));
        let is_carla = !has_hours && CarlaParameters::NAMES.iter().any(|name| text.contains(name));
        return if is_carla { ReportKind::Carla } else { ReportKind::HourlyJson };
    }
    let text = after_comments(text);
    let first_line = text.lines().next().unwrap_or_default();
    let first = first_line.split_whitespace().next().unwrap_or_default();
    if begins(first_line) {
        return ReportKind::Metar;
    }
    let lower = first.to_lowercase();
    let is_code = |word: &str| !word.is_empty() && word.bytes().all(|b| b.is_ascii_digit());
    if matches!(&lower[..], "ww" | "wmo" | "wmo4677" | "weather_code" | "weathercode") {
        return ReportKind::PresentWeather;
    }
    if let Some(digits) = lower.strip_prefix("ww")
        && is_code(digits)
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
    let is_table = first_line.contains([',', ';', '\t'])
        && text.lines().nth(1).is_some()
        && first_line.split([',', ';', '\t']).any(|cell| {
            let name = cell.trim().trim_matches('"').to_lowercase();
            matches!(&name[..], "time" | "date" | "latitude" | "datetime" | "valid_time" | "year")
        });
    if is_table { ReportKind::HourlyCsv } else { ReportKind::Words }
}

/// A text without the lines of comment at its beginning.
pub(crate) fn after_comments(text: &str) -> &str {
    let mut rest = text;
    while rest.starts_with('#') {
        rest = rest.split_once('\n').map_or("", |(_, rest)| rest).trim_start();
    }
    rest
}
