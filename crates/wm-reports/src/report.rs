//! A report that has been read: the weather file, the weather, and what was guessed.

use crate::carla::CarlaParameters;
use crate::error::ReportError;
use crate::hourly::WeatherTable;
use crate::metar::Metar;
use crate::present_weather::PresentWeather;
use crate::recognise::{ReportKind, after_comments, recognise};
use crate::words::WordsReport;
use crate::{carla, metar, present_weather, words};
use std::ffi::OsStr;
use std::fmt;
use std::path::Path;
use wm_weather::Weather;

/// Most bytes of a report that is no table.
const MAX_REPORT_BYTES: usize = 10_000;

/// The kind of a remark about a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportNoteKind {
    /// A value that the report does not have.
    Guess,
    /// A quantity that was not measured and that the weather file does not set.
    Missing,
    /// A part of the report that a weather file cannot hold.
    Ignored,
    /// A value beyond the range of its parameter.
    Clamped,
}

/// A remark about a report: a value that was guessed, a part that was ignored, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReportNote {
    /// The kind.
    pub kind: ReportNoteKind,
    /// One line.
    pub text: String,
}

impl fmt::Display for ReportNote {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            ReportNoteKind::Guess => "guess",
            ReportNoteKind::Missing => "not measured",
            ReportNoteKind::Ignored => "ignored",
            ReportNoteKind::Clamped => "clamped",
        };
        write!(f, "{kind}: {}", self.text)
    }
}

/// The fields of a report as it states them.
#[derive(Clone, Debug, PartialEq)]
pub enum DecodedReport {
    /// A METAR or SPECI.
    Metar(Box<Metar>),
    /// Weather parameters of CARLA.
    Carla(CarlaParameters),
    /// A code of present weather, WMO table 4677.
    PresentWeather(&'static PresentWeather),
    /// Plain words.
    Words(Box<WordsReport>),
    /// A table of hours.
    Table(WeatherTable),
}

/// Knowledge that a report lacks and its reader may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportOptions {
    /// Seconds of the shot in an hour of a table, 0.001 to 3600.
    pub seconds_per_hour: f64,
    /// Latitude and longitude, degrees: with them the sun of a METAR and of a table without a place
    /// is that of its time.
    pub place: Option<[f64; 2]>,
    /// Day of the year, 1 to 366, for a METAR, which has only the day of the month.
    pub day: Option<u32>,
}

impl Default for ReportOptions {
    fn default() -> Self {
        Self { seconds_per_hour: 1.0, place: None, day: None }
    }
}

impl ReportOptions {
    fn check(&self) -> Result<(), ReportError> {
        let wrong = |key: &str, problem: String| {
            Err(ReportError::Value { file: "options".into(), key: key.into(), problem })
        };
        if !(0.001..=3600.0).contains(&self.seconds_per_hour) {
            let problem = format!("is {}: must be 0.001 to 3600", self.seconds_per_hour);
            return wrong("seconds_per_hour", problem);
        }
        if let Some([latitude, longitude]) = self.place
            && !((-90.0..=90.0).contains(&latitude) && (-180.0..=360.0).contains(&longitude))
        {
            let problem = format!("is {latitude}, {longitude}: must be latitude, longitude in degrees");
            return wrong("place", problem);
        }
        if let Some(day) = self.day.filter(|day| !(1..=366).contains(day)) {
            return wrong("day", format!("is {day}: must be 1 to 366"));
        }
        Ok(())
    }
}

/// A weather report as a weather.
#[derive(Clone, Debug, PartialEq)]
pub struct WeatherReport {
    /// The name, which is that of the weather: letters, digits, `-` and `_`, at most 48 characters.
    pub name: String,
    /// The fields that it states.
    pub decoded: DecodedReport,
    pub(crate) toml: String,
    pub(crate) weather: Weather,
    pub(crate) notes: Vec<ReportNote>,
}

impl WeatherReport {
    /// Reads a report of any kind from its text; `source` is its name in messages, that of a file.
    ///
    /// ```
    /// use wm_reports::{ReportOptions, WeatherReport};
    ///
    /// let report = WeatherReport::read("ww 75", "ww", &ReportOptions::default())?;
    /// assert_eq!(report.weather().at(0.0).prepare(&wm_weather::Site::PLAIN).falling()[0].rate, 4.0);
    /// # Ok::<(), wm_reports::ReportError>(())
    /// ```
    ///
    /// # Errors
    /// [`ReportError`] with the place in the text and what is expected there.
    pub fn read(text: &str, source: &str, options: &ReportOptions) -> Result<Self, ReportError> {
        options.check()?;
        // Editors of some systems put this in front.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let line = after_comments(text.trim_start());
        let whole = |problem: String| Err(ReportError::Whole { file: source.into(), problem });
        if line.is_empty() {
            return whole("is empty: a report is expected".into());
        }
        if line.starts_with('<') {
            let problem = "is XML or HTML, which is no report that is read: give the report itself as text, JSON or CSV";
            return whole(problem.into());
        }
        let kind = recognise(text);
        let is_table = matches!(kind, ReportKind::HourlyJson | ReportKind::HourlyCsv);
        if !is_table && line.len() > MAX_REPORT_BYTES {
            return whole(format!(
                "is {} bytes long and no table of hours: a report of one line is expected, or columns with a `time`",
                line.len()
            ));
        }
        // A table is named after its file, without the folder and the ending.
        let stem = || Path::new(source).file_stem().map_or_else(|| source.into(), OsStr::to_string_lossy);
        match kind {
            ReportKind::Metar => metar::read(line, options),
            ReportKind::Carla => carla::read(line),
            ReportKind::PresentWeather => present_weather::read(line),
            ReportKind::Words => words::read(line),
            ReportKind::HourlyJson => WeatherTable::parse_json(text, source)?.weather(&stem(), options),
            ReportKind::HourlyCsv => WeatherTable::parse_csv(text, source)?.weather(&stem(), options),
        }
    }

    /// Reads a report from a file.
    ///
    /// # Errors
    /// As [`Self::read`], and [`ReportError::Read`] if there is no such file or it is no text.
    pub fn read_file(path: &Path, options: &ReportOptions) -> Result<Self, ReportError> {
        let text = wm_base::files::read_text(path, wm_base::files::LARGE_TEXT).map_err(|error| {
            let reason = match error.kind() {
                std::io::ErrorKind::NotFound => "no such file; check the path".into(),
                std::io::ErrorKind::IsADirectory => "it is a folder; give a file".into(),
                std::io::ErrorKind::InvalidData => format!("it is {error}, or give JSON, CSV or a report"),
                _ => error.to_string(),
            };
            ReportError::Read { path: path.into(), reason }
        })?;
        let name = path.display().to_string();
        Self::read(&text, &name, options).map_err(|error| error.in_file(&name))
    }

    /// The text of the weather file: each value with the part of the report that it came from.
    #[must_use]
    pub fn to_toml(&self) -> &str {
        &self.toml
    }

    /// The weather, read from [`Self::to_toml`].
    #[must_use]
    pub fn weather(&self) -> &Weather {
        &self.weather
    }

    /// The remarks: values that were guessed or clamped, and parts that were ignored.
    #[must_use]
    pub fn notes(&self) -> &[ReportNote] {
        &self.notes
    }
}
