//! Errors of reports.

use std::path::PathBuf;
use thiserror::Error;
use wm_base::nearest;
use wm_weather::WeatherError;

/// Why a report is not read.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReportError {
    /// A file cannot be read.
    #[error("{}: cannot read the weather report: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// Something in a report of one line is wrong.
    #[error("{kind}, character {position}: {problem}")]
    Text {
        /// The kind of report, in words.
        kind: &'static str,
        /// Position in characters, from 1.
        position: usize,
        /// The problem and what to do.
        problem: String,
    },
    /// A value of a report has a name and no place: parameters and JSON.
    #[error("{file}: {key} {problem}")]
    Value {
        /// The file, or the kind of report.
        file: String,
        /// The name of the value.
        key: String,
        /// The problem and what to do.
        problem: String,
    },
    /// A line of a table is wrong.
    #[error("{file}:{line}: {problem}")]
    Line {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// The column or key, the problem and what to do.
        problem: String,
    },
    /// A file or a text is wrong as a whole.
    #[error("{file}: {problem}")]
    Whole {
        /// The file, or the kind of report.
        file: String,
        /// The problem and what to do.
        problem: String,
    },
    /// A file holds a report of one line, which is wrong.
    #[error("{file}: {error}")]
    InFile {
        /// The file.
        file: String,
        /// The problem, with its place in the report.
        error: Box<Self>,
    },
    /// A preset or a weather file that was asked for, or the weather that came out of a report.
    #[error(transparent)]
    Weather(#[from] WeatherError),
}

impl ReportError {
    /// The error with the name of the file that the report was read from, unless it has it.
    pub(crate) fn in_file(self, name: &str) -> Self {
        let is_named = match &self {
            Self::Text { .. } => false,
            Self::Value { file, .. } | Self::Line { file, .. } | Self::Whole { file, .. } => file == name,
            Self::Read { .. } | Self::InFile { .. } | Self::Weather(_) => true,
        };
        if is_named { self } else { Self::InFile { file: name.into(), error: Box::new(self) } }
    }
}

/// `, did you mean ...`, if something is near enough.
pub(crate) fn meant<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    nearest(name, known, 1).first().map_or_else(String::new, |near| format!(", did you mean `{near}`?"))
}

/// A text of a user without control characters, at most 100 characters of it.
pub(crate) fn plain(text: &str) -> String {
    text.chars().take(100).map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// A text of a user as it is quoted in messages: at most 40 characters, none of them a control
/// character.
pub(crate) fn quoted(text: &str) -> String {
    let mut short: String = text.chars().take(40).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if text.chars().count() > 40 {
        short.push_str("...");
    }
    format!("`{short}`")
}
