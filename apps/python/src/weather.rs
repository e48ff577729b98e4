//! Weathers: presets, files, reports and parameters.

use crate::error::{Failure, Outcome, line_of};
use crate::process::detached;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::path::{Path, PathBuf};
use weather_magician::panorama_file::read_panorama;
use weather_magician::reports::{ReportOptions, WeatherReport, find_weather};
use wm_weather::param::{ParamInput, ParamValue};
use wm_weather::presets::PRESETS;

#[doc = docs!("Weather")]
#[pyclass(frozen, name = "Weather", module = "weather_magician")]
#[derive(Clone)]
pub(crate) struct PyWeather {
    pub(crate) weather: wm_weather::Weather,
    notes: Vec<String>,
}

impl PyWeather {
    fn of(mut weather: wm_weather::Weather, notes: Vec<String>) -> Outcome<Self> {
        weather.load_images(read_panorama)?;
        Ok(Self { weather, notes })
    }

    fn of_report(report: &WeatherReport) -> Outcome<Self> {
        let notes = report.notes().iter().map(ToString::to_string).collect();
        Self::of(report.weather().clone(), notes)
    }

    /// A weather as functions take it: a `PyWeather`, or what makes one; clear air for `None`.
    pub(crate) fn given(value: Option<&Bound<'_, PyAny>>) -> PyResult<wm_weather::Weather> {
        let Some(value) = value else { return Ok(wm_weather::Weather::clear()) };
        if let Ok(weather) = value.cast::<Self>() {
            return Ok(weather.get().weather.clone());
        }
        let Ok(name) = value.extract::<PathBuf>() else {
            return Err(PyTypeError::new_err("weather: must be a Weather, or the name of one"));
        };
        Ok(Self::new(value.py(), Some(name), None)?.weather)
    }
}

/// A value of a parameter as Python gives it.
fn input_of(value: &Bound<'_, PyAny>) -> PyResult<ParamInput> {
    if let Ok(is_on) = value.extract::<bool>() {
        return Ok(if is_on { "on" } else { "off" }.into());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(number.into());
    }
    if let Ok(text) = value.extract::<String>() {
        return Ok(text.into());
    }
    if let Ok(path) = value.extract::<PathBuf>() {
        return Ok(path.display().to_string().into());
    }
    // Keyframes: seconds and values.
    if let Ok(keys) = value.cast::<PyDict>() {
        let key = |(time, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| -> PyResult<String> {
            Ok(format!("{}:{}", time.extract::<f64>()?, value.str()?))
        };
        return Ok(keys.iter().map(key).collect::<PyResult<Vec<_>>>()?.join(",").into());
    }
    if let Ok(color) = value.extract::<[f64; 3]>() {
        return Ok(color.into());
    }
    Err(PyTypeError::new_err(
        "a parameter is a number, a text, a colour of three numbers (sRGB, 0 to 1), or keyframes {seconds: value}",
    ))
}

fn failed(error: &dyn std::error::Error) -> Failure {
    Failure::Library(line_of(error))
}

#[pymethods]
impl PyWeather {
    #[new]
    #[pyo3(signature = (name=None, parameters=None))]
    fn new(py: Python<'_>, name: Option<PathBuf>, parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let is_named = name.is_some();
        let name = name.map_or_else(|| "clear".into(), |name| name.to_string_lossy().into_owned());
        let found = detached(py, |_| find_weather(&name, Path::new("")).map_err(|error| failed(&error)))?;
        let mut weather = found.weather;
        for (key, value) in parameters.into_iter().flatten() {
            let (key, value) = (key.extract::<String>()?, input_of(&value)?);
            weather = weather.set(&key, value).map_err(|error| failed(&error))?;
        }
        let notes = found.report.iter().flat_map(WeatherReport::notes).map(ToString::to_string).collect();
        if !is_named && weather.effects().next().is_some() {
            // As the program names it.
            weather.name = weather.effects().map(|(effect, _)| effect.name).collect::<Vec<_>>().join("-");
        }
        detached(py, |_| Self::of(weather, notes))
    }

    #[doc = docs!("Weather.presets")]
    #[staticmethod]
    fn presets() -> Vec<&'static str> {
        PRESETS.iter().map(|(name, _)| *name).collect()
    }

    #[doc = docs!("Weather.parse")]
    #[staticmethod]
    fn parse(py: Python<'_>, text: &str) -> PyResult<Self> {
        detached(py, |_| Self::of(wm_weather::Weather::parse(text, "weather")?, Vec::new()))
    }

    #[doc = docs!("Weather.from_report")]
    #[staticmethod]
    #[pyo3(signature = (report, *, place=None, day=None, seconds_per_hour=1.0))]
    fn from_report(
        py: Python<'_>,
        report: PathBuf,
        place: Option<[f64; 2]>,
        day: Option<u32>,
        seconds_per_hour: f64,
    ) -> PyResult<Self> {
        detached(py, |_| {
            let options = ReportOptions { seconds_per_hour, place, day };
            let text = report.to_string_lossy();
            let is_file = weather_magician::reports::looks_like_path(&text) || report.is_file();
            let read = if is_file {
                WeatherReport::read_file(&report, &options)
            } else {
                WeatherReport::read(&text, "report", &options)
            };
            Self::of_report(&read.map_err(|error| failed(&error))?)
        })
    }

    #[doc = docs!("Weather.set")]
    fn set(&self, py: Python<'_>, key: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let set = self.weather.clone().set(key, input_of(value)?).map_err(|error| failed(&error))?;
        detached(py, |_| Self::of(set, self.notes.clone()))
    }

    fn __repr__(&self) -> String {
        let effects: Vec<&str> = self.weather.effects().map(|(effect, _)| effect.name).collect();
        format!("Weather({:?}: {})", self.weather.name, effects.join(", "))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.weather == other.weather
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, own) = (slf.py(), slf.get());
        let again = py.import("weather_magician._native")?.getattr("_weather_of")?;
        Ok((again, (own.weather.to_toml(), &own.notes).into_pyobject(py)?))
    }

    #[doc = docs!("Weather.name")]
    #[getter]
    fn name(&self) -> &str {
        &self.weather.name
    }

    #[doc = docs!("Weather.about")]
    #[getter]
    fn about(&self) -> &str {
        &self.weather.about
    }

    #[doc = docs!("Weather.notes")]
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    #[doc = docs!("Weather.to_toml")]
    fn to_toml(&self) -> String {
        self.weather.to_toml()
    }

    #[doc = docs!("Weather.save")]
    fn save(&self, path: PathBuf) -> PyResult<()> {
        let written = wm_base::files::write_atomically(&path, |out| {
            Ok(out.write_all(self.weather.to_toml().as_bytes())?)
        });
        Ok(written.map_err(|error| failed(&error))?)
    }

    #[doc = docs!("Weather.parameters")]
    #[pyo3(signature = (time=0.0))]
    fn parameters<'py>(&self, py: Python<'py>, time: f64) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        let sample = self.weather.at(time);
        for (effect, values) in sample.effects() {
            for (param, value) in effect.params.iter().zip(values) {
                let key = format!("{}.{}", effect.name, param.name);
                match value {
                    ParamValue::Number(number) => dict.set_item(key, number)?,
                    ParamValue::Color(color) => dict.set_item(key, PyList::new(py, color)?)?,
                    other => dict.set_item(key, other.to_string())?,
                }
            }
        }
        Ok(dict)
    }
}

/// Makes a weather that was pickled.
#[pyfunction]
pub(crate) fn _weather_of(py: Python<'_>, text: &str, notes: Vec<String>) -> PyResult<PyWeather> {
    detached(py, |_| PyWeather::of(wm_weather::Weather::parse(text, "pickled weather")?, notes))
}
