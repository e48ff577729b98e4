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
    const fn rain(self, rain: f64) -> Self {
        Self { rain, ..self }
    }

    const fn snow(self, snow: f64) -> Self {
        Self { snow, ..self }
    }

    const fn hail(self, hail: f64) -> Self {
        Self { hail, ..self }
    }

    const fn air(self, air: PresentAir, mor: f64) -> Self {
        Self { air, mor, ..self }
    }

    const fn lightning(self, lightning: f64) -> Self {
        Self { lightning, ..self }
    }

    const fn wind(self, wind: f64) -> Self {
        Self { wind, ..self }
    }

    const fn freezing(self) -> Self {
        Self { is_freezing: true, ..self }
    }

    const fn ended(self) -> Self {
        Self { has_ended: true, ..self }
    }

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
    row(4, "smoke").air(PresentAir::Smoke, 3000.0),
    row(5, "haze").air(PresentAir::Haze, 4000.0),
    row(6, "dust in the air").air(PresentAir::Dust, 3000.0),
    row(7, "dust or sand raised by wind").air(PresentAir::Dust, 2500.0).wind(10.0),
    row(8, "dust whirls"),
    row(9, "a duststorm in sight or in the last hour").air(PresentAir::Dust, 4000.0).ended(),
    row(10, "mist").air(PresentAir::Fog, 2000.0),
    row(11, "patches of shallow fog").air(PresentAir::ShallowFog, 150.0),
    row(12, "shallow fog").air(PresentAir::ShallowFog, 150.0),
    row(13, "lightning without thunder").lightning(3.0),
    row(14, "precipitation in sight that does not reach the ground"),
    row(15, "precipitation in sight, far away"),
    row(16, "precipitation in sight, near"),
    row(17, "a thunderstorm without precipitation").lightning(6.0),
    row(18, "squalls").wind(12.0),
    row(19, "a funnel cloud"),
    row(20, "drizzle or snow grains in the last hour, not now").ended(),
    row(21, "rain in the last hour, not now").ended(),
    row(22, "snow in the last hour, not now").ended(),
    row(23, "rain and snow in the last hour, not now").ended(),
    row(24, "freezing drizzle or rain in the last hour, not now").ended(),
    row(25, "showers of rain in the last hour, not now").ended(),
    row(26, "showers of snow in the last hour, not now").ended(),
    row(27, "showers of hail in the last hour, not now").ended(),
    row(28, "fog in the last hour, not now").ended(),
    row(29, "a thunderstorm in the last hour, not now").ended(),
    row(30, "slight or moderate duststorm, decreasing").air(PresentAir::Dust, 800.0).wind(12.0),
    row(31, "slight or moderate duststorm, steady").air(PresentAir::Dust, 800.0).wind(12.0),
    row(32, "slight or moderate duststorm, increasing").air(PresentAir::Dust, 800.0).wind(12.0),
    row(33, "severe duststorm, decreasing").air(PresentAir::Dust, 200.0).wind(17.0),
    row(34, "severe duststorm, steady").air(PresentAir::Dust, 200.0).wind(17.0),
    row(35, "severe duststorm, increasing").air(PresentAir::Dust, 200.0).wind(17.0),
    row(36, "slight or moderate drifting snow, low").wind(6.0),
    row(37, "heavy drifting snow, low").wind(9.0),
    row(38, "slight or moderate blowing snow").snow(0.4).wind(9.0),
    row(39, "heavy blowing snow").snow(2.0).wind(13.0),
    row(40, "fog at a distance").air(PresentAir::Fog, 2000.0),
    row(41, "fog in patches").air(PresentAir::Fog, 800.0),
    row(42, "fog, sky visible, thinning").air(PresentAir::Fog, 400.0),
    row(43, "fog, sky invisible, thinning").air(PresentAir::Fog, 200.0),
    row(44, "fog, sky visible, steady").air(PresentAir::Fog, 400.0),
    row(45, "fog, sky invisible, steady").air(PresentAir::Fog, 200.0),
    row(46, "fog, sky visible, thickening").air(PresentAir::Fog, 400.0),
    row(47, "fog, sky invisible, thickening").air(PresentAir::Fog, 200.0),
    row(48, "fog with rime, sky visible").air(PresentAir::Fog, 400.0).freezing(),
    row(49, "fog with rime, sky invisible").air(PresentAir::Fog, 200.0).freezing(),
    row(50, "slight drizzle at times").rain(0.1),
    row(51, "slight drizzle").rain(0.1),
    row(52, "moderate drizzle at times").rain(0.3),
    row(53, "moderate drizzle").rain(0.3),
    row(54, "heavy drizzle at times").rain(0.8),
    row(55, "heavy drizzle").rain(0.8),
    row(56, "slight freezing drizzle").rain(0.1).freezing(),
    row(57, "moderate or heavy freezing drizzle").rain(0.5).freezing(),
    row(58, "slight drizzle and rain").rain(0.5),
    row(59, "moderate or heavy drizzle and rain").rain(4.0),
    row(60, "slight rain at times").rain(1.0),
    row(61, "slight rain").rain(1.0),
    row(62, "moderate rain at times").rain(5.0),
    row(63, "moderate rain").rain(5.0),
    row(64, "heavy rain at times").rain(20.0),
    row(65, "heavy rain").rain(20.0),
    row(66, "slight freezing rain").rain(1.0).freezing(),
    row(67, "moderate or heavy freezing rain").rain(5.0).freezing(),
    row(68, "slight rain and snow").rain(0.5).snow(0.2),
    row(69, "moderate or heavy rain and snow").rain(3.0).snow(1.0),
    row(70, "slight snow at times").snow(0.4),
    row(71, "slight snow").snow(0.4),
    row(72, "moderate snow at times").snow(1.6),
    row(73, "moderate snow").snow(1.6),
    row(74, "heavy snow at times").snow(4.0),
    row(75, "heavy snow").snow(4.0),
    row(76, "diamond dust").snow(0.02),
    row(77, "snow grains").snow(0.1),
    row(78, "single snow crystals").snow(0.05),
    row(79, "ice pellets").hail(2.0),
    row(80, "slight showers of rain").rain(2.0),
    row(81, "moderate or heavy showers of rain").rain(8.0),
    row(82, "violent showers of rain").rain(50.0),
    row(83, "slight showers of rain and snow").rain(1.0).snow(0.3),
    row(84, "moderate or heavy showers of rain and snow").rain(4.0).snow(1.2),
    row(85, "slight showers of snow").snow(0.5),
    row(86, "moderate or heavy showers of snow").snow(2.5),
    row(87, "slight showers of small hail").hail(2.0),
    row(88, "moderate or heavy showers of small hail").hail(8.0),
    row(89, "slight showers of hail").hail(5.0),
    row(90, "moderate or heavy showers of hail").hail(20.0),
    row(91, "slight rain after a thunderstorm").rain(1.0),
    row(92, "moderate or heavy rain after a thunderstorm").rain(8.0),
    row(93, "slight snow or hail after a thunderstorm").snow(0.4),
    row(94, "moderate or heavy snow or hail after a thunderstorm").snow(2.0),
    row(95, "thunderstorm with rain or snow").rain(8.0).lightning(6.0),
    row(96, "thunderstorm with hail").rain(8.0).hail(10.0).lightning(6.0),
    row(97, "heavy thunderstorm with rain or snow").rain(30.0).lightning(10.0),
    row(98, "thunderstorm with a duststorm").air(PresentAir::Dust, 500.0).lightning(6.0).wind(14.0),
    row(99, "heavy thunderstorm with hail").rain(30.0).hail(40.0).lightning(10.0),
];

/// Cloud covers of the codes 0 to 3 in weather services: clear, mainly clear, partly cloudy,
/// overcast.
const COVERS: [f64; 4] = [0.0, 0.2, 0.5, 1.0];

pub(crate) fn read(text: &str) -> Result<WeatherReport, ReportError> {
    let wrong = |problem: String| ReportError::Whole { file: "ww".into(), problem };
    let number = text.trim().trim_start_matches(|c: char| !c.is_ascii_digit() && c != '-');
    // The table's number is in one of the words for it.
    let number = if text.trim().to_lowercase().starts_with("wmo4677") {
        number.trim_start_matches("4677")
    } else {
        number
    };
    let number = number.trim_start_matches(|c: char| !c.is_ascii_digit() && c != '-').trim();
    let row = number.parse().ok().and_then(PresentWeather::of).ok_or_else(|| {
        wrong(format!(
            "{} is no code of present weather: 0 to 99 are expected, as in ww 63",
            quoted(text.trim())
        ))
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
    if let Some(cover) = COVERS.get(usize::from(row.code)) {
        now.clouds = Some(Datum::guess(
            *cover,
            "clear, mainly clear, partly cloudy or overcast, as weather services use 0 to 3",
        ));
    }
    if matches!(row.code, 20 | 21 | 23 | 24 | 25 | 29) {
        now.rained =
            Some(([30.0, 2.0, 15.0], Basis::guess(format!("{}: 30 minutes until 15 minutes ago", why()))));
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
