//! The weather of a METAR.
//!
//! | group | becomes |
//! |---|---|
//! | wind | `wind.speed`, `wind.direction` (to where it blows), `wind.gusts` = (gust / mean - 1) / 3 |
//! | visibility | extinction of the air, less that of what falls, as fog (FG, BR), haze (HZ), smog (FU) or dust (DU, SA, DS, SS) |
//! | RA, SHRA, DZ | 1 / 5 / 20, 2 / 8 / 30, 0.1 / 0.3 / 0.8 mm/h when light, moderate, heavy |
//! | SN | by visibility, within 0.1-1, 1-2.5, 2.5-8 mm/h |
//! | GR, GS, PL | hail, smaller for GS and PL |
//! | MIFG | fog of a scale height of 2 m |
//! | BLSN | snow in a wind of 8 m/s and more |
//! | TS | lightning |
//! | clouds | `light.clouds`, the middle of the eighths |
//! | temperature, dew point | of the snow, and of the air that dries the ground |

use super::decoded::{
    CloudCover, Metar, MetarKind, MetarVisibility, VisibilityBound, WeatherDescriptor as Descriptor,
    WeatherGroup, WeatherIntensity, WeatherPhenomenon as Phenomenon,
};
use crate::conditions::{
    Carrier, Conditions, DRIZZLE_RATES_MM_H, FLASHES_PER_MINUTE, HAIL_RATES_MM_H, RAIN_RATES_MM_H,
    SHOWER_RATES_MM_H, SNOW_RATES_MM_H, STORM_DISTANCE_M, SnowRate, Sun,
};
use crate::draft::{Basis, Datum, Draft, WrittenWeather};
use crate::error::ReportError;
use crate::optics::humidity;
use crate::options::ReportOptions;

/// Rates in light, moderate and heavy weather.
const SNOW_GRAIN_RATES_MM_H: [f64; 3] = [0.05, 0.1, 0.2];
const ICE_CRYSTAL_RATE_MM_H: f64 = 0.02;
const SMALL_HAIL_RATES_MM_H: [f64; 3] = [2.0, 8.0, 20.0];
const ICE_PELLET_RATES_MM_H: [f64; 3] = [0.5, 2.0, 5.0];
/// Wind that lifts snow, m/s.
const SNOW_DRIFT_WIND_M_S: f64 = 8.0;
/// Flashes a minute of a thunderstorm in the vicinity, and their distance, m.
const NEARBY_STORM: [f64; 2] = [3.0, 12_000.0];

pub(super) fn weather(
    text: &str,
    metar: &Metar,
    options: &ReportOptions,
) -> Result<WrittenWeather, ReportError> {
    let mut mapping = Mapping { now: Conditions::default(), ignored: Vec::new() };
    mapping.wind(metar);
    mapping.air_and_clouds(metar);
    mapping.temperature(metar);
    for group in &metar.weather {
        mapping.group(group);
    }
    for group in &metar.recent {
        mapping.recent(group);
    }
    mapping.sun(metar, options);
    let Mapping { now, ignored } = mapping;
    let kind = if metar.kind == MetarKind::Speci { "SPECI" } else { "METAR" };
    let time = metar
        .time
        .map_or_else(String::new, |time| format!(" {:02}T{:02}{:02}Z", time.day, time.hour, time.minute));
    let name = format!("{kind} {}{time}", metar.station);
    let head = vec![text.split_whitespace().collect::<Vec<_>>().join(" ")];
    let mut draft = Draft::new(&name, &now.summary(), head);
    now.write(&mut draft);
    draft.missing(&metar.missing());
    for text in ignored {
        draft.ignored(text);
    }
    for group in &metar.ignored {
        draft.ignored(format!("{}: {}", group.text, group.reason));
    }
    for range in &metar.runway_ranges {
        draft.ignored(format!("visual range of runway {}: it is told for lights", range.runway));
    }
    if !metar.remarks.is_empty() {
        draft.ignored(format!("remarks {}", metar.remarks));
    }
    draft.finish()
}

struct Mapping {
    now: Conditions,
    ignored: Vec<String>,
}

impl Mapping {
    fn wind(&mut self, metar: &Metar) {
        let Some(wind) = &metar.wind else { return };
        let Some(speed) = wind.speed else { return };
        self.now.wind.speed = Some(Datum::told(speed, "mean of the report, m/s"));
        self.now.wind.from = wind.from.map(|from| {
            let text = match wind.between {
                Some([a, b]) => format!("mean direction, from {from} degrees (varies from {a} to {b})"),
                None => format!("from {from} degrees"),
            };
            Datum::told(from, text)
        });
        self.now.wind.gusts = wind.gust.map(|gust| Datum::of_gusts(gust, speed));
    }

    fn air_and_clouds(&mut self, metar: &Metar) {
        self.now.visibility = metar.visibility.as_ref().map(visibility_datum);
        if let Some(least) = &metar.minimum_visibility {
            let side = least.direction.as_deref().map_or_else(String::new, |side| format!(" to the {side}"));
            self.ignored.push(format!(
                "least visibility of {:.0} m{side}: the air is the same all around, by the prevailing visibility",
                least.metres
            ));
        }
        let covers: Vec<(f64, &str)> =
            metar.clouds.iter().filter_map(|layer| Some((layer.cover.share()?, &layer.code[..]))).collect();
        let most = covers.iter().copied().reduce(|a, b| if b.0 > a.0 { b } else { a });
        self.now.clouds = match most {
            Some((share, code)) if metar.clouds.iter().any(|layer| layer.cover != CloudCover::Clear) => {
                let part = if share < 1.0 { "the middle of its eighths" } else { "all of the sky" };
                Some(Datum::told(share, format!("{code}: {part}")))
            }
            Some((share, code)) => {
                Some(Datum::told(share, format!("{code}: no clouds, or none that matter")))
            }
            None if metar.is_cavok => Some(Datum::guess(0.0, "CAVOK: no clouds that matter")),
            None => None,
        };
    }

    fn temperature(&mut self, metar: &Metar) {
        if let Some(temperature) = metar.temperature {
            self.now.temperature = Some(Datum::told(temperature, "degrees of the report"));
            if let Some(dew_point) = metar.dew_point {
                let why = format!("by the dew point of {dew_point} degrees");
                self.now.humidity = Some(Datum::told(humidity(temperature, dew_point), why));
            }
        }
    }

    fn group(&mut self, group: &WeatherGroup) {
        let code = group.code();
        let strength = match group.intensity {
            WeatherIntensity::Light => 0,
            WeatherIntensity::Moderate => 1,
            WeatherIntensity::Heavy => 2,
        };
        if group.is_nearby {
            if group.is(Descriptor::Thunderstorm) {
                let [rate, distance] = NEARBY_STORM;
                self.now.lightning =
                    Some((Datum::guess(rate, format!("{code}: flashes a minute")), distance));
            } else {
                self.ignored.push(format!("{code}: it is not at the station"));
            }
            return;
        }
        if group.is(Descriptor::Thunderstorm) {
            let why = format!("{code}: flashes a minute");
            self.now.lightning = Some((Datum::guess(FLASHES_PER_MINUTE[strength], why), STORM_DISTANCE_M));
        }
        let is_shower = group.is(Descriptor::Showers) || group.is(Descriptor::Thunderstorm);
        let is_mixed =
            group.phenomena.iter().any(|one| matches!(one, Phenomenon::Snow | Phenomenon::SnowGrains))
                && group.phenomena.iter().any(|one| matches!(one, Phenomenon::Rain | Phenomenon::Drizzle));
        if group.is(Descriptor::Freezing) {
            self.ignored.push(format!("{code}: ice that grows on surfaces is not drawn"));
            if self.now.temperature.is_none() {
                self.now.temperature =
                    Some(Datum::guess(-2.0, format!("{code}, and no temperature is told")));
            }
        }
        for phenomenon in &group.phenomena {
            self.phenomenon(*phenomenon, group, &code, strength, is_shower, is_mixed);
        }
    }

    fn phenomenon(
        &mut self,
        phenomenon: Phenomenon,
        group: &WeatherGroup,
        code: &str,
        strength: usize,
        is_shower: bool,
        is_mixed: bool,
    ) {
        let share = if is_mixed { 0.5 } else { 1.0 };
        let mixed = if is_mixed { ", half of it" } else { "" };
        match phenomenon {
            Phenomenon::Rain if is_shower => {
                self.rain(share * SHOWER_RATES_MM_H[strength], format!("{code}: showers{mixed}"));
            }
            Phenomenon::Rain => self.rain(share * RAIN_RATES_MM_H[strength], format!("{code}: rain{mixed}")),
            Phenomenon::Drizzle => {
                self.rain(share * DRIZZLE_RATES_MM_H[strength], format!("{code}: drizzle{mixed}"));
            }
            Phenomenon::Snow if group.is(Descriptor::Drifting) => {
                self.ignored.push(format!("{code}: snow that drifts below 2 m is not drawn"));
            }
            Phenomenon::Snow => {
                if group.is(Descriptor::Blowing) {
                    self.ignored
                        .push(format!("{code}: snow is drawn as falling, not as lifted from the ground"));
                    if self.now.wind.speed.as_ref().is_none_or(|speed| speed.value < SNOW_DRIFT_WIND_M_S) {
                        let why = format!("{code}: the least that lifts snow");
                        self.now.wind.speed = Some(Datum::guess(SNOW_DRIFT_WIND_M_S, why));
                    }
                    // Of blowing snow alone all rates may be.
                    if self.now.snow.is_none() {
                        let text = format!("{code}: blowing snow");
                        self.now.snow = Some(SnowRate::ByVisibility { range: [0.1, 8.0], usual: 1.6, text });
                    }
                    return;
                }
                let (range, usual) = SNOW_RATES_MM_H[strength];
                let (range, usual) = (range.map(|rate| share * rate), share * usual);
                let text = format!("{code}: snow{mixed}");
                self.now.snow = Some(SnowRate::ByVisibility { range, usual, text });
            }
            Phenomenon::SnowGrains => {
                self.snow(SNOW_GRAIN_RATES_MM_H[strength], format!("{code}: snow grains"));
            }
            Phenomenon::IceCrystals => {
                self.snow(ICE_CRYSTAL_RATE_MM_H, format!("{code}: ice crystals, as sparse snow"));
            }
            Phenomenon::Hail => self.hail(HAIL_RATES_MM_H[strength], None, format!("{code}: hail")),
            Phenomenon::SmallHail => {
                self.hail(SMALL_HAIL_RATES_MM_H[strength], Some(0.5), format!("{code}: small hail"));
            }
            Phenomenon::IcePellets => {
                self.hail(ICE_PELLET_RATES_MM_H[strength], Some(0.4), format!("{code}: ice pellets"));
            }
            Phenomenon::Unknown => match self.now.temperature.as_ref().map(|temperature| temperature.value) {
                Some(degrees) if degrees <= 0.0 => {
                    let (range, usual) = SNOW_RATES_MM_H[strength];
                    let text = format!("{code}: taken for snow at {degrees} degrees");
                    self.now.snow = Some(SnowRate::ByVisibility { range, usual, text });
                }
                _ => self.rain(RAIN_RATES_MM_H[strength], format!("{code}: taken for rain")),
            },
            Phenomenon::Fog if group.is(Descriptor::Shallow) => {
                self.now.shallow_fog = Some(Basis::told(format!("{code}: shallow")));
            }
            Phenomenon::Fog => {
                if group.is(Descriptor::Patches) || group.is(Descriptor::Partial) {
                    self.ignored
                        .push(format!("{code}: there are no patches of fog, it is the same all around"));
                }
                self.carry(Carrier::Droplets, code);
            }
            Phenomenon::Mist | Phenomenon::Spray => self.carry(Carrier::Droplets, code),
            Phenomenon::Haze => self.carry(Carrier::Haze, code),
            Phenomenon::Smoke => self.carry(Carrier::Smoke, code),
            Phenomenon::Ash => self.carry(Carrier::Ash, code),
            Phenomenon::Dust | Phenomenon::Sand | Phenomenon::Sandstorm | Phenomenon::Duststorm => {
                self.carry(Carrier::Dust, code);
            }
            Phenomenon::Whirls | Phenomenon::Squalls | Phenomenon::Funnel => {
                self.ignored.push(format!("{code}: a weather has none"));
            }
        }
    }

    /// Several groups of rain add up.
    fn rain(&mut self, rate: f64, text: String) {
        let known = self.now.rain.take();
        self.now.rain = Some(match known {
            Some(known) => Datum::told(known.value + rate, format!("{}; {text}", known.basis.text())),
            None => Datum::told(rate, text),
        });
    }

    fn snow(&mut self, rate: f64, text: String) {
        if self.now.snow.is_none() {
            self.now.snow = Some(SnowRate::Told(Datum::told(rate, text)));
        }
    }

    fn hail(&mut self, rate: f64, size: Option<f64>, text: String) {
        if self.now.hail.is_none() {
            self.now.hail = Some(Datum::guess(rate, text.clone()));
            self.now.hail_size = size.map(|size| Datum::guess(size, text));
        }
    }

    /// Fog comes before mist, mist before haze, haze before the others.
    fn carry(&mut self, carrier: Carrier, code: &str) {
        let is_fog = matches!(&self.now.carrier, Some((Carrier::Droplets, Basis::Told(_))));
        if self.now.carrier.is_none() || (carrier == Carrier::Droplets && !is_fog) {
            // With snow mist says little, as falling snow is seen as mist.
            let is_mist = carrier == Carrier::Droplets && code == "BR";
            self.now.carrier = Some((carrier, if is_mist { Basis::guess(code) } else { Basis::told(code) }));
        }
    }

    fn recent(&mut self, group: &WeatherGroup) {
        let has_rain = group.has(Phenomenon::Rain) || group.has(Phenomenon::Drizzle);
        let code = group.code();
        if has_rain && self.now.rain.is_none() && self.now.rained.is_none() {
            let why = format!("RE{code}: it rained in the last hour; 30 minutes until 15 minutes ago");
            self.now.rained = Some(([30.0, 5.0, 15.0], Basis::guess(why)));
        } else {
            self.ignored.push(format!("RE{code}: it has ended"));
        }
    }

    fn sun(&mut self, metar: &Metar, options: &ReportOptions) {
        let (Some([latitude, longitude]), Some(time)) = (options.place, metar.time) else {
            self.ignored.push(
                "time of day: without the place of the station the sun is not known; it is that of the photos".into(),
            );
            return;
        };
        let universal = f64::from(time.hour) + f64::from(time.minute) / 60.0;
        let hour = (universal + longitude / 15.0).rem_euclid(24.0);
        let why =
            format!("mean solar time at longitude {longitude} of {:02}:{:02} UTC", time.hour, time.minute);
        self.now.sun = Sun::Hour { hour: Datum::told(hour, why), latitude, day: options.day };
    }
}

fn visibility_datum(seen: &MetarVisibility) -> Datum {
    match seen.bound {
        VisibilityBound::Exact => Datum::told(seen.metres, "of the report"),
        VisibilityBound::OrMore => Datum::guess(seen.metres, "the report says so far or farther"),
        VisibilityBound::Less => Datum::guess(seen.metres, "the report says less far"),
    }
}
