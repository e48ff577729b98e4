//! Errors of the library as the one exception of Python.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use std::error::Error as StdError;

create_exception!(
    weather_magician,
    Error,
    PyException,
    "What went wrong, in one line: the file, field or value, and what to do.\n\nThe text is that of the program."
);

/// The failure of work without the interpreter.
pub(crate) enum Failure {
    /// An error of the library, as a line.
    Library(String),
    /// The work was asked to stop.
    Stopped,
    /// An exception of a callback.
    Python(PyErr),
}

impl From<weather_magician::Error> for Failure {
    fn from(error: weather_magician::Error) -> Self {
        match error {
            weather_magician::Error::Stopped => Self::Stopped,
            error => Self::Library(line_of(&error)),
        }
    }
}

/// Makes failures of errors that the library's own type does not hold.
macro_rules! failures {
    ($($error:ty),+ $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Library(line_of(&error))
            }
        })+
    };
}

failures! {
    wm_base::FormatError, wm_weather::WeatherError, wm_render::RenderError, wm_scene::CameraError,
    weather_magician::panorama_file::PanoramaFileError, std::io::Error, weather_magician::view::ViewError,
    weather_magician::lidar::SensorError, wm_image::MediaError,
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Library(line) => Error::new_err(line),
            Failure::Stopped => Error::new_err("stopped"),
            Failure::Python(error) => error,
        }
    }
}

/// The result of work without the interpreter.
pub(crate) type Outcome<T> = Result<T, Failure>;

/// Returns the value of a word that stands for an argument.
pub(crate) fn value_of<T: Copy>(name: &str, given: &str, words: &[(&str, T)]) -> PyResult<T> {
    let found = words.iter().find(|(word, _)| *word == given).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let known: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        let (last, others) = known.split_last().unwrap_or((&"", &[]));
        PyValueError::new_err(format!("{name} {given:?}: must be {} or {last}", others.join(", ")))
    })
}

/// Returns an error with its causes in one line, as the program prints it.
pub(crate) fn line_of(error: &dyn StdError) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        text = format!("{text}: {inner}");
        cause = inner.source();
    }
    text.chars()
        .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
        .collect()
}
