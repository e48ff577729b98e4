//! Codes of present weather, `ww`: the WMO's code table 4677, which Open-Meteo's `weather_code`
//! follows.
//!
//! A code says what falls and how hard, in words; each row here has a rate, mm/h, and a visibility,
//! m, that such weather has. `ww 63`, `wmo 75` and `weather_code 61` are reports of their own.

use crate::conditions::{Carrier, Conditions, SnowRate};
use crate::draft::{Basis, Datum, Draft, WrittenWeather};
use crate::error::{ReportError, quoted};
use std::sync::LazyLock;

/// The particles in the air of a code of present weather.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PresentAir {
    /// Clear but for precipitation.
    Clear,
    /// Droplets.
    Fog,
    /// Droplets below 2 m.
    ShallowFog,
    /// Dry particles.
    Haze,
    /// Smoke.
    Smoke,
    /// Dust or sand.
    Dust,
}

/// A row of the table of present weather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PresentWeather {
    /// The code, 0-99.
    pub code: u8,
    /// The meaning.
    pub meaning: &'static str,
    /// Rain, mm/h.
    pub rain: f64,
    /// Snow, mm/h of water.
    pub snow: f64,
    /// Hail, mm/h of water.
    pub hail: f64,
    /// The particles in the air.
    pub air: PresentAir,
    /// Visibility by the air alone, m; infinite for clear air.
    pub mor: f64,
    /// Flashes of lightning a minute.
    pub lightning: f64,
    /// Least wind, m/s.
    pub wind: f64,
    /// It freezes to what it touches.
    pub is_freezing: bool,
    /// It was there in the last hour and is not now.
    pub has_ended: bool,
}

impl PresentWeather {
    /// The row of a code, 0-99.
    ///
    /// ```
    /// use wm_reports::PresentWeather;
    ///
    /// assert_eq!(PresentWeather::of(63).map(|row| row.rain), Some(5.0));
    /// assert!(PresentWeather::of(100).is_none());
    /// ```
    #[must_use]
    pub fn of(code: u32) -> Option<&'static Self> {
        ROWS.get(usize::try_from(code).ok()?)
    }

    /// Returns true if something falls.
    #[must_use]
    pub fn falls(&self) -> bool {
        self.rain > 0.0 || self.snow > 0.0 || self.hail > 0.0
    }
}

/// All codes, in their order.
static ROWS: LazyLock<Vec<PresentWeather>> =
    LazyLock::new(|| include_str!("present_weather.csv").lines().skip(1).map(row).collect());

/// Reads a row of the table: an empty cell is nothing, and the meaning, which may have commas, is
/// the last.
fn row(line: &'static str) -> PresentWeather {
    let cells: Vec<&'static str> = line.splitn(11, ',').collect();
    let number = |column: usize, none: f64| match cells[column] {
        "" => none,
        text => text.parse().expect("the table has numbers"),
    };
    PresentWeather {
        code: number(0, 0.0) as u8,
        meaning: cells[10],
        rain: number(1, 0.0),
        snow: number(2, 0.0),
        hail: number(3, 0.0),
        air: match cells[4] {
            "" => PresentAir::Clear,
            "Fog" => PresentAir::Fog,
            "ShallowFog" => PresentAir::ShallowFog,
            "Haze" => PresentAir::Haze,
            "Smoke" => PresentAir::Smoke,
            "Dust" => PresentAir::Dust,
            other => unreachable!("{other} in the table"),
        },
        mor: number(5, f64::INFINITY),
        lightning: number(6, 0.0),
        wind: number(7, 0.0),
        is_freezing: cells[8] == "yes",
        has_ended: cells[9] == "yes",
    }
}

/// Cloud covers of the codes 0 to 3 in weather services: clear, mainly clear, partly cloudy,
/// overcast.
const CLOUD_COVERS: [f64; 4] = [0.0, 0.2, 0.5, 1.0];

pub(crate) fn read(text: &str) -> Result<(&'static PresentWeather, WrittenWeather), ReportError> {
    let from_number = |text: &str| text.find(|c: char| c.is_ascii_digit() || c == '-').unwrap_or(text.len());
    let mut number = &text[from_number(text)..];
    // The table's number is in one of the words for it.
    if text.trim().to_lowercase().starts_with("wmo4677") {
        number = number.trim_start_matches("4677");
        number = &number[from_number(number)..];
    }
    let row = number.trim().parse().ok().and_then(PresentWeather::of).ok_or_else(|| ReportError::Whole {
        file: "ww".into(),
        problem: format!(
            "{} is no code of present weather: 0 to 99 are expected, as in ww 63",
            quoted(text.trim())
        ),
    })?;
    let now = conditions(row);
    let head = vec![format!("WMO code table 4677, ww {:02}: {}", row.code, row.meaning)];
    let mut draft = Draft::new(&format!("ww {:02}", row.code), row.meaning, head);
    now.write(&mut draft);
    if row.has_ended {
        draft.ignored(format!("{}: no rate is told", row.meaning));
    }
    if row.is_freezing {
        draft.ignored("ice that grows on surfaces is not drawn");
    }
    draft.ignored("wind and temperature: a code of present weather has none");
    Ok((row, draft.finish()?))
}

fn conditions(row: &'static PresentWeather) -> Conditions {
    let mut now = Conditions::default();
    let why = || format!("ww {:02}, {}", row.code, row.meaning);
    let rate = |rate: f64| (rate > 0.0).then(|| Datum::guess(rate, format!("{}: a usual rate", why())));
    now.rain = rate(row.rain);
    now.snow = rate(row.snow).map(SnowRate::Told);
    now.hail = rate(row.hail);
    if (77..=79).contains(&row.code) || matches!(row.code, 87 | 88) {
        now.hail_size = now.hail.is_some().then(|| Datum::guess(0.5, "small stones"));
    }
    let carrier = match row.air {
        PresentAir::Clear => None,
        PresentAir::ShallowFog => {
            now.shallow_fog = Some(Basis::told(why()));
            None
        }
        PresentAir::Fog => Some(Carrier::Droplets),
        PresentAir::Haze => Some(Carrier::Haze),
        PresentAir::Smoke => Some(Carrier::Smoke),
        PresentAir::Dust => Some(Carrier::Dust),
    };
    if let Some(carrier) = carrier {
        now.carrier = Some((carrier, Basis::told(why())));
        now.visibility = Some(Datum::guess(row.mor, format!("{}: usual", why())));
    }
    if row.lightning > 0.0 {
        now.lightning = Some((Datum::guess(row.lightning, format!("{}: flashes a minute", why())), 3000.0));
    }
    if row.wind > 0.0 {
        now.wind.speed = Some(Datum::guess(row.wind, format!("{}: the least that does so", why())));
    }
    if row.is_freezing {
        now.temperature = Some(Datum::guess(-2.0, why()));
    }
    let covers = "clear, mainly clear, partly cloudy or overcast, as weather services use 0 to 3";
    now.clouds = CLOUD_COVERS.get(usize::from(row.code)).map(|cover| Datum::guess(*cover, covers));
    if matches!(row.code, 20 | 21 | 23 | 24 | 25 | 29) {
        let basis = Basis::guess(format!("{}: 30 minutes until 15 minutes ago", why()));
        now.rained = Some(([30.0, 2.0, 15.0], basis));
    }
    now
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_codes_are_there_and_are_weathers() {
        for code in 0..100 {
            assert_eq!(u32::from(PresentWeather::of(code).unwrap().code), code);
            let (_, written) = read(&format!("ww {code:02}")).unwrap();
            let falls = written.weather.has(wm_weather::EffectRole::Falls);
            assert_eq!(falls, PresentWeather::of(code).unwrap().falls(), "{code}");
        }
        assert_eq!(read("wmo4677: 75").unwrap().1.name, "ww-75");
        assert_eq!(read("ww63").unwrap().1.name, "ww-63");
        let error = read("ww 107").unwrap_err().to_string();
        assert_eq!(error, "ww: `ww 107` is no code of present weather: 0 to 99 are expected, as in ww 63");
    }
}
