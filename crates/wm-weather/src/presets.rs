//! Weathers by name: the files of `presets/`, built in.

use crate::file::WeatherError;
use crate::param::meant;
use crate::weather::Weather;
use std::path::Path;
use wm_base::error::escaped;

macro_rules! presets {
    ($($name:literal),+ $(,)?) => {
        /// Names and texts of the presets, in the order in which they are listed.
        pub const PRESETS: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../presets/", $name, ".toml")))),+];
    };
}

presets! {
    "clear", "mist", "fog", "dense-fog", "ground-fog", "fog-closing-in", "haze", "smog",
    "drizzle", "moderate-rain", "heavy-rain", "violent-rain", "after-rain", "light-snow", "snow", "blizzard", "sleet", "hail",
    "sandstorm", "flood", "rain-to-snow", "snow-covered", "first-snow", "thaw",
    "overcast", "sunny", "golden-hour", "broken-clouds", "night", "night-fog", "night-rain", "night-snow",
    "thunderstorm", "sun-to-night", "film-rain", "film-rain-night", "rain-on-windscreen", "rain-on-lens",
}

impl Weather {
    /// Returns the preset of a name.
    ///
    /// ```
    /// let weather = wm_weather::Weather::preset("fog")?;
    /// assert_eq!(weather.effects().count(), 2);
    /// # Ok::<(), wm_weather::WeatherError>(())
    /// ```
    ///
    /// # Errors
    /// [`WeatherError::Unknown`] with the nearest names if there is none.
    pub fn preset(name: &str) -> Result<Self, WeatherError> {
        match PRESETS.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Self::parse(text, name),
            None => Err(unknown(name, "")),
        }
    }

    /// Returns the preset of a name, or reads the file of that path.
    ///
    /// # Errors
    /// [`WeatherError`] if there is neither, or the file is wrong.
    pub fn find(name: &str) -> Result<Self, WeatherError> {
        if PRESETS.iter().any(|(known, _)| *known == name) {
            return Self::preset(name);
        }
        let path = Path::new(name);
        if path.extension().is_none() && !path.exists() {
            return Err(unknown(name, ", or give a .toml file"));
        }
        Self::read(path)
    }
}

fn unknown(name: &str, otherwise: &str) -> WeatherError {
    let names: Vec<&str> = PRESETS.iter().map(|(name, _)| *name).collect();
    let near = meant(name, names.iter().copied());
    let all = names.join(", ");
    WeatherError::Unknown(escaped(&format!(
        "there is no weather `{name}`{near}; the presets are {all}{otherwise}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_right_and_says_what_it_is() {
        for (name, _) in PRESETS {
            let weather = Weather::preset(name).unwrap();
            assert_eq!(&weather.name, name);
            assert!(!weather.about.is_empty(), "{name}");
            assert_eq!(weather.effects().next().is_none(), *name == "clear");
        }
    }

    #[test]
    fn a_misspelt_preset_gets_its_nearest() {
        let error = Weather::find("dens-fog").unwrap_err().to_string();
        assert!(error.starts_with("there is no weather `dens-fog`, did you mean `dense-fog`?;"), "{error}");
        let error = Weather::find("missing.toml").unwrap_err().to_string();
        assert_eq!(error, "missing.toml: cannot read the weather file: no such file; check the path");
    }
}
