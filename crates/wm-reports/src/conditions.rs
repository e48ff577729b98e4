//! The weather at one instant as reports of any kind tell it, and the way from there into a weather
//! file.
//!
//! Visibility is shared out: what falls takes its part by the program's own laws of extinction, and
//! the air has the rest, `sigma_air = max(0, 2.996 / visibility - sigma_precipitation)`.

use crate::draft::{Basis, Datum, Draft, rounded};
use crate::optics::{extinction, snow_rate, visibility};
use wm_weather::optics::sigma_of_mor;

/// Rates of light, moderate, heavy and violent precipitation; that of hail in mm/h of water.
pub(crate) const RAIN_RATES_MM_H: [f64; 4] = [1.0, 5.0, 20.0, 60.0];
pub(crate) const SHOWER_RATES_MM_H: [f64; 4] = [2.0, 8.0, 30.0, 80.0];
pub(crate) const DRIZZLE_RATES_MM_H: [f64; 4] = [0.1, 0.3, 0.8, 1.0];
pub(crate) const HAIL_RATES_MM_H: [f64; 4] = [5.0, 20.0, 60.0, 100.0];
/// Ranges of light to violent snow, in mm/h of water, and a usual rate of each.
pub(crate) const SNOW_RATES_MM_H: [([f64; 2], f64); 4] =
    [([0.1, 1.0], 0.4), ([1.0, 2.5], 1.6), ([2.5, 8.0], 4.0), ([4.0, 10.0], 6.0)];
/// Flashes a minute of thunderstorms, by their strength, and their distance, m.
pub(crate) const FLASHES_PER_MINUTE: [f64; 4] = [4.0, 6.0, 10.0, 15.0];
pub(crate) const STORM_DISTANCE_M: f64 = 3000.0;

/// The particles that make the air turbid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// Fog and mist.
    Droplets,
    Haze,
    Smoke,
    Dust,
    Ash,
}

impl Carrier {
    fn effect(self) -> &'static str {
        match self {
            Self::Droplets => "fog",
            Self::Haze => "haze",
            Self::Smoke | Self::Dust | Self::Ash => "smog",
        }
    }

    /// Usual visibility, m.
    fn usual_visibility(self) -> f64 {
        match self {
            Self::Droplets => 300.0,
            Self::Haze => 4000.0,
            Self::Smoke | Self::Dust => 1500.0,
            Self::Ash => 2000.0,
        }
    }
}

/// Falling snow: a stated rate, or one of a range that the visibility chooses.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum SnowRate {
    Told(Datum),
    ByVisibility { range: [f64; 2], usual: f64, text: String },
}

/// Wind.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ReportedWind {
    pub(crate) speed: Option<Datum>,
    /// Direction it comes from, degrees from north.
    pub(crate) from: Option<Datum>,
    /// Standard deviation of the speed as a share of it.
    pub(crate) gusts: Option<Datum>,
}

/// The sun.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Sun {
    /// The sun of the photos, or clouds.
    #[default]
    Auto,
    /// Elevation and azimuth, degrees.
    At { elevation: f64, azimuth: Option<f64>, turbidity: Option<f64>, basis: Basis },
    /// By mean solar time, h, latitude, degrees, and day of the year.
    Hour { hour: Datum, latitude: f64, day: Option<u32> },
    /// Night.
    Night(Basis),
}

/// The weather at one instant. `None` is not known.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Conditions {
    /// mm/h of water.
    pub(crate) rain: Option<Datum>,
    pub(crate) snow: Option<SnowRate>,
    pub(crate) hail: Option<Datum>,
    /// Factor on the size of stones.
    pub(crate) hail_size: Option<Datum>,
    /// Visibility, m.
    pub(crate) visibility: Option<Datum>,
    pub(crate) carrier: Option<(Carrier, Basis)>,
    /// Fog below 2 m, under air of the stated visibility.
    pub(crate) shallow_fog: Option<Basis>,
    pub(crate) wind: ReportedWind,
    /// Cloud cover, 0-1.
    pub(crate) clouds: Option<Datum>,
    /// Flashes a minute, and their distance, m.
    pub(crate) lightning: Option<(Datum, f64)>,
    /// Temperature, degrees Celsius.
    pub(crate) temperature: Option<Datum>,
    /// Relative humidity, 0-1.
    pub(crate) humidity: Option<Datum>,
    /// Lying snow, m.
    pub(crate) snow_depth: Option<Datum>,
    /// Minutes of rain before, its rate, mm/h, and minutes since it stopped.
    pub(crate) rained: Option<([f64; 3], Basis)>,
    /// Wetness of the ground and share of full puddles, 0-1.
    pub(crate) wetness: Option<Datum>,
    pub(crate) puddles: Option<Datum>,
    pub(crate) sun: Sun,
}

/// Height of shallow fog, m, and its visibility at the ground, m.
const SHALLOW_FOG: [f64; 2] = [2.0, 150.0];
/// Visibility of clear air, m.
pub(crate) const CLEAR_VISIBILITY_M: f64 = 100_000.0;

impl Conditions {
    /// Writes everything into a weather file.
    pub(crate) fn write(&self, draft: &mut Draft) {
        let snow = self.snow_rate();
        self.write_light(draft);
        self.write_wind(draft);
        self.write_air(draft, snow.as_ref().map_or(0.0, |snow| snow.value));
        if let Some(rain) = &self.rain {
            draft.number("rain.rate", rain.value, rain.basis.clone());
            let (exposure, why) = if self.is_dark() {
                (0.01, "a shutter of 1/100 s, as by night")
            } else {
                (0.004, "a shutter of 1/250 s, as by day")
            };
            draft.number("rain.exposure", exposure, Basis::guess(why));
            draft.word("splash.amount", "auto", Basis::told("as in nature"));
        }
        draft.datum("snowfall.rate", snow.as_ref());
        draft.datum("hail.rate", self.hail.as_ref());
        draft.datum("hail.size", self.hail_size.as_ref().filter(|_| self.hail.is_some()));
        self.write_ground(draft);
    }

    /// The rate of snow that falls.
    fn snow_rate(&self) -> Option<Datum> {
        match self.snow.as_ref()? {
            SnowRate::Told(known) => Some(known.clone()),
            SnowRate::ByVisibility { range, usual, text } => {
                let is_foggy = matches!(self.carrier, Some((Carrier::Droplets, Basis::Told(_))));
                let [least, most] = range;
                let Some(seen) = &self.visibility else {
                    let why = format!("{text}: {least} to {most} mm/h, and no visibility is told");
                    return Some(Datum::guess(*usual, why));
                };
                let others = self.rain.as_ref().map_or(0.0, |rain| extinction("rain", rain.value));
                let sigma = (sigma_of_mor(seen.value) - others).max(0.0);
                if is_foggy {
                    let rate = snow_rate(0.5 * sigma, *range).min(*usual);
                    let why = format!(
                        "{text}: {least} to {most} mm/h; at most half of the visibility is taken for snow, as there is fog"
                    );
                    return Some(Datum::guess(rate, why));
                }
                let rate = snow_rate(sigma, *range);
                let why =
                    format!("{text} at a visibility of {} m: {least} to {most} mm/h", seen.value.round());
                Some(Datum { value: rate, basis: seen.basis.with_text(why) })
            }
        }
    }

    /// Returns true if the report says that the sun is down.
    fn is_dark(&self) -> bool {
        match &self.sun {
            Sun::Night(_) => true,
            Sun::At { elevation, .. } => *elevation < 0.0,
            Sun::Auto | Sun::Hour { .. } => false,
        }
    }

    fn write_light(&self, draft: &mut Draft) {
        match &self.sun {
            Sun::Auto => {
                draft.word("light.model", "auto", Basis::told("the light of the photos under this weather"));
            }
            Sun::At { elevation, azimuth, turbidity, basis } => {
                draft.word("light.model", "clear", Basis::told("a sun and a sky of its own"));
                draft.number("light.sun_elevation", *elevation, basis.clone());
                for (key, value) in [("light.sun_azimuth", azimuth), ("light.turbidity", turbidity)] {
                    if let Some(value) = value {
                        draft.number(key, *value, basis.clone());
                    }
                }
                if *elevation < 2.0 {
                    draft.word("light.lamps", "path", lamps());
                }
            }
            Sun::Hour { hour, latitude, day } => {
                draft.word("light.model", "clear", Basis::told("a sun and a sky of its own"));
                draft.number("light.hour", hour.value, hour.basis.clone());
                draft.number("light.latitude", *latitude, Basis::told("of the place"));
                let no_month = Basis::guess("no month is told: that of the photos");
                match day {
                    Some(day) => draft.number("light.day", f64::from(*day), Basis::told("of the year")),
                    None => draft.word("light.day", "auto", no_month),
                }
                draft.word("light.lamps", "path", lamps());
            }
            Sun::Night(basis) => {
                draft.word("light.model", "night", basis.clone());
                draft.word("light.lamps", "path", lamps());
            }
        }
        draft.datum("light.clouds", self.clouds.as_ref());
        if let Some((rate, distance)) = &self.lightning {
            draft.number("lightning.rate", rate.value, rate.basis.clone());
            draft.number("lightning.distance", *distance, Basis::guess("no report has the distance"));
        }
    }

    fn write_wind(&self, draft: &mut Draft) {
        draft.datum("wind.speed", self.wind.speed.as_ref());
        let Some(speed) = self.wind.speed.as_ref().map(|speed| speed.value).filter(|speed| *speed > 0.0)
        else {
            return;
        };
        match &self.wind.from {
            Some(from) => {
                let (to, text) = (heading(from.value), from.basis.text());
                let why = format!("{text}: it blows to {to} degrees; north is taken for the scene's x axis");
                draft.number("wind.direction", to, from.basis.with_text(why));
            }
            None => {
                let why = format!("no direction of the {speed:.1} m/s is told");
                draft.number("wind.direction", 90.0, Basis::guess(why));
            }
        }
        draft.datum("wind.gusts", self.wind.gusts.as_ref());
    }

    fn write_air(&self, draft: &mut Draft, snow: f64) {
        if let Some(basis) = &self.shallow_fog {
            let [height, mor] = SHALLOW_FOG;
            draft.number("fog.mor", mor, Basis::guess(format!("at the ground; {}", basis.text())));
            draft.number("fog.scale_height", height, Basis::told(format!("{}: fog below 2 m", basis.text())));
        }
        let falls = self.rain.as_ref().map_or(0.0, |rain| extinction("rain", rain.value))
            + extinction("snowfall", snow)
            + self.hail.as_ref().map_or(0.0, |hail| extinction("hail", hail.value));
        let (carrier, why) = self.carrier_or_guess(falls);
        let Some(seen) = &self.visibility else {
            if let Some((carrier, basis)) = &self.carrier {
                let key = format!("{}.mor", carrier.effect());
                let why = format!("{}, without a visibility", basis.text());
                draft.number(&key, carrier.usual_visibility(), Basis::guess(why));
                tint(draft, *carrier);
            }
            return;
        };
        let sigma = sigma_of_mor(seen.value) - falls;
        let mor = if sigma > 0.0 { visibility(sigma) } else { f64::INFINITY };
        // Beyond this, what falls explains the visibility but for the digits of the report.
        if mor > CLEAR_VISIBILITY_M {
            let alone = visibility(falls);
            // By the digits of a report.
            if alone < 0.97 * seen.value {
                draft.ignored(format!(
                    "visibility of {:.0} m ({}): what falls leaves {alone:.0} m by itself, so that nothing else is in the air",
                    seen.value,
                    seen.basis.text()
                ));
            }
            return;
        }
        // Shallow fog has the table of fog; what is above it is as dry as it can be.
        let carrier =
            if self.shallow_fog.is_some() && carrier == Carrier::Droplets { Carrier::Haze } else { carrier };
        let share = if falls > 0.0 { ", less what falls" } else { "" };
        let text = format!("visibility {:.0} m ({}){share}; {why}", seen.value, seen.basis.text());
        draft.number(&format!("{}.mor", carrier.effect()), mor.max(1.0), seen.basis.with_text(text));
        tint(draft, carrier);
    }

    fn carrier_or_guess(&self, falls: f64) -> (Carrier, String) {
        if let Some((carrier, basis)) = &self.carrier {
            return (*carrier, basis.text().to_owned());
        }
        let seen = self.visibility.as_ref().map_or(f64::INFINITY, |seen| seen.value);
        let is_damp = self.humidity.as_ref().is_some_and(|humidity| humidity.value >= 0.9);
        if seen < 1000.0 || (seen < 5000.0 && (falls > 0.0 || is_damp)) {
            (Carrier::Droplets, "taken for droplets".into())
        } else {
            (Carrier::Haze, "taken for haze".into())
        }
    }

    fn write_ground(&self, draft: &mut Draft) {
        let snow_falls = self.snow.is_some();
        let degrees = self.temperature.as_ref().map(|temperature| temperature.value);
        let stays = snow_falls && degrees.is_none_or(|degrees| degrees <= 0.0);
        if self.snow_depth.is_some() {
            draft.datum("snow_cover.depth", self.snow_depth.as_ref());
        } else if stays {
            let why = "the report does not know what lies: what has fallen";
            draft.word("snow_cover.depth", "auto", Basis::guess(why));
            draft.number("snow_cover.hours", 1.0, Basis::guess("it has snowed for an hour"));
        } else if snow_falls {
            draft.ignored("lying snow: the report does not know it, and above 0 degrees none is guessed");
        }
        let lies = self.snow_depth.is_some() || stays;
        draft.datum("snow_cover.temperature", self.temperature.as_ref().filter(|_| lies));
        let is_wet =
            self.rain.is_some() || self.rained.is_some() || self.wetness.is_some() || self.puddles.is_some();
        if !is_wet {
            return;
        }
        draft.datum("wetness.amount", self.wetness.as_ref());
        draft.datum("wetness.puddles", self.puddles.as_ref());
        if let Some(([minutes, rate, stopped], basis)) = &self.rained {
            draft.number("wetness.rained_before", *minutes, basis.clone());
            draft.number("wetness.rate_before", *rate, basis.clone());
            draft.number("wetness.stopped", *stopped, basis.clone());
        } else if self.rain.is_some() && self.wetness.is_none() {
            draft.number("wetness.rained_before", 15.0, Basis::guess("minutes that it has rained so far"));
        }
        draft.datum("wetness.temperature", self.temperature.as_ref());
        draft.datum("wetness.humidity", self.humidity.as_ref());
    }

    /// The weather in one line.
    pub(crate) fn summary(&self) -> String {
        let mut parts = Vec::new();
        for (name, rate) in [("rain", &self.rain), ("snow", &self.snow_rate()), ("hail", &self.hail)] {
            parts.extend(rate.as_ref().map(|rate| format!("{name} {} mm/h", rounded(rate.value, 3))));
        }
        if self.lightning.is_some() {
            parts.push("lightning".into());
        }
        if let Some(seen) = &self.visibility {
            parts.push(format!("visibility {:.0} m", seen.value));
        }
        if let Some(depth) = &self.snow_depth {
            parts.push(format!("{:.2} m of snow lie", depth.value));
        }
        match (&self.wind.speed, &self.wind.from) {
            (Some(speed), _) if speed.value <= 0.0 => parts.push("calm".into()),
            (Some(speed), Some(from)) => {
                parts.push(format!("wind {:.1} m/s from {:.0} degrees", speed.value, from.value));
            }
            (Some(speed), None) => parts.push(format!("wind {:.1} m/s", speed.value)),
            _ => {}
        }
        if let Some(clouds) = &self.clouds {
            parts.push(format!("clouds {:.0} %", 100.0 * clouds.value));
        }
        if let Some(temperature) = &self.temperature {
            parts.push(format!("{:.0} degrees", temperature.value));
        }
        parts.join(", ")
    }
}

/// The direction that a wind from a direction blows to, degrees, 0 to 360.
pub(crate) fn heading(from: f64) -> f64 {
    (from + 180.0).rem_euclid(360.0)
}

pub(crate) fn lamps() -> Basis {
    Basis::guess("lamps stand along the path of the photos; \"auto\" for those that the scene states")
}

/// The colours of smog, dust and ash.
pub(crate) fn tint(draft: &mut Draft, carrier: Carrier) {
    let (albedo, color, angstrom, why) = match carrier {
        Carrier::Dust => (0.9, "#e3cba9", 0.3, "as airborne dust of the weather `sandstorm`"),
        Carrier::Ash => (0.8, "#c4c0bb", 0.0, "grey ash"),
        _ => return,
    };
    let basis = || Basis::guess(why);
    draft.number("smog.albedo", albedo, basis());
    draft.word("smog.tint", color, basis());
    draft.number("smog.angstrom", angstrom, basis());
}
