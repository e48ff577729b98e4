//! The weather file: TOML, one table an effect, and overrides in the same words.
//!
//! ```toml
//! name = "Fog closing in"
//! about = "From a clear day to dense fog in five seconds"
//! fidelity = "physical"            # or "paper"
//!
//! [fog]
//! mor = { keys = [[0, 2000], [5, 60]] }
//! airlight = "#d5dadd"
//! ```
//!
//! An effect is on if its table is there; `sky = "overcast"` instead of a table is its first
//! parameter. A parameter is a number, a colour (`"#rrggbb"` or three numbers), a word, a path,
//! `"auto"`, or keyframes of numbers, colours or words:
//! `{ keys = [[seconds, value], [seconds, value, easing], ...] }`, with the [`Easing`] of the way
//! to the next key.

use crate::easing::Easing;
use crate::effects::{EFFECTS, Effect};
use crate::param::{Param, ParamInput, ParamValue, meant, one_line};
use crate::track::{Keyframe, Track};
use crate::weather::{Fidelity, Weather};
use std::ops::Range;
use std::path::{Path, PathBuf};
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use wm_base::error::escaped;

mod write;

/// Why a weather cannot be used.
#[derive(Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum WeatherError {
    /// The file cannot be read.
    #[error("{}: cannot read the weather file: {reason}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// Something in a file is wrong.
    #[error("{file}:{line}:{column}: {problem}")]
    File {
        /// The file.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The problem and what to do.
        problem: String,
    },
    /// An override is wrong.
    #[error("--set {text}: {problem}")]
    Override {
        /// The override.
        text: String,
        /// The problem and what to do.
        problem: String,
    },
    /// A parameter does not take a value.
    #[error("cannot set {key}: {problem}")]
    Parameter {
        /// The parameter, effect or setting.
        key: String,
        /// The problem and what to do.
        problem: String,
    },
    /// There is neither a preset nor a file of that name.
    #[error("{0}")]
    Unknown(String),
}

impl Weather {
    /// Reads a weather from the text of a file; `file` is its name in messages.
    ///
    /// # Errors
    /// [`WeatherError::File`] with line and column.
    pub fn parse(text: &str, file: &str) -> Result<Self, WeatherError> {
        let at = |span: Range<usize>, problem: String| {
            let before = &text[..span.start.min(text.len())];
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
            WeatherError::File { file: file.into(), line, column, problem: escaped(&problem) }
        };
        let table = DeTable::parse(text)
            .map_err(|error| at(error.span().unwrap_or(0..0), one_line(error.message())))?;
        let mut weather = Self::default();
        for (key, value) in table.get_ref() {
            read_entry(&mut weather, key, value).map_err(|(span, problem)| at(span, problem))?;
        }
        Ok(weather)
    }

    /// Reads a weather file.
    ///
    /// # Errors
    /// [`WeatherError`] if it cannot be read or is wrong.
    pub fn read(path: &Path) -> Result<Self, WeatherError> {
        let text = wm_base::files::read_text(path, wm_base::files::SMALL_TEXT).map_err(|error| {
            let reason = match error.kind() {
                std::io::ErrorKind::NotFound => "no such file; check the path".into(),
                std::io::ErrorKind::IsADirectory => "it is a folder; give a TOML file".into(),
                std::io::ErrorKind::InvalidData => format!("it is {error}, or give a TOML file"),
                _ => error.to_string(),
            };
            WeatherError::Read { path: path.into(), reason }
        })?;
        let mut weather = Self::parse(&text, &path.display().to_string())?;
        let folder = path.parent().unwrap_or(Path::new(""));
        weather.resolve_images(folder);
        if weather.name.is_empty() {
            weather.name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        }
        Ok(weather)
    }

    /// Returns this weather with one parameter changed and its effect turned on.
    ///
    /// `key` is `effect.parameter`, an effect or `fidelity`. The value is a number in the
    /// parameter's unit, a colour (`[f64; 3]`, sRGB, 0-1) or text as on the command line: a word,
    /// `"auto"`, a path, or keyframes such as `"0:2000,5:60"`. The values of an effect are `"on"`,
    /// `"off"` and the words of its first parameter.
    ///
    /// ```
    /// use wm_weather::Weather;
    ///
    /// let weather = Weather::preset("fog")?
    ///     .set("fog.mor", 80.0)?
    ///     .set("fog.airlight", [0.8, 0.82, 0.85])?
    ///     .set("wind.speed", "0:2,10:8")?
    ///     .set("sky", "overcast")?;
    /// assert!(weather.clone().set("fog.moor", 80.0).is_err());
    /// assert!(weather.set("fog.mor", -5.0).is_err());
    /// # Ok::<(), wm_weather::WeatherError>(())
    /// ```
    ///
    /// # Errors
    /// [`WeatherError::Parameter`] if there is no such key or it does not take the value.
    pub fn set(mut self, key: &str, value: impl Into<ParamInput>) -> Result<Self, WeatherError> {
        let value = value.into();
        let changed = match &value {
            ParamInput::Text(text) => self.try_set(key.trim(), text.trim()),
            ParamInput::Value(value) => self.try_set_value(key.trim(), value),
        };
        changed
            .map_err(|problem| WeatherError::Parameter { key: escaped(key), problem: escaped(&problem) })?;
        Ok(self)
    }

    /// Changes one parameter as the option `--set` does: `fog.mor=120` or
    /// `fog.mor=0:2000:smooth,5:60` also turns the effect on, `fog=off` turns it off,
    /// `sky=overcast` is short for its first parameter, `fidelity=paper` changes the fidelity.
    ///
    /// # Errors
    /// [`WeatherError::Override`].
    pub fn set_text(&mut self, text: &str) -> Result<(), WeatherError> {
        let changed = match text.split_once('=') {
            Some((key, value)) => self.try_set(key.trim(), value.trim()),
            None => Err("must be effect.parameter=value, as in fog.mor=120".into()),
        };
        changed.map_err(|problem| WeatherError::Override { text: escaped(text), problem: escaped(&problem) })
    }

    fn try_set_value(&mut self, key: &str, value: &ParamValue) -> Result<(), String> {
        let Some((name, param)) = key.split_once('.') else {
            return self.try_set(key, &value.to_string());
        };
        let index = effect(name)?;
        let position = position(&EFFECTS[index], param)?;
        let value = EFFECTS[index].params[position].check(value.clone()).map_err(|e| format!("{key} {e}"))?;
        self.turn_on(index)[position] = Track::constant(value);
        Ok(())
    }

    fn try_set(&mut self, key: &str, value: &str) -> Result<(), String> {
        if key == "fidelity" {
            self.fidelity = fidelity(value)?;
            return Ok(());
        }
        let Some((name, param)) = key.split_once('.') else {
            let index = effect(key)?;
            match value {
                "on" => _ = self.turn_on(index),
                "off" => self.turn_off(index),
                word if EFFECTS[index].words().contains(&word) => {
                    self.turn_on(index)[0] = Track::parse(&EFFECTS[index].params[0], word)?;
                }
                _ => {
                    let words: String =
                        EFFECTS[index].words().iter().map(|word| format!("{word}, ")).collect();
                    return Err(format!(
                        "{key} is {words}on or off; its parameters are {}",
                        param_names(&EFFECTS[index])
                    ));
                }
            }
            return Ok(());
        };
        let index = effect(name)?;
        let position = position(&EFFECTS[index], param)?;
        let track =
            Track::parse(&EFFECTS[index].params[position], value).map_err(|e| format!("{key} {e}"))?;
        self.turn_on(index)[position] = track;
        Ok(())
    }
}

type Fault = (Range<usize>, String);

fn read_entry(
    weather: &mut Weather,
    key: &Spanned<std::borrow::Cow<'_, str>>,
    value: &Spanned<DeValue<'_>>,
) -> Result<(), Fault> {
    let name = key.get_ref().as_ref();
    let span = value.span();
    let text =
        || value.get_ref().as_str().ok_or_else(|| (value.span(), format!("{name} must be a text in quotes")));
    match name {
        "name" => text()?.clone_into(&mut weather.name),
        "about" => text()?.clone_into(&mut weather.about),
        "fidelity" => weather.fidelity = fidelity(text()?).map_err(|problem| (span, problem))?,
        _ => {
            let index = effect(name).map_err(|problem| (key.span(), problem))?;
            let words = EFFECTS[index].words();
            let Some(table) = value.get_ref().as_table() else {
                if let Some(word) = value.get_ref().as_str().filter(|word| words.contains(word)) {
                    weather.turn_on(index)[0] =
                        Track::parse(&EFFECTS[index].params[0], word).map_err(|problem| (span, problem))?;
                    return Ok(());
                }
                let or = if words.is_empty() {
                    String::new()
                } else {
                    format!("one of {}, or ", words.join(", "))
                };
                let problem = format!("{name} must be {or}a table: write [{name}] and its parameters below");
                return Err((span, problem));
            };
            let tracks = weather.turn_on(index);
            for (key, value) in table {
                let name = key.get_ref().as_ref();
                let position = position(&EFFECTS[index], name).map_err(|problem| (key.span(), problem))?;
                tracks[position] = track(&EFFECTS[index].params[position], value)
                    .map_err(|(span, problem)| (span, format!("{}.{name} {problem}", EFFECTS[index].name)))?;
            }
        }
    }
    Ok(())
}

fn track(param: &Param, value: &Spanned<DeValue<'_>>) -> Result<Track, Fault> {
    let Some(table) = value.get_ref().as_table() else {
        let read = read_value(param, value.get_ref()).map_err(|problem| (value.span(), problem))?;
        return Ok(Track::constant(read));
    };
    let form = || "must be a value or { keys = [[seconds, value, easing], ...] }".to_owned();
    if let Some((key, _)) = table.iter().find(|(key, _)| key.get_ref() != "keys") {
        return Err((
            key.span(),
            format!("has no `{}`: keyframes are {{ keys = [[seconds, value, easing], ...] }}", key.get_ref()),
        ));
    }
    let list = table.get("keys").and_then(|list| list.get_ref().as_array());
    let list = list.ok_or_else(|| (value.span(), form()))?;
    let mut keys = Vec::new();
    for item in list {
        let (time, at, easing) = match item.get_ref().as_array().map(|parts| &parts[..]) {
            Some([time, at]) => (time, at, None),
            Some([time, at, easing]) => (time, at, Some(easing)),
            _ => return Err((item.span(), form())),
        };
        keys.push(Keyframe {
            time: number(time.get_ref()).ok_or_else(|| (time.span(), form()))?,
            value: read_value(param, at.get_ref()).map_err(|problem| (at.span(), problem))?,
            easing: easing.map_or(Ok(Easing::default()), read_easing)?,
        });
    }
    Track::keyframes(param, keys).map_err(|problem| (value.span(), problem))
}

fn read_easing(value: &Spanned<DeValue<'_>>) -> Result<Easing, Fault> {
    let text = value.get_ref().as_str();
    let text = text.ok_or_else(|| (value.span(), "has an easing that is no text in quotes".to_owned()))?;
    Easing::parse(text).map_err(|problem| (value.span(), problem))
}

fn read_value(param: &Param, value: &DeValue<'_>) -> Result<ParamValue, String> {
    let wrong = || format!("must be {}", param.expected());
    let read = match value {
        DeValue::String(text) => return param.parse(text),
        DeValue::Array(list) => {
            let parts: Option<Vec<f64>> = list.iter().map(|part| number(part.get_ref())).collect();
            ParamValue::Color(parts.and_then(|parts| parts.try_into().ok()).ok_or_else(wrong)?)
        }
        other => ParamValue::Number(number(other).filter(|number| !number.is_nan()).ok_or_else(wrong)?),
    };
    param.check(read)
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) => {
            i64::from_str_radix(integer.as_str(), integer.radix()).ok().map(|v| v as f64)
        }
        _ => None,
    }
}

fn fidelity(text: &str) -> Result<Fidelity, String> {
    Fidelity::ALL
        .into_iter()
        .find(|fidelity| fidelity.name() == text)
        .ok_or_else(|| format!("there is no fidelity `{text}`: use physical or paper"))
}

fn effect(name: &str) -> Result<usize, String> {
    let names = EFFECTS.iter().map(|effect| effect.name);
    names.clone().position(|known| known == name).ok_or_else(|| {
        let all = names.clone().collect::<Vec<_>>().join(", ");
        let keys = names.chain(["name", "about", "fidelity"]);
        format!("there is no `{name}`{}; the effects are {all}", meant(name, keys))
    })
}

fn position(effect: &Effect, name: &str) -> Result<usize, String> {
    effect.param(name).ok_or_else(|| {
        let near = meant(name, effect.params.iter().map(|param| param.name));
        format!("{} has no `{name}`{near}; it has {}", effect.name, param_names(effect))
    })
}

fn param_names(effect: &Effect) -> String {
    effect.params.iter().map(|param| param.name).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests;
