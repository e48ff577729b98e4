//! A report that has been read: the weather file, the weather, and what was guessed.

use crate::carla::CarlaParameters;
use crate::draft::{ReportNote, WrittenWeather};
use crate::error::ReportError;
use crate::hourly::WeatherTable;
use crate::metar::Metar;
use crate::options::ReportOptions;
use crate::present_weather::PresentWeather;
use crate::recognise::{ReportKind, after_comments, recognise};
use crate::words::WordsReport;
use crate::{carla, hourly, metar, present_weather, words};
use std::ffi::OsStr;
use std::path::Path;
use wm_weather::Weather;

/// Most bytes of a report that is no table.
const MAX_REPORT_BYTES: usize = 10_000;

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
    fn of(decoded: DecodedReport, written: WrittenWeather) -> Self {
        let WrittenWeather { name, toml, weather, notes } = written;
        Self { name, decoded, toml, weather, notes }
    }

    /// Reads a report of any kind from its text; `source` is its name in messages, that of a file.
    ///
    /// ```
    /// use wm_reports::{ReportOptions, WeatherReport};
    ///
    /// let report = WeatherReport::read("ww 75", "ww", &ReportOptions::default())?;
    /// assert_eq!(report.weather().at(0.0).prepare(&wm_weather::Site::PLAIN).falling[0].rate, 4.0);
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
        let read = match kind {
            ReportKind::Metar => {
                metar::read(line, options).map(|(metar, file)| (DecodedReport::Metar(Box::new(metar)), file))
            }
            ReportKind::Carla => carla::read(line).map(|(own, file)| (DecodedReport::Carla(own), file)),
            ReportKind::PresentWeather => {
                present_weather::read(line).map(|(row, file)| (DecodedReport::PresentWeather(row), file))
            }
            ReportKind::Words => {
                words::read(line).map(|(words, file)| (DecodedReport::Words(Box::new(words)), file))
            }
            ReportKind::HourlyJson => {
                return WeatherTable::parse_json(text, source)?.weather(&stem(), options);
            }
            ReportKind::HourlyCsv => return WeatherTable::parse_csv(text, source)?.weather(&stem(), options),
        };
        read.map(|(decoded, written)| Self::of(decoded, written))
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

impl WeatherTable {
    /// The weather of the table, an hour in `seconds_per_hour` of the options.
    ///
    /// # Errors
    /// [`ReportError::Weather`] if what comes out is no weather.
    pub fn weather(&self, name: &str, options: &ReportOptions) -> Result<WeatherReport, ReportError> {
        let written = hourly::weather::weather(self, name, options)?;
        Ok(WeatherReport::of(DecodedReport::Table(self.clone()), written))
    }
}
