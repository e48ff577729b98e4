//! The weather parameters of the CARLA simulator, by preset or one by one.
//!
//! | CARLA | becomes |
//! |---|---|
//! | `precipitation` P | `rain.rate` = 50 (P/100)^2.5 mm/h: 30, 60, 100 are 2.5, 14, 50 |
//! | `fog_density` D | `fog.mor` = 20000 400^(-D/100) m, none at 0 |
//! | `fog_falloff` F | `fog.scale_height` = 14.4/F m |
//! | `wind_intensity` W | `wind.speed` = W/4 m/s |
//! | `cloudiness` | `light.clouds` = 1/100 of it |
//! | `sun_altitude_angle`, `sun_azimuth_angle` | `light.sun_elevation`, `light.sun_azimuth` |
//! | `precipitation_deposits`, `wetness` | `wetness.puddles`, `wetness.amount` = 1/100 of it |
//! | `dust_storm` | dust in the air, by the law of fog |
//!
//! The intensities of CARLA have no units: these laws are a choice. `fog_distance` and the scales
//! of scattering are not used.

use crate::conditions::{Carrier, tint};
use crate::draft::{Basis, Draft, WrittenWeather};
use crate::error::{ReportError, meant, quoted};
use serde_json::Value;

const FILE: &str = "CARLA";

macro_rules! carla {
    ($($(#[doc = $meaning:literal])+ $name:ident: $least:literal to $most:expr;)+) => {
        /// Weather parameters of CARLA, in its units. `None` is not given.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct CarlaParameters {
            /// The preset that they began with.
            pub preset: Option<&'static str>,
            $($(#[doc = $meaning])+ pub $name: Option<f64>,)+
        }

        impl CarlaParameters {
            /// The names of the parameters, in the order in which CARLA takes them.
            pub(crate) const NAMES: &'static [&'static str] = &[$(stringify!($name)),+];

            /// The least and greatest value of each.
            const RANGES: &'static [[f64; 2]] = &[$([$least, $most]),+];

            fn fields(&mut self) -> Vec<&mut Option<f64>> {
                vec![$(&mut self.$name),+]
            }
        }
    };
}

carla! {
    /// Clouds, 0 to 100.
    cloudiness: 0.0 to 100.0;
    /// Rain, 0 to 100.
    precipitation: 0.0 to 100.0;
    /// Puddles, 0 to 100.
    precipitation_deposits: 0.0 to 100.0;
    /// Wind, 0 to 100.
    wind_intensity: 0.0 to 100.0;
    /// Azimuth of the sun, degrees; the presets have -1.
    sun_azimuth_angle: -360.0 to 360.0;
    /// Altitude of the sun, degrees.
    sun_altitude_angle: -90.0 to 90.0;
    /// Fog, 0 to 100.
    fog_density: 0.0 to 100.0;
    /// Distance from which on there is fog, m.
    fog_distance: -1.0 to f64::INFINITY;
    /// Speed at which fog thins upwards.
    fog_falloff: 0.0 to f64::INFINITY;
    /// Wetness of the ground, 0 to 100.
    wetness: 0.0 to 100.0;
    /// Light that fog scatters.
    scattering_intensity: 0.0 to f64::INFINITY;
    /// Light that large particles scatter.
    mie_scattering_scale: 0.0 to f64::INFINITY;
    /// Light that air scatters.
    rayleigh_scattering_scale: 0.0 to f64::INFINITY;
    /// Dust, 0 to 100.
    dust_storm: 0.0 to 100.0;
}

/// Names of presets, and the parameters of each in their order, as in CARLA 0.9.13 to 0.9.16
/// (`WeatherParameters.cpp`).
const PRESETS: &str = include_str!("carla_presets.txt");

fn presets() -> impl Iterator<Item = (&'static str, &'static str)> {
    PRESETS.lines().filter_map(|line| line.split_once(' '))
}

/// The names of CARLA's presets.
pub(crate) fn preset_names() -> impl Iterator<Item = &'static str> {
    presets().map(|(name, _)| name)
}

impl CarlaParameters {
    /// The preset of a name, as `HardRainNoon`.
    #[must_use]
    pub fn preset(name: &str) -> Option<Self> {
        let (name, values) = presets().find(|(known, _)| *known == name)?;
        Some(Self { preset: Some(name), ..Self::parse(values).ok()? })
    }

    /// Reads a preset's name, JSON, or `name=value` pairs as Python writes them, with or without
    /// the word `CARLA`.
    ///
    /// # Errors
    /// [`ReportError`] with the parameter and what is expected.
    pub fn parse(text: &str) -> Result<Self, ReportError> {
        let mut text = text.trim();
        // The module of Python, too.
        if let Some(rest) = ["CARLA", "Carla", "carla"].iter().find_map(|word| text.strip_prefix(word)) {
            text = rest.trim_start_matches(['.', ':', ' ', '\t', '\n', '\r']);
        }
        if text.starts_with('{') {
            return Self::of_json(text);
        }
        let text = text.strip_prefix("WeatherParameters").unwrap_or(text).trim_start_matches('.').trim();
        let text = text.strip_prefix('(').map_or(text, |rest| rest.strip_suffix(')').unwrap_or(rest));
        let mut found = Self::default();
        let mut place = 0;
        let mut has_any = false;
        // Pairs are parted by commas or by space, and a pair may have space about its sign.
        let joined = text.replace(" =", "=").replace("= ", "=").replace(" :", ":").replace(": ", ":");
        for part in joined.split([',', ';', ' ', '\t', '\n', '\r']).filter(|part| !part.is_empty()) {
            has_any = true;
            if let Some((name, value)) = part.split_once(['=', ':']) {
                let name = name.trim_matches(['"', '\'']);
                let value = value
                    .parse()
                    .map_err(|_| Self::fault(name, format!("is {}: must be a number", quoted(value))))?;
                found.set(name, value)?;
            } else if let Ok(value) = part.parse::<f64>() {
                // As Python's call without names.
                let Some(name) = Self::NAMES.get(place) else {
                    let most = Self::NAMES.len();
                    let problem = format!("is one number too many: there are {most} parameters");
                    return Err(Self::fault(part, problem));
                };
                found.set(name, value)?;
                place += 1;
            } else if let Some(preset) = Self::preset(part) {
                found = preset;
            } else {
                let known = preset_names().chain(Self::NAMES.iter().copied());
                let problem = format!("is no preset or parameter{}", meant(part, known));
                return Err(Self::fault(&quoted(part), problem));
            }
        }
        if has_any {
            Ok(found)
        } else {
            Err(Self::fault("text", "is empty: a preset as HardRainNoon, or cloudiness=80"))
        }
    }

    fn of_json(text: &str) -> Result<Self, ReportError> {
        let whole = |problem: String| ReportError::Whole { file: FILE.into(), problem };
        let json: Value =
            serde_json::from_str(text).map_err(|error| whole(format!("is no JSON: {error}")))?;
        let map = json
            .as_object()
            .ok_or_else(|| whole("must be an object of JSON, as {\"cloudiness\": 80}".into()))?;
        let mut found = Self::default();
        for (name, value) in map {
            let value = value.as_f64().ok_or_else(|| Self::fault(name, "must be a number"))?;
            found.set(name, value)?;
        }
        Ok(found)
    }

    fn fault(key: &str, problem: impl Into<String>) -> ReportError {
        ReportError::Value { file: FILE.into(), key: key.into(), problem: problem.into() }
    }

    /// Returns true if a name is a parameter, or near enough to be a misspelt one.
    pub(crate) fn is_named(name: &str) -> bool {
        let name = name.replace('_', "").to_ascii_lowercase();
        let known: Vec<String> = Self::NAMES.iter().map(|known| known.replace('_', "")).collect();
        known.contains(&name) || !meant(&name, known.iter().map(String::as_str)).is_empty()
    }

    /// Sets a parameter by its name in Python or in Unreal (`FogDensity`).
    fn set(&mut self, name: &str, value: f64) -> Result<(), ReportError> {
        let plain = |name: &str| name.replace('_', "").to_ascii_lowercase();
        let place = Self::NAMES.iter().position(|known| plain(known) == plain(name)).ok_or_else(|| {
            let near = meant(name, Self::NAMES.iter().copied());
            let problem = format!("is no parameter of CARLA{near}; they are {}", Self::NAMES.join(", "));
            Self::fault(&quoted(name), problem)
        })?;
        let [least, most] = Self::RANGES[place];
        if !(least..=most).contains(&value) {
            return Err(Self::fault(Self::NAMES[place], format!("is {value}: must be {least} to {most}")));
        }
        if let Some(field) = self.fields().into_iter().nth(place) {
            *field = Some(value);
        }
        Ok(())
    }

    /// Rain, mm/h of water.
    #[must_use]
    pub fn rain_rate(&self) -> f64 {
        50.0 * (self.precipitation.unwrap_or(0.0) / 100.0).powf(2.5)
    }

    /// Visibility in fog of a density, 0 to 100, m; `None` for no fog.
    #[must_use]
    pub fn visibility(density: f64) -> Option<f64> {
        (density > 0.0).then(|| 20_000.0 * 400f64.powf(-density / 100.0))
    }
}

pub(crate) fn read(text: &str) -> Result<(CarlaParameters, WrittenWeather), ReportError> {
    let parameters = CarlaParameters::parse(text)?;
    let name = format!("CARLA {}", parameters.preset.unwrap_or("parameters"));
    let about = match parameters.preset {
        Some(preset) => format!("CARLA's {preset} in physical units"),
        None => "Weather parameters of CARLA in physical units".into(),
    };
    let head = vec![
        text.split_whitespace().collect::<Vec<_>>().join(" "),
        "CARLA's intensities have no units: the laws are a choice.".into(),
    ];
    let mut draft = Draft::new(&name, &about, head);
    write(&parameters, &mut draft);
    let written = draft.finish()?;
    Ok((parameters, written))
}

fn write(carla: &CarlaParameters, draft: &mut Draft) {
    let told = |name: &str, value: f64| Basis::told(format!("{name} {value}"));
    match carla.sun_altitude_angle {
        Some(elevation) => {
            draft.word("light.model", "clear", Basis::told("a sun and a sky of its own"));
            draft.number("light.sun_elevation", elevation, told("sun_altitude_angle", elevation));
            if let Some(azimuth) = carla.sun_azimuth_angle {
                draft.number("light.sun_azimuth", azimuth, told("sun_azimuth_angle", azimuth));
            }
            if elevation < 2.0 {
                draft.word("light.lamps", "path", Basis::guess("lamps stand along the path of the photos"));
            }
        }
        None => draft.word("light.model", "auto", Basis::guess("no sun is given: that of the photos")),
    }
    if let Some(clouds) = carla.cloudiness {
        draft.number("light.clouds", clouds / 100.0, told("cloudiness", clouds));
    }
    if let Some(wind) = carla.wind_intensity {
        draft.number("wind.speed", wind / 4.0, told("wind_intensity", wind));
        if wind > 0.0 {
            draft.number("wind.direction", 90.0, Basis::guess("CARLA's wind has no direction"));
        }
    }
    let density = carla.fog_density.unwrap_or(0.0);
    if let Some(mor) = CarlaParameters::visibility(density) {
        draft.number("fog.mor", mor, told("fog_density", density));
        if let Some(falloff) = carla.fog_falloff {
            let height = if falloff > 0.0 { 14.4 / falloff } else { f64::INFINITY };
            draft.number("fog.scale_height", height, told("fog_falloff", falloff));
        }
    }
    let dust = carla.dust_storm.unwrap_or(0.0);
    if let Some(mor) = CarlaParameters::visibility(dust) {
        draft.number("smog.mor", mor, told("dust_storm", dust));
        tint(draft, Carrier::Dust);
    }
    let rate = carla.rain_rate();
    let precipitation = carla.precipitation.unwrap_or(0.0);
    if rate > 0.0 {
        draft.number("rain.rate", rate, told("precipitation", precipitation));
        draft.number("rain.exposure", 0.004, Basis::guess("a shutter of 1/250 s, as by day"));
        draft.word("splash.amount", "auto", Basis::told("as in nature"));
    }
    write_water(carla, draft);
    for (name, value) in [
        ("fog_distance", carla.fog_distance),
        ("scattering_intensity", carla.scattering_intensity),
        ("mie_scattering_scale", carla.mie_scattering_scale),
        ("rayleigh_scattering_scale", carla.rayleigh_scattering_scale),
    ] {
        if let Some(value) = value {
            draft.ignored(format!("{name} {value}: not used"));
        }
    }
}

fn write_water(carla: &CarlaParameters, draft: &mut Draft) {
    let (wetness, deposits) = (carla.wetness.unwrap_or(0.0), carla.precipitation_deposits.unwrap_or(0.0));
    let rains = carla.precipitation.unwrap_or(0.0) > 0.0;
    if wetness <= 0.0 && deposits <= 0.0 && !rains {
        return;
    }
    if wetness > 0.0 {
        draft.number("wetness.amount", wetness / 100.0, Basis::told(format!("wetness {wetness}")));
    } else if rains {
        draft.number("wetness.rained_before", 15.0, Basis::guess("minutes that it has rained so far"));
    } else {
        draft.number("wetness.amount", 0.5, Basis::guess("no wetness, but puddles: damp ground about them"));
    }
    if deposits > 0.0 {
        let told = Basis::told(format!("precipitation_deposits {deposits}"));
        draft.number("wetness.puddles", deposits / 100.0, told);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hourly::tests::value;

    #[test]
    fn presets_are_weathers_of_their_laws() {
        for (name, rate, mor, wind) in [
            ("ClearNoon", None, 17_740.0, 2.5),
            ("SoftRainNoon", Some(2.465), 16_710.0, 7.5),
            ("MidRainSunset", Some(13.94), 16_710.0, 15.0),
            ("HardRainNoon", Some(50.0), 13_150.0, 25.0),
            ("HardRainNight", Some(50.0), 50.0, 25.0),
        ] {
            let (_, written) = read(&format!("CARLA {name}")).unwrap();
            let weather = &written.weather;
            assert_eq!(value(weather, "rain.rate"), rate, "{name}\n{}", written.toml);
            let seen = value(weather, "fog.mor").unwrap();
            assert!((seen / mor - 1.0).abs() < 1e-3, "{name}: {seen}");
            assert_eq!(value(weather, "wind.speed"), Some(wind));
        }
        for name in preset_names() {
            let mut preset = CarlaParameters::preset(name).unwrap();
            assert!(preset.fields().iter().all(|field| field.is_some()), "{name}");
        }
        let (_, dust) = read("carla.WeatherParameters.DustStorm").unwrap();
        assert_eq!(value(&dust.weather, "smog.mor"), Some(50.0));
    }

    #[test]
    fn parameters_are_read_as_json_pairs_and_python() {
        let want = CarlaParameters { cloudiness: Some(80.0), fog_falloff: Some(0.2), ..Default::default() };
        for text in [
            "CARLA cloudiness=80 fog_falloff=0.2",
            "{\"cloudiness\": 80, \"fog_falloff\": 0.2}",
            "WeatherParameters(cloudiness=80.000000, fog_falloff=0.200000)",
            "carla Cloudiness = 80, FogFalloff: 0.2",
        ] {
            assert_eq!(CarlaParameters::parse(text).unwrap(), want, "{text}");
        }
        let positional = CarlaParameters::parse("carla.WeatherParameters(60.0,30.0)").unwrap();
        assert_eq!((positional.cloudiness, positional.precipitation), (Some(60.0), Some(30.0)));
        let changed = CarlaParameters::parse("CARLA HardRainNoon fog_density=40").unwrap();
        assert_eq!((changed.preset, changed.fog_density), (Some("HardRainNoon"), Some(40.0)));
        for (text, error) in [
            (
                "CARLA HardRainNon",
                "CARLA: `HardRainNon` is no preset or parameter, did you mean `HardRainNoon`?",
            ),
            ("CARLA cloudiness=180", "CARLA: cloudiness is 180: must be 0 to 100"),
            (
                "CARLA cloudines=8",
                "CARLA: `cloudines` is no parameter of CARLA, did you mean `cloudiness`?; they are",
            ),
            ("CARLA wetness=nan", "CARLA: wetness is NaN: must be 0 to 100"),
            ("CARLA", "CARLA: text is empty"),
        ] {
            let got = CarlaParameters::parse(text).unwrap_err().to_string();
            assert!(got.starts_with(error), "{text}: {got}");
        }
    }
}
