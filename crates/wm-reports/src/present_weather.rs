//! Codes of present weather, `ww`: the WMO's code table 4677, which Open-Meteo's `weather_code`
//! follows.
//!
//! A code says what falls and how hard, in words; each row here has a rate, mm/h, and a visibility,
//! m, that such weather has. `ww 63`, `wmo 75` and `weather_code 61` are reports of their own.

use crate::conditions::{Carrier, Conditions, Datum, SnowRate};
use crate::draft::{Basis, Draft};
use crate::error::{ReportError, quoted};
use crate::report::{DecodedReport, WeatherReport};

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
        PRESENT_WEATHER.get(usize::try_from(code).ok()?)
    }

    /// Returns true if something falls.
    #[must_use]
    pub fn falls(&self) -> bool {
        self.rain > 0.0 || self.snow > 0.0 || self.hail > 0.0
    }
}

const fn row(code: u8, meaning: &'static str) -> PresentWeather {
    PresentWeather {
        code,
        meaning,
        rain: 0.0,
        snow: 0.0,
        hail: 0.0,
        air: PresentAir::Clear,
        mor: f64::INFINITY,
        lightning: 0.0,
        wind: 0.0,
        is_freezing: false,
        has_ended: false,
    }
}

/// All codes, in their order.
#[rustfmt::skip]
pub const PRESENT_WEATHER: &[PresentWeather] = &[
    row(0, "clouds were not observed, or a clear sky"),
    row(1, "clouds dissolve"),
    row(2, "the sky stays as it is"),
    row(3, "clouds form"),
    PresentWeather { air: PresentAir::Smoke, mor: 3000.0, ..row(4, "smoke") },
    PresentWeather { air: PresentAir::Haze, mor: 4000.0, ..row(5, "haze") },
    PresentWeather { air: PresentAir::Dust, mor: 3000.0, ..row(6, "dust in the air") },
    PresentWeather { air: PresentAir::Dust, mor: 2500.0, wind: 10.0, ..row(7, "dust or sand raised by wind") },
    row(8, "dust whirls"),
    PresentWeather { air: PresentAir::Dust, mor: 4000.0, has_ended: true, ..row(9, "a duststorm in sight or in the last hour") },
    PresentWeather { air: PresentAir::Fog, mor: 2000.0, ..row(10, "mist") },
    PresentWeather { air: PresentAir::ShallowFog, mor: 150.0, ..row(11, "patches of shallow fog") },
    PresentWeather { air: PresentAir::ShallowFog, mor: 150.0, ..row(12, "shallow fog") },
    PresentWeather { lightning: 3.0, ..row(13, "lightning without thunder") },
    row(14, "precipitation in sight that does not reach the ground"),
    row(15, "precipitation in sight, far away"),
    row(16, "precipitation in sight, near"),
    PresentWeather { lightning: 6.0, ..row(17, "a thunderstorm without precipitation") },
    PresentWeather { wind: 12.0, ..row(18, "squalls") },
    row(19, "a funnel cloud"),
    PresentWeather { has_ended: true, ..row(20, "drizzle or snow grains in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(21, "rain in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(22, "snow in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(23, "rain and snow in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(24, "freezing drizzle or rain in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(25, "showers of rain in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(26, "showers of snow in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(27, "showers of hail in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(28, "fog in the last hour, not now") },
    PresentWeather { has_ended: true, ..row(29, "a thunderstorm in the last hour, not now") },
    PresentWeather { air: PresentAir::Dust, mor: 800.0, wind: 12.0, ..row(30, "slight or moderate duststorm, decreasing") },
    PresentWeather { air: PresentAir::Dust, mor: 800.0, wind: 12.0, ..row(31, "slight or moderate duststorm, steady") },
    PresentWeather { air: PresentAir::Dust, mor: 800.0, wind: 12.0, ..row(32, "slight or moderate duststorm, increasing") },
    PresentWeather { air: PresentAir::Dust, mor: 200.0, wind: 17.0, ..row(33, "severe duststorm, decreasing") },
    PresentWeather { air: PresentAir::Dust, mor: 200.0, wind: 17.0, ..row(34, "severe duststorm, steady") },
    PresentWeather { air: PresentAir::Dust, mor: 200.0, wind: 17.0, ..row(35, "severe duststorm, increasing") },
    PresentWeather { wind: 6.0, ..row(36, "slight or moderate drifting snow, low") },
    PresentWeather { wind: 9.0, ..row(37, "heavy drifting snow, low") },
    PresentWeather { snow: 0.4, wind: 9.0, ..row(38, "slight or moderate blowing snow") },
    PresentWeather { snow: 2.0, wind: 13.0, ..row(39, "heavy blowing snow") },
    PresentWeather { air: PresentAir::Fog, mor: 2000.0, ..row(40, "fog at a distance") },
    PresentWeather { air: PresentAir::Fog, mor: 800.0, ..row(41, "fog in patches") },
    PresentWeather { air: PresentAir::Fog, mor: 400.0, ..row(42, "fog, sky visible, thinning") },
    PresentWeather { air: PresentAir::Fog, mor: 200.0, ..row(43, "fog, sky invisible, thinning") },
    PresentWeather { air: PresentAir::Fog, mor: 400.0, ..row(44, "fog, sky visible, steady") },
    PresentWeather { air: PresentAir::Fog, mor: 200.0, ..row(45, "fog, sky invisible, steady") },
    PresentWeather { air: PresentAir::Fog, mor: 400.0, ..row(46, "fog, sky visible, thickening") },
    PresentWeather { air: PresentAir::Fog, mor: 200.0, ..row(47, "fog, sky invisible, thickening") },
    PresentWeather { air: PresentAir::Fog, mor: 400.0, is_freezing: true, ..row(48, "fog with rime, sky visible") },
    PresentWeather { air: PresentAir::Fog, mor: 200.0, is_freezing: true, ..row(49, "fog with rime, sky invisible") },
    PresentWeather { rain: 0.1, ..row(50, "slight drizzle at times") },
    PresentWeather { rain: 0.1, ..row(51, "slight drizzle") },
    PresentWeather { rain: 0.3, ..row(52, "moderate drizzle at times") },
    PresentWeather { rain: 0.3, ..row(53, "moderate drizzle") },
    PresentWeather { rain: 0.8, ..row(54, "heavy drizzle at times") },
    PresentWeather { rain: 0.8, ..row(55, "heavy drizzle") },
    PresentWeather { rain: 0.1, is_freezing: true, ..row(56, "slight freezing drizzle") },
    PresentWeather { rain: 0.5, is_freezing: true, ..row(57, "moderate or heavy freezing drizzle") },
    PresentWeather { rain: 0.5, ..row(58, "slight drizzle and rain") },
    PresentWeather { rain: 4.0, ..row(59, "moderate or heavy drizzle and rain") },
    PresentWeather { rain: 1.0, ..row(60, "slight rain at times") },
    PresentWeather { rain: 1.0, ..row(61, "slight rain") },
    PresentWeather { rain: 5.0, ..row(62, "moderate rain at times") },
    PresentWeather { rain: 5.0, ..row(63, "moderate rain") },
    PresentWeather { rain: 20.0, ..row(64, "heavy rain at times") },
    PresentWeather { rain: 20.0, ..row(65, "heavy rain") },
    PresentWeather { rain: 1.0, is_freezing: true, ..row(66, "slight freezing rain") },
    PresentWeather { rain: 5.0, is_freezing: true, ..row(67, "moderate or heavy freezing rain") },
    PresentWeather { rain: 0.5, snow: 0.2, ..row(68, "slight rain and snow") },
    PresentWeather { rain: 3.0, snow: 1.0, ..row(69, "moderate or heavy rain and snow") },
    PresentWeather { snow: 0.4, ..row(70, "slight snow at times") },
    PresentWeather { snow: 0.4, ..row(71, "slight snow") },
    PresentWeather { snow: 1.6, ..row(72, "moderate snow at times") },
    PresentWeather { snow: 1.6, ..row(73, "moderate snow") },
    PresentWeather { snow: 4.0, ..row(74, "heavy snow at times") },
    PresentWeather { snow: 4.0, ..row(75, "heavy snow") },
    PresentWeather { snow: 0.02, ..row(76, "diamond dust") },
    PresentWeather { snow: 0.1, ..row(77, "snow grains") },
    PresentWeather { snow: 0.05, ..row(78, "single snow crystals") },
    PresentWeather { hail: 2.0, ..row(79, "ice pellets") },
    PresentWeather { rain: 2.0, ..row(80, "slight showers of rain") },
    PresentWeather { rain: 8.0, ..row(81, "moderate or heavy showers of rain") },
    PresentWeather { rain: 50.0, ..row(82, "violent showers of rain") },
    PresentWeather { rain: 1.0, snow: 0.3, ..row(83, "slight showers of rain and snow") },
    PresentWeather { rain: 4.0, snow: 1.2, ..row(84, "moderate or heavy showers of rain and snow") },
    PresentWeather { snow: 0.5, ..row(85, "slight showers of snow") },
    PresentWeather { snow: 2.5, ..row(86, "moderate or heavy showers of snow") },
    PresentWeather { hail: 2.0, ..row(87, "slight showers of small hail") },
    PresentWeather { hail: 8.0, ..row(88, "moderate or heavy showers of small hail") },
    PresentWeather { hail: 5.0, ..row(89, "slight showers of hail") },
    PresentWeather { hail: 20.0, ..row(90, "moderate or heavy showers of hail") },
    PresentWeather { rain: 1.0, ..row(91, "slight rain after a thunderstorm") },
    PresentWeather { rain: 8.0, ..row(92, "moderate or heavy rain after a thunderstorm") },
    PresentWeather { snow: 0.4, ..row(93, "slight snow or hail after a thunderstorm") },
    PresentWeather { snow: 2.0, ..row(94, "moderate or heavy snow or hail after a thunderstorm") },
    PresentWeather { rain: 8.0, lightning: 6.0, ..row(95, "thunderstorm with rain or snow") },
    PresentWeather { rain: 8.0, hail: 10.0, lightning: 6.0, ..row(96, "thunderstorm with hail") },
    PresentWeather { rain: 30.0, lightning: 10.0, ..row(97, "heavy thunderstorm with rain or snow") },
    PresentWeather { air: PresentAir::Dust, mor: 500.0, lightning: 6.0, wind: 14.0, ..row(98, "thunderstorm with a duststorm") },
    PresentWeather { rain: 30.0, hail: 40.0, lightning: 10.0, ..row(99, "heavy thunderstorm with hail") },
];

/// Cloud covers of the codes 0 to 3 in weather services: clear, mainly clear, partly cloudy,
/// overcast.
const COVERS: [f64; 4] = [0.0, 0.2, 0.5, 1.0];

pub(crate) fn read(text: &str) -> Result<WeatherReport, ReportError> {
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
    draft.finish(DecodedReport::PresentWeather(row))
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
    now.clouds = COVERS.get(usize::from(row.code)).map(|cover| Datum::guess(*cover, covers));
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
            let report = read(&format!("ww {code:02}")).unwrap();
            let falls = report.weather().has(wm_weather::EffectRole::Falls);
            assert_eq!(falls, PresentWeather::of(code).unwrap().falls(), "{code}");
        }
        assert_eq!(read("wmo4677: 75").unwrap().name, "ww-75");
        assert_eq!(read("ww63").unwrap().name, "ww-63");
        let error = read("ww 107").unwrap_err().to_string();
        assert_eq!(error, "ww: `ww 107` is no code of present weather: 0 to 99 are expected, as in ww 63");
    }
}
