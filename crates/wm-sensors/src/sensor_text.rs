//! Sensors by name: presets, TOML files, and faults with their places.

use crate::error::SensorError;
use serde::de::DeserializeOwned;
use std::borrow::Cow;
use std::path::Path;
use wm_base::nearest;

/// A kind of sensor.
pub(crate) struct SensorKind {
    /// The word for it in errors.
    pub(crate) name: &'static str,
    /// Names and texts of its presets.
    pub(crate) presets: &'static [(&'static str, &'static str)],
    /// Longest file that is read, bytes.
    pub(crate) most_bytes: u64,
}

/// A sensor in TOML.
pub(crate) struct SensorText<'a> {
    /// TOML.
    text: Cow<'a, str>,
    /// The name of the sensor where the text has none.
    pub(crate) name: String,
    /// The name in errors: the file, if it came from one.
    place: String,
}

impl SensorKind {
    /// The preset of a name; `otherwise` says in the error what else may be given.
    pub(crate) fn preset(&self, name: &str, otherwise: &str) -> Result<SensorText<'static>, SensorError> {
        let is_same = |known: &str| known.eq_ignore_ascii_case(name.trim());
        if let Some((known, text)) = self.presets.iter().find(|(known, _)| is_same(known)) {
            return Ok(SensorText::new(text, known));
        }
        let names: Vec<&str> = self.presets.iter().map(|(name, _)| *name).collect();
        let near = nearest(&name.to_lowercase(), names.iter().copied(), 1);
        let advice = match near[..] {
            [near] => format!("did you mean {near}?"),
            _ => format!("give {}{otherwise}", names.join(", ")),
        };
        Err(SensorError::Unknown { name: name.into(), kind: self.name, advice })
    }

    /// The preset of a name, or the TOML file of that path.
    pub(crate) fn find(&self, name: &str) -> Result<SensorText<'static>, SensorError> {
        let preset = self.preset(name, ", or a .toml file");
        let path = Path::new(name);
        if preset.is_ok() || (path.extension().is_none() && !path.exists()) {
            return preset;
        }
        let unread = |error| SensorError::Read { path: path.into(), error };
        let text = wm_base::files::read_text(path, wm_base::files::SMALL_TEXT).map_err(unread)?;
        let found = SensorText {
            text: text.into(),
            name: path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
            place: path.display().to_string(),
        };
        if found.text.len() as u64 > self.most_bytes {
            return Err(found.fault(format!("it is too long for a {}: give a TOML file", self.name)));
        }
        Ok(found)
    }
}

impl<'a> SensorText<'a> {
    /// Wraps a text; errors name the sensor.
    pub(crate) fn new(text: &'a str, name: &str) -> Self {
        Self { text: text.into(), name: name.into(), place: name.into() }
    }

    /// The value of the text.
    pub(crate) fn parse<T: DeserializeOwned>(&self) -> Result<T, SensorError> {
        toml::from_str(&self.text).map_err(|error| {
            let line = |start: usize| 1 + self.text[..start.min(self.text.len())].matches('\n').count();
            let location =
                error.span().map(|span| format!(", line {}", line(span.start))).unwrap_or_default();
            let problem = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
            SensorError::Model { name: self.place.clone(), location, problem }
        })
    }

    /// Says which of some numbers, each with its key, its range and its unit, is the first beyond
    /// its range.
    ///
    /// # Errors
    /// As [`Self::fault`].
    pub(crate) fn check(&self, numbers: &[(&str, f64, [f64; 2], &str)]) -> Result<(), SensorError> {
        let wrong = numbers.iter().find(|(_, value, [low, high], _)| !(low..=high).contains(&value));
        let Some((key, value, [low, high], unit)) = wrong else { return Ok(()) };
        let problem = format!("{key} is {value}: it must be from {low} to {high} {unit}");
        Err(self.fault(problem.trim_end().into()))
    }

    /// The error of a text that is TOML and makes no sensor.
    pub(crate) fn fault(&self, problem: String) -> SensorError {
        SensorError::Model { name: self.place.clone(), location: String::new(), problem }
    }
}
