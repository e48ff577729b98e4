//! The weather of a table.

use super::table::{WeatherRow, WeatherTable};
use super::time;
use crate::conditions::{CLEAR_VISIBILITY_M, heading, lamps};
use crate::draft::{Basis, Draft, WrittenWeather};
use crate::error::ReportError;
use crate::optics::{extinction, visibility};
use crate::options::ReportOptions;
use crate::present_weather::PresentAir;
use std::f64::consts::TAU;
use wm_weather::Easing;
use wm_weather::optics::sigma_of_mor;

/// Visibility of hours whose code does not tell it, m.
const USUAL_VISIBILITY_M: f64 = 20_000.0;
/// Least wind for which gusts are read, m/s.
const MIN_GUSTY_WIND_M_S: f64 = 1.0;
/// Net radiation by night, W/m^2.
const NIGHT_RADIATION_W_M2: f64 = -30.0;

pub(crate) fn weather(
    table: &WeatherTable,
    name: &str,
    options: &ReportOptions,
) -> Result<WrittenWeather, ReportError> {
    let Some((first, last)) = table.rows.first().zip(table.rows.last()) else {
        return Err(ReportError::Whole { file: name.into(), problem: "has no rows".into() });
    };
    let begin = first.time - (3600.0 * table.step) as i64;
    let about = format!(
        "{:.0} hours until {} UTC in {} s: {:.1} mm of rain, {:.1} mm of snow",
        table.hours(),
        time::written(last.time),
        table.hours() * options.seconds_per_hour,
        table.rain_sum(),
        table.snow_sum()
    );
    let head = vec![
        format!("Second 0 is {} UTC, an hour takes {} s.", time::written(begin), options.seconds_per_hour),
        "Seeds are 0: wind.seed, rain.seed and the like give other gusts and drops.".into(),
    ];
    let mut film = Film {
        table,
        scale: options.seconds_per_hour,
        place: table.place.or(options.place),
        draft: Draft::new(name, &about, head),
    };
    film.light(begin);
    film.wind();
    film.air();
    film.falls();
    film.ground();
    let mut draft = film.draft;
    for note in &table.notes {
        draft.note(note.kind, note.text.clone());
    }
    if (table.step - 1.0).abs() > 1e-9 {
        let step = format!("hours: rows are {:.2} hours apart", table.step);
        draft.ignored(format!("{step}, and amounts count for all that time"));
    }
    draft.finish()
}

struct Film<'a> {
    table: &'a WeatherTable,
    /// Seconds of the shot in an hour.
    scale: f64,
    /// Latitude and longitude, degrees.
    place: Option<[f64; 2]>,
    draft: Draft,
}

impl Film<'_> {
    /// Seconds of the shot in the step of a row.
    fn step(&self) -> f64 {
        self.scale * self.table.step
    }

    /// Keys at the times of rows; rows without a value are left out.
    fn at_rows(&self, value: impl Fn(&WeatherRow) -> Option<f64>) -> Vec<(f64, f64)> {
        let rows = self.table.rows.iter().enumerate();
        rows.filter_map(|(index, row)| Some(((index + 1) as f64 * self.step(), value(row)?))).collect()
    }

    /// Keys at the beginnings of the steps of rows.
    fn over_steps(&self, value: impl Fn(&WeatherRow) -> f64) -> Vec<(f64, f64)> {
        let rows = self.table.rows.iter().enumerate();
        rows.map(|(index, row)| (index as f64 * self.step(), value(row))).collect()
    }

    fn mean(&self, value: impl Fn(&WeatherRow) -> Option<f64>) -> Option<f64> {
        let values: Vec<f64> = self.table.rows.iter().filter_map(value).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }

    fn light(&mut self, begin: i64) {
        match self.place {
            Some([latitude, longitude]) => {
                // Mean solar time.
                let solar = begin as f64 + 240.0 * longitude;
                let days = (solar / 86_400.0).floor();
                let hour = (solar - 86_400.0 * days) / 3600.0;
                let end = (self.table.hours() * self.scale, hour + self.table.hours());
                let why = "the sun of the place, by day and night";
                self.draft.word("light.model", "clear", Basis::told(why));
                let why = format!("mean solar time at longitude {longitude}");
                self.draft.track("light.hour", &[(0.0, hour), end], Easing::Linear, Basis::told(why));
                let day = time::day_of_year(days as i64) as f64;
                self.draft.number("light.day", day, Basis::told("of the year, at the start"));
                self.draft.number("light.latitude", latitude, Basis::told("of the table"));
                self.draft.word("light.lamps", "path", lamps());
            }
            None => {
                let why = "the table has no place: the sun of the photos";
                self.draft.word("light.model", "auto", Basis::guess(why));
            }
        }
        let clouds = self.at_rows(|row| row.cloud_cover);
        self.draft.track("light.clouds", &clouds, Easing::Linear, Basis::told("cloud cover"));
        let flashes = self.over_steps(|row| row.present_weather().map_or(0.0, |code| code.lightning));
        if flashes.iter().any(|(_, rate)| *rate > 0.0) {
            let why = "flashes a minute of the shot, by the code of the hour";
            self.draft.track("lightning.rate", &flashes, Easing::Hold, Basis::guess(why));
        }
        if self.table.rows.iter().filter_map(WeatherRow::present_weather).any(|code| code.hail > 0.0) {
            self.draft.ignored("hail of some codes: the amounts of the table are rain and snow");
        }
    }

    fn wind(&mut self) {
        let speed = self.at_rows(|row| row.wind_speed);
        self.draft.track("wind.speed", &speed, Easing::Linear, Basis::told("mean wind, m/s"));
        if speed.is_empty() {
            return;
        }
        let mut last: Option<f64> = None;
        // The short way round from row to row.
        let directions: Vec<(f64, f64)> = self
            .at_rows(|row| row.wind_from.map(heading))
            .into_iter()
            .map(|(time, to)| {
                let turned = last.map_or(to, |last| last + (to - last + 180.0).rem_euclid(360.0) - 180.0);
                last = Some(turned);
                (time, turned)
            })
            .collect();
        if directions.is_empty() {
            self.draft.number("wind.direction", 90.0, Basis::guess("the table has no direction of the wind"));
        } else {
            let why = "blows to; the table says from; north is taken for the scene's x axis";
            self.draft.track("wind.direction", &directions, Easing::Linear, Basis::told(why));
        }
        let share = |row: &WeatherRow| {
            let (gust, speed) =
                row.wind_gust.zip(row.wind_speed.filter(|speed| *speed > MIN_GUSTY_WIND_M_S))?;
            Some(((gust / speed - 1.0) / 3.0).clamp(0.0, 1.0))
        };
        // One strength, as gusts that change would move the air by jumps.
        if let Some(gusts) = self.mean(share) {
            self.draft.number("wind.gusts", gusts, Basis::told("mean of (gust / wind - 1) / 3"));
        }
    }

    fn air(&mut self) {
        let table = self.table;
        let code_air = |row: &WeatherRow| {
            row.present_weather().filter(|code| code.air == PresentAir::Fog).map(|code| code.mor)
        };
        let rates = |row: &WeatherRow| [row.rain, row.snow].map(|amount| amount / table.step);
        let (values, basis) = if table.rows.iter().any(|row| row.visibility.is_some()) {
            let air = |row: &WeatherRow| {
                let [rain, snow] = rates(row);
                let falls = extinction("rain", rain) + extinction("snowfall", snow);
                let sigma = sigma_of_mor(row.visibility?.max(10.0)) - falls;
                Some(if sigma > 0.0 { visibility(sigma).min(CLEAR_VISIBILITY_M) } else { CLEAR_VISIBILITY_M })
            };
            (self.at_rows(air), Basis::told("visibility, less what falls"))
        } else if table.rows.iter().any(|row| code_air(row).is_some()) {
            let air = |row: &WeatherRow| Some(code_air(row).unwrap_or(USUAL_VISIBILITY_M));
            (self.at_rows(air), Basis::guess("fog by the code of the hour; the table has no visibility"))
        } else {
            self.draft.ignored("air: the table has no visibility, so that nothing but what falls is in it");
            return;
        };
        let is_foggy = values.iter().any(|(_, mor)| *mor < 1000.0);
        let key = if is_foggy { "fog.mor" } else { "haze.mor" };
        if values.iter().any(|(_, mor)| *mor < CLEAR_VISIBILITY_M) {
            self.draft.track(key, &values, Easing::Linear, basis);
        }
    }

    fn falls(&mut self) {
        let step = self.table.step;
        if self.table.rain_sum() > 0.0 {
            let keys = self.over_steps(|row| row.rain / step);
            let why = "mm/h, held over the hour before each row";
            self.draft.track("rain.rate", &keys, Easing::Hold, Basis::told(why));
            self.draft.number("rain.exposure", 0.004, Basis::guess("a shutter of 1/250 s, as by day"));
            self.draft.word("splash.amount", "auto", Basis::told("as in nature"));
        }
        if self.table.snow_sum() > 0.0 {
            let keys = self.over_steps(|row| row.snow / step);
            let why = "mm/h of water, held over the hour before each row";
            self.draft.track("snowfall.rate", &keys, Easing::Hold, Basis::told(why));
        }
    }

    fn ground(&mut self) {
        let lapse = 3600.0 / self.scale;
        let why = format!("an hour takes {} s", self.scale);
        let temperature = self.at_rows(|row| row.temperature);
        let depth = self.at_rows(|row| row.snow_depth);
        let lies = depth.iter().any(|(_, depth)| *depth > 0.0);
        let (rains, snows) = (self.table.rain_sum() > 0.0, self.table.snow_sum() > 0.0);
        if lies {
            let basis = Basis::told("depth of the table, m");
            self.draft.track("snow_cover.depth", &depth, Easing::Linear, basis);
            // What the table says has melted already.
            let cold: Vec<(f64, f64)> =
                temperature.iter().map(|(time, degrees)| (*time, degrees.min(0.0))).collect();
            let why = "at most 0, as the table's depth has melted already";
            self.draft.track("snow_cover.temperature", &cold, Easing::Linear, Basis::told(why));
        } else if snows && depth.is_empty() {
            let why = "the table has no depth: what has fallen and not melted";
            self.draft.word("snow_cover.depth", "auto", Basis::guess(why));
            self.draft.number("snow_cover.hours", 0.0, Basis::guess("no snow lies at the start"));
            let basis = Basis::told("degrees Celsius");
            self.draft.track("snow_cover.temperature", &temperature, Easing::Linear, basis);
        } else if snows {
            self.draft.ignored("lying snow: the table says that none lies");
        }
        let gathers = !lies && snows && depth.is_empty();
        if lies || gathers {
            self.draft.number("snow_cover.lapse", lapse, Basis::told(why.clone()));
        }
        let melts = gathers && temperature.iter().any(|(_, degrees)| *degrees > 0.0);
        if !rains && !melts {
            return;
        }
        self.draft.number("wetness.rained_before", 0.0, Basis::guess("the ground is dry at the start"));
        if let Some(degrees) = self.mean(|row| row.temperature) {
            self.draft.number("wetness.temperature", degrees, Basis::told("mean of the table"));
        }
        if let Some(humidity) = self.mean(|row| row.humidity) {
            self.draft.number("wetness.humidity", humidity, Basis::told("mean of the table"));
        }
        if let Some(place) = self.place {
            // One value for all hours, as the drying so far goes by the radiation of the frame.
            let radiation = self.mean(|row| Some(radiation(place, row))).unwrap_or_default();
            let why = "mean over the hours of sun and clouds, W/m^2";
            self.draft.number("wetness.radiation", radiation, Basis::guess(why));
        }
        self.draft.number("wetness.lapse", lapse, Basis::told(why));
    }
}

/// Net radiation on the ground by day and by night, W/m^2, as the effect `wetness` has it: 0.65 of
/// Haurwitz' clear sky, less by clouds (Kasten and Czeplak 1980).
fn radiation(location: [f64; 2], row: &WeatherRow) -> f64 {
    let [latitude, longitude] = location;
    let solar = row.time as f64 + 240.0 * longitude;
    let day = time::day_of_year((solar / 86_400.0).floor() as i64) as f64;
    // Declination within a degree (Cooper 1969); the sun is highest at noon.
    let declination = (23.44 * (TAU * (284.0 + day) / 365.0).sin()).to_radians();
    let turn = TAU * (solar.rem_euclid(86_400.0) / 86_400.0 - 0.5);
    let latitude = latitude.to_radians();
    let sin = latitude.sin() * declination.sin() + latitude.cos() * declination.cos() * turn.cos();
    if sin <= 0.0 {
        return NIGHT_RADIATION_W_M2;
    }
    let clouds = row.cloud_cover.unwrap_or(0.5);
    (0.65 * 1098.0 * sin * (-0.057 / sin).exp() * (1.0 - 0.75 * clouds.powf(3.4))).max(NIGHT_RADIATION_W_M2)
}
