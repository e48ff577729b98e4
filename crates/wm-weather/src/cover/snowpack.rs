//! Snow on open level ground over time: what has fallen, how it settles and melts, and how wet it leaves the ground.
//!
//! New snow has the density `67.92 + 51.25 exp(T / 2.59)` kg/m^3 at an air of T degrees (Hedstrom and Pomeroy 1998), so
//! that 1 mm/h of water is some 1 cm of snow an hour. It settles towards 300 kg/m^3 in 1 to 3 days: its volume goes there
//! as `exp(-age / 36 h)`. It melts by 4 mm of water a day for each degree above 0 (2 to 6 are seen).
//!
//! An instant is a sum of steps that always begin at the same times, so it does not depend on which instants were asked
//! for before.

use crate::track::Track;

/// Density that snow settles towards, kg/m^3, and how fast, h.
const SETTLED: f64 = 300.0;
const SETTLES: f64 = 36.0;
/// Density of new snow at most, kg/m^3.
const DENSEST: f64 = 250.0;
/// Water that melts, mm a degree and hour.
const MELT: f64 = 4.0 / 24.0;
/// Water that stays on the ground at most, that makes it quite wet, and what dries of it, mm and mm/h.
const FILM: f64 = 0.5;
const WET: f64 = 0.3;
const DRIES: f64 = 0.15;
/// What falls off walls, a share for each degree above 0 and hour.
const FALLS: f64 = 0.3;
/// Steps of what fell before the start; length of those after it, s, and the most of them.
const BEFORE: u32 = 256;
const STEP: f64 = 1.0 / 16.0;
const MOST: f64 = 65_536.0;

/// What snow comes from.
#[derive(Clone, Copy, Debug)]
pub struct Snowpack<'a> {
    /// Depth that is asked for, m; `None` for what has fallen.
    pub depth: Option<f64>,
    /// Water that falls as snow, mm/h, over time.
    pub rate: Option<&'a Track>,
    /// Of the air, degrees Celsius, over time.
    pub temperature: &'a Track,
    /// Of new snow, kg/m^3; `None` for that of the temperature.
    pub density: Option<f64>,
    /// How long it had snowed before time 0, as it does then, h.
    pub hours: f64,
    /// Seconds of weather in one of the shot.
    pub lapse: f64,
}

/// Snow at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pack {
    /// Water that has fallen since the ground was bare, mm.
    pub water: f64,
    /// What has melted of it, mm.
    pub melted: f64,
    /// What of it fell so wet that it sticks, and still does, mm.
    sticks: f64,
    /// How deep all that has fallen would lie, m.
    pub depth: f64,
    /// What it has more in volume than settled snow, m.
    loose: f64,
    /// Water on the ground, mm.
    film: f64,
    /// All that has fallen and melted from the beginning, mm.
    pub total: [f64; 2],
}

impl Pack {
    /// What has melted, in m of the snow as it lies.
    #[must_use]
    pub fn melted_depth(&self) -> f64 {
        if self.water > 0.0 { self.depth * (self.melted / self.water).min(1.0) } else { 0.0 }
    }

    /// What fell so wet that it sticks to walls, in m of the snow as it lies.
    #[must_use]
    pub fn wet_fall(&self) -> f64 {
        if self.water > 0.0 { self.depth * (self.sticks / self.water).min(1.0) } else { 0.0 }
    }

    /// How wet the ground is where the snow has melted, 0-1.
    #[must_use]
    pub fn wet(&self) -> f64 {
        (self.film / WET).min(1.0)
    }

    /// `hours` pass at a temperature, in which some mm of water fall as snow of a density.
    fn pass(&mut self, hours: f64, water: f64, density: f64, temperature: f64) {
        self.water += water;
        self.total[0] += water;
        self.sticks =
            (self.sticks + water * sticky(temperature)) * (-FALLS * temperature.max(0.0) * hours).exp();
        self.loose *= (-hours / SETTLES).exp();
        self.loose += water * (1.0 / density - 1.0 / SETTLED);
        let melts = (MELT * temperature.max(0.0) * hours).min(self.water - self.melted);
        self.melted += melts;
        self.total[1] += melts;
        self.film = (self.film + melts).min(FILM);
        if self.melted >= self.water {
            // Bare: the next snow is new.
            *self = Self { film: (self.film - DRIES * hours).max(0.0), total: self.total, ..Self::default() };
        }
    }
}

/// How much of what falls at a temperature is wet enough to stick, 0-1: from 1 below to 1 above 0.
fn sticky(temperature: f64) -> f64 {
    (2.0 - 2.0 * (temperature.abs() - 0.5)).clamp(0.0, 1.0)
}

impl Snowpack<'_> {
    /// At a time, s.
    #[must_use]
    pub fn at(&self, time: f64) -> Pack {
        let temperature = |time: f64| self.temperature.at(time).number().unwrap_or(0.0);
        let density = |time: f64| {
            let new = || (67.92 + 51.25 * (temperature(time) / 2.59).exp()).min(DENSEST);
            self.density.unwrap_or_else(new)
        };
        let mut pack = Pack::default();
        let rate = self.rate.filter(|_| self.depth.is_none());
        match self.depth {
            Some(depth) => {
                pack.water = depth * density(time);
                pack.sticks = pack.water * sticky(temperature(0.0));
            }
            None => {
                let hours = (self.hours + time.min(0.0) * self.lapse / 3600.0).max(0.0) / f64::from(BEFORE);
                let first = rate.and_then(|rate| rate.at(0.0).number()).unwrap_or(0.0);
                for _ in 0..BEFORE {
                    pack.pass(hours, first * hours, density(0.0), temperature(0.0));
                }
            }
        }
        let mut step = STEP;
        while time / step > MOST {
            step *= 2.0;
        }
        let steps = (time.max(0.0) / step).ceil() as u32;
        for k in 0..steps {
            let (from, to) = (f64::from(k) * step, (f64::from(k + 1) * step).min(time));
            let (middle, hours) = (0.5 * (from + to), (to - from) * self.lapse / 3600.0);
            let water = rate.map_or(0.0, |rate| rate.integral(from, to) * self.lapse / 3600.0);
            pack.pass(hours, water, density(middle), temperature(middle));
        }
        pack.depth = match self.depth {
            // What has melted is gone from it, all of it at most.
            Some(depth) if pack.water == 0.0 => {
                pack.water = 1.0;
                pack.melted = 1.0;
                depth
            }
            Some(depth) => depth,
            None => pack.water / SETTLED + pack.loose,
        };
        pack
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::snow_cover::Params;
    use proptest::prelude::*;

    fn track(param: &str, text: &str) -> Track {
        Track::parse(Params::PARAMS.iter().find(|p| p.name == param).unwrap(), text).unwrap()
    }

    fn snow(text: &str) -> Track {
        let params = crate::effects::snowfall::EFFECT.params;
        Track::parse(params.iter().find(|p| p.name == "rate").unwrap(), text).unwrap()
    }

    #[test]
    fn a_millimetre_of_water_is_a_centimetre_of_new_snow() {
        let (rate, temperature) = (snow("1"), track("temperature", "-1.5"));
        let pack = |density, hours, time| {
            let temperature = &temperature;
            Snowpack { depth: None, rate: Some(&rate), temperature, density, hours, lapse: 3600.0 }.at(time)
        };
        // 3 h before the start and 1 h after it.
        let new = pack(Some(100.0), 3.0, 1.0);
        assert!((new.water - 4.0).abs() < 1e-9 && new.melted == 0.0, "{new:?}");
        assert!((new.depth / 0.04 - 1.0).abs() < 0.05, "{new:?}");
        assert!((pack(None, 4.0, 0.0).depth / 0.04 - 1.0).abs() < 0.1);
        // It settles to a third in some days.
        let after = |hours: f64| {
            let stops = snow("0:1,1:1:hold,1.01:0");
            let temperature = &temperature;
            let pack = Snowpack {
                depth: None,
                rate: Some(&stops),
                temperature,
                density: Some(100.0),
                hours: 3.0,
                lapse: 3600.0,
            };
            pack.at(1.0 + hours).depth
        };
        let depths = [0.0, 12.0, 36.0, 120.0].map(after);
        println!("{depths:.4?}");
        assert!(depths.windows(2).all(|pair| pair[1] < pair[0]) && (depths[3] / (4.0 / 300.0) - 1.0) < 0.1);
        // The closed form of constant snow: what is loose decays.
        let tau = SETTLES;
        let loose = (1.0 / 100.0 - 1.0 / SETTLED) * tau * (1.0 - (-4.0 / tau).exp());
        assert!((new.depth - (4.0 / SETTLED + loose)).abs() < 2e-4);
    }

    #[test]
    fn warm_air_melts_it_and_leaves_the_ground_wet_for_a_while() {
        let temperature = track("temperature", "0:-5,2:-5,3:6");
        let at = |time: f64| {
            Snowpack {
                depth: Some(0.02),
                rate: None,
                temperature: &temperature,
                density: Some(100.0),
                hours: 0.0,
                lapse: 3600.0,
            }
            .at(time)
        };
        assert_eq!((at(2.0).melted_depth(), at(2.0).wet()), (0.0, 0.0));
        // 2 mm of water melt by 1 mm/h from 3 h on, and some before.
        let half = at(3.73);
        assert!((half.melted_depth() / 0.01 - 1.0).abs() < 0.1 && half.wet() == 1.0, "{half:?}");
        assert_eq!((at(6.0).melted_depth(), at(6.0).depth), (0.02, 0.02));
        assert!(at(6.0).wet() > 0.5 && at(12.0).wet() == 0.0);
    }

    proptest! {
        #[test]
        fn what_fell_lies_or_has_melted(
            rates in prop::collection::vec(0.0..5.0f64, 2..5),
            temperatures in prop::collection::vec(-8.0..8.0f64, 2..5),
            hours in 0.0..20.0f64,
            time in -2.0..12.0f64,
        ) {
            let keys = |values: &[f64]| {
                let keys = values.iter().enumerate().map(|(k, v)| format!("{}:{v}", 3 * k));
                keys.collect::<Vec<_>>().join(",")
            };
            let (rate, temperature) = (snow(&keys(&rates)), track("temperature", &keys(&temperatures)));
            let lapse = 3600.0;
            let pack = Snowpack {
                depth: None, rate: Some(&rate), temperature: &temperature, density: None, hours, lapse,
            }.at(time);
            let before = (hours + time.min(0.0)).max(0.0) * rates[0];
            let fell = before + rate.integral(0.0, time.max(0.0));
            prop_assert!((pack.total[0] - fell).abs() < 1e-6 * fell.max(1.0), "{pack:?} {fell}");
            let lies = pack.water - pack.melted;
            prop_assert!((lies + pack.total[1] - fell).abs() < 1e-6 * fell.max(1.0), "{pack:?} {fell}");
            prop_assert!(pack.depth >= 0.0 && pack.melted_depth() <= pack.depth);
        }
    }
}
