//! Snow on open level ground over time: what has fallen, how it settles and melts, and how wet it
//! leaves the ground.
//!
//! New snow has the density `67.92 + 51.25 exp(T / 2.59)` kg/m^3 at an air of T degrees (Hedstrom
//! and Pomeroy 1998), so that 1 mm/h of water is some 1 cm of snow an hour. It settles towards 300
//! kg/m^3 in 1 to 3 days: its volume goes there as `exp(-age / 36 h)`. It melts by 4 mm of water a
//! day for each degree above 0 (2 to 6 are seen), on open ground; what that leaves where it melts
//! slower or faster is kept beside it ([`super::thaw`]). Of a depth that is requested what it grows
//! by falls, and where it is asked to shrink all layers do.
//!
//! An instant is a sum of steps that always begin at the same times, so it does not depend on which
//! instants were asked for before.

use super::surfels::coverage;
use super::thaw::{MELT_PACES, MeltSample, Thaw};
use crate::track::Track;

/// Density that snow settles towards, kg/m^3, and how fast, h.
const SETTLED_DENSITY: f64 = 300.0;
const SETTLING_TIME_H: f64 = 36.0;
/// Density of new snow at most, kg/m^3.
const MAX_NEW_SNOW_DENSITY: f64 = 250.0;
/// Water that melts, mm per degree and hour.
const MELT_MM_PER_K_H: f64 = 4.0 / 24.0;
/// Water that stays on the ground at most, that makes it quite wet, and what dries of it where it
/// is bare, mm and mm/h.
const MAX_FILM_MM: f64 = 0.5;
const WET_FILM_MM: f64 = 0.3;
const DRYING_MM_PER_H: f64 = 0.15;
/// The share that falls off walls for each degree above 0 and hour.
const WALL_FALL_PER_K_H: f64 = 0.3;
/// Steps of what fell before the start; least length of those after it, s, and the most of them.
const EARLIER_STEP_COUNT: u32 = 256;
const MIN_STEP_S: f64 = 1.0 / 16.0;
const MAX_STEPS: f64 = 65_536.0;
/// Depth at which the steps in which what is left is told begin to widen: they are the finer the
/// thinner it lies.
const FINE_STEP_DEPTH_M: f64 = 0.01;

/// The inputs of a snowpack.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Snowpack<'a> {
    /// Depth that is requested, m, over time; `None` for what has fallen.
    pub(crate) depth: Option<&'a Track>,
    /// Water that falls as snow, mm/h, over time.
    pub(crate) rate: Option<&'a Track>,
    /// Temperature of the air, degrees Celsius, over time.
    pub(crate) temperature: &'a Track,
    /// Density of new snow, kg/m^3; `None` where it follows from the temperature.
    pub(crate) density: Option<f64>,
    /// Hours of snowfall before time 0, at its rate.
    pub(crate) hours: f64,
    /// Seconds of weather in one of the shot.
    pub(crate) lapse: f64,
}

/// Snow and water on level ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SnowStock {
    /// The snow's water, mm.
    pub(crate) water: f64,
    /// Excess volume over settled snow, m.
    loose: f64,
    /// Water on the ground, mm.
    pub(crate) film: f64,
    /// All that has melted until now, mm.
    pub(crate) melted: f64,
}

/// Snow at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SnowpackState {
    /// All that has fallen, as it would lie had none melted.
    pub(crate) fell: SnowStock,
    /// The remaining snow at each of [`MELT_PACES`]; `None` where nothing has melted yet.
    left: Option<[SnowStock; MELT_PACES.len()]>,
    /// Water of the snow that fell so wet that it still sticks, mm.
    sticks: f64,
}

/// A part of the time.
#[derive(Clone, Copy)]
struct Part {
    hours: f64,
    /// Degrees Celsius.
    temperature: f64,
    /// Water that falls as snow, mm, and its density, kg/m^3.
    water: f64,
    density: f64,
    /// The share of the loose volume that is left.
    settles: f64,
}

impl SnowStock {
    /// Depth, m.
    pub(crate) fn depth(&self) -> f64 {
        self.water / SETTLED_DENSITY + self.loose
    }

    fn fall(&mut self, part: &Part) {
        self.water += part.water;
        self.loose = self.loose * part.settles + part.water * (1.0 / part.density - 1.0 / SETTLED_DENSITY);
    }

    /// Melts up to `can` mm of what lies. Meltwater wets the ground, which dries as far as it is
    /// bare.
    fn melt(&mut self, can: f64, hours: f64) {
        let melts = can.min(self.water);
        if melts > 0.0 {
            self.loose *= 1.0 - melts / self.water;
            self.water -= melts;
            self.melted += melts;
            self.film = (self.film + melts).min(MAX_FILM_MM);
        }
        if self.film > 0.0 {
            let bare = 1.0 - f64::from(coverage(self.depth() as f32));
            self.film = (self.film - DRYING_MM_PER_H * hours * bare).max(0.0);
        }
    }

    fn shrink(&mut self, factor: f64) {
        self.water *= factor;
        self.loose *= factor;
    }
}

impl SnowpackState {
    /// Returns the remaining snow wherever something has melted, in steps too fine to be seen;
    /// `None` where nothing has.
    pub(crate) fn thaw(&self) -> Option<Thaw> {
        let step = |depth: f64| {
            FINE_STEP_DEPTH_M * (((1.0 + depth / FINE_STEP_DEPTH_M).log2() * 256.0).round() / 256.0).exp2()
                - FINE_STEP_DEPTH_M
        };
        self.left.map(|left| Thaw {
            depth: left.map(|stock| step(stock.depth()).max(0.0) as f32),
            wet: left.map(|stock| ((stock.film / WET_FILM_MM * 64.0).round() / 64.0) as f32),
        })
    }

    /// Returns the melt water until now, and the ground that is bare, at each pace.
    fn melt(&self) -> MeltSample {
        let left = self.left.unwrap_or([self.fell; MELT_PACES.len()]);
        MeltSample {
            melted: left.map(|stock| stock.melted),
            bare: left.map(|stock| 1.0 - f64::from(coverage(stock.depth() as f32))),
        }
    }

    /// Returns the depth of snow that fell so wet that it sticks to walls, m.
    pub(crate) fn wet_fall(&self) -> f64 {
        if self.fell.water > 0.0 { self.fell.depth() * (self.sticks / self.fell.water).min(1.0) } else { 0.0 }
    }

    fn pass(&mut self, part: &Part) {
        let warmth = part.temperature.max(0.0) * part.hours;
        self.sticks =
            (self.sticks + part.water * sticky(part.temperature)) * (-WALL_FALL_PER_K_H * warmth).exp();
        self.fell.fall(part);
        let can = MELT_MM_PER_K_H * warmth;
        if self.left.is_none() && can > 0.0 && self.fell.water > 0.0 {
            let mut left = [self.fell; MELT_PACES.len()];
            left.iter_mut().zip(MELT_PACES).for_each(|(stock, pace)| stock.melt(pace * can, part.hours));
            self.left = Some(left);
        } else if let Some(left) = &mut self.left {
            for (stock, pace) in left.iter_mut().zip(MELT_PACES) {
                stock.fall(part);
                stock.melt(pace * can, part.hours);
            }
        }
    }

    /// All of it is so much less.
    fn shrink(&mut self, factor: f64) {
        self.sticks *= factor;
        let left = self.left.iter_mut().flatten();
        left.chain([&mut self.fell]).for_each(|stock| stock.shrink(factor));
    }
}

/// Returns the share of snow that is wet enough to stick at a temperature, 0-1: from 1 below to 1
/// above 0.
fn sticky(temperature: f64) -> f64 {
    (2.0 - 2.0 * (temperature.abs() - 0.5)).clamp(0.0, 1.0)
}

impl Snowpack<'_> {
    /// At a time, s.
    pub(crate) fn at(&self, time: f64) -> SnowpackState {
        self.pass_until(time, |_, _| {})
    }

    /// The melt water until each of some rising times, s, the last of which is the end of the time
    /// that is looked at.
    pub(crate) fn melts(&self, times: &[f64]) -> Vec<MeltSample> {
        let Some(end) = times.last() else { return Vec::new() };
        let mut found: Vec<MeltSample> = Vec::with_capacity(times.len());
        let mut before: Option<(f64, MeltSample)> = None;
        self.pass_until(*end, |time, pack| {
            let now = pack.melt();
            while let Some(wanted) = times.get(found.len()).filter(|wanted| **wanted <= time) {
                let sample = before.as_ref().map_or(now, |(from, earlier)| {
                    earlier.between(&now, (wanted - from) / (time - from).max(1e-12))
                });
                found.push(sample);
            }
            before = Some((time, now));
        });
        found
    }

    /// Follows the snow until a time, s, and shows it at the start of the shot and after each step.
    fn pass_until(&self, time: f64, mut see: impl FnMut(f64, &SnowpackState)) -> SnowpackState {
        let number = |track: &Track, time: f64| track.at(time).number().unwrap_or(0.0);
        let mut pack = SnowpackState::default();
        let part = |time: f64, hours: f64, water: f64| {
            let temperature = number(self.temperature, time);
            let new = || (67.92 + 51.25 * (temperature / 2.59).exp()).min(MAX_NEW_SNOW_DENSITY);
            // What is requested is as deep as it lies.
            let settles = if self.depth.is_some() { 1.0 } else { (-hours / SETTLING_TIME_H).exp() };
            Part { hours, temperature, water, density: self.density.unwrap_or_else(new), settles }
        };
        // What a depth that is requested has grown or shrunk by; it falls at once, and then melts.
        let mut depth = 0.0;
        let mut ask = |pack: &mut SnowpackState, track: &Track, time: f64| {
            let before = std::mem::replace(&mut depth, number(track, time));
            if depth > before {
                let part = part(time, 0.0, 0.0);
                pack.pass(&Part { water: (depth - before) * part.density, ..part });
            } else if depth < before {
                pack.shrink(depth / before);
            }
        };
        match self.depth {
            Some(track) => ask(&mut pack, track, time.min(0.0)),
            None => {
                let hours = (self.hours + time.min(0.0) * self.lapse / 3600.0).max(0.0)
                    / f64::from(EARLIER_STEP_COUNT);
                let first = self.rate.map_or(0.0, |rate| number(rate, 0.0));
                for _ in 0..EARLIER_STEP_COUNT {
                    pack.pass(&part(0.0, hours, first * hours));
                }
            }
        }
        see(time.min(0.0), &pack);
        let mut step = MIN_STEP_S;
        while time / step > MAX_STEPS {
            step *= 2.0;
        }
        let steps = (time.max(0.0) / step).ceil() as u32;
        for k in 0..steps {
            let (from, to) = (f64::from(k) * step, (f64::from(k + 1) * step).min(time));
            let hours = (to - from) * self.lapse / 3600.0;
            if let Some(track) = self.depth {
                ask(&mut pack, track, to);
            }
            let rate = self.rate.filter(|_| self.depth.is_none());
            let water = rate.map_or(0.0, |rate| rate.integral(from, to) * self.lapse / 3600.0);
            pack.pass(&part(0.5 * (from + to), hours, water));
            see(to, &pack);
        }
        pack
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use proptest::prelude::*;

    impl SnowpackState {
        /// Returns the remaining snow on open level ground.
        pub(crate) fn open(&self) -> SnowStock {
            self.left.map_or(self.fell, |left| left[crate::cover::thaw::tests::OPEN_GROUND_PACE])
        }
    }

    fn track(param: &str, text: &str) -> Track {
        testing::track("snow_cover", param, text)
    }

    fn snow(text: &str) -> Track {
        testing::track("snowfall", "rate", text)
    }

    /// Snow that falls from the start on, an hour a second.
    fn falling<'a>(rate: &'a Track, temperature: &'a Track) -> Snowpack<'a> {
        Snowpack { depth: None, rate: Some(rate), temperature, density: None, hours: 0.0, lapse: 3600.0 }
    }

    #[test]
    fn a_millimetre_of_water_is_a_centimetre_of_new_snow() {
        let (rate, temperature) = (snow("1"), track("temperature", "-1.5"));
        let pack =
            |density, hours, time| Snowpack { density, hours, ..falling(&rate, &temperature) }.at(time);
        // 3 h before the start and 1 h after it.
        let new = pack(Some(100.0), 3.0, 1.0);
        assert!((new.fell.water - 4.0).abs() < 1e-9 && new.thaw().is_none(), "{new:?}");
        assert!((new.fell.depth() / 0.04 - 1.0).abs() < 0.05, "{new:?}");
        assert!((pack(None, 4.0, 0.0).fell.depth() / 0.04 - 1.0).abs() < 0.1);
        // It settles to a third in some days.
        let after = |hours: f64| {
            let stops = snow("0:1,1:1:hold,1.01:0");
            let pack = Snowpack { density: Some(100.0), hours: 3.0, ..falling(&stops, &temperature) };
            pack.at(1.0 + hours).fell.depth()
        };
        let depths = [0.0, 12.0, 36.0, 120.0].map(after);
        println!("{depths:.4?}");
        assert!(depths.windows(2).all(|pair| pair[1] < pair[0]) && (depths[3] / (4.0 / 300.0) - 1.0) < 0.1);
        // The closed form of constant snow: what is loose decays.
        let tau = SETTLING_TIME_H;
        let loose = (1.0 / 100.0 - 1.0 / SETTLED_DENSITY) * tau * (1.0 - (-4.0 / tau).exp());
        assert!((new.fell.depth() - (4.0 / SETTLED_DENSITY + loose)).abs() < 2e-4);
    }

    /// A depth that is requested, an hour a second.
    fn pack_of_depth(depth: &str, temperature: &str, time: f64) -> SnowpackState {
        let (depth, temperature) = (track("depth", depth), track("temperature", temperature));
        let (density, lapse) = (Some(100.0), 3600.0);
        let depth = Some(&depth);
        Snowpack { depth, rate: None, temperature: &temperature, density, hours: 0.0, lapse }.at(time)
    }

    /// Returns the remaining snow where it melts half as fast as in the open.
    fn shaded(pack: &SnowpackState) -> SnowStock {
        let place = MELT_PACES.iter().position(|pace| *pace == 0.5).unwrap();
        pack.left.map_or(pack.fell, |left| left[place])
    }

    #[test]
    fn warm_air_melts_it_and_leaves_the_ground_wet_for_a_while() {
        let at = |time: f64| pack_of_depth("0.02", "0:-5,2:-5,3:6", time);
        assert!(at(2.0).thaw().is_none() && (at(2.0).fell.depth() - 0.02).abs() < 1e-12);
        // 2 mm of water melt by 1 mm/h from 3 h on, and some before.
        let half = at(3.73);
        assert!((half.open().depth() / 0.01 - 1.0).abs() < 0.1 && half.open().film > WET_FILM_MM, "{half:?}");
        assert!((shaded(&half).depth() / 0.015 - 1.0).abs() < 0.1, "{half:?}");
        // The open is bare at 4.7 h and the shade at 6.7 h; both are dry 3 h later.
        assert_eq!(at(4.9).open().depth(), 0.0);
        assert!(shaded(&at(4.9)).depth() > 0.005 && shaded(&at(6.9)).depth() == 0.0);
        assert!(at(6.0).open().film > 0.2 && at(8.3).open().film == 0.0);
        assert!(shaded(&at(8.0)).film > 0.2 && shaded(&at(10.3)).film == 0.0);
        // In the end nothing is left, and nothing is laid out.
        assert!(!at(20.0).thaw().unwrap().is_over() && at(100.0).thaw().unwrap().is_over());
    }

    #[test]
    fn what_comes_down_on_bare_ground_is_new() {
        let at = |time: f64| pack_of_depth("0:0.02,10:0.02,11:0.05,20:0.05,21:0", "6", time);
        // 2 cm are gone after 2 h in the open and after 4 h in the shade.
        assert!(at(3.0).open().depth() == 0.0 && shaded(&at(3.0)).depth() > 0.004);
        assert_eq!(shaded(&at(5.0)).depth(), 0.0);
        // 3 cm more, of which 1 cm an hour melts.
        assert!((at(11.0).open().depth() - 0.02).abs() < 0.002, "{:?}", at(11.0).open());
        assert!((at(12.0).open().depth() - 0.01).abs() < 0.002);
        assert_eq!(at(21.0).fell.depth(), 0.0);
        // Cold air does not melt what fell in it when it was warm.
        let falls = |time: f64| pack_of_depth("0.1", "0:6,3:6,4:-10", time).open().depth();
        assert!((falls(5.0) - falls(9.0)).abs() < 1e-12 && falls(5.0) > 0.05);
    }

    /// Snow, a thaw that bares the open ground and not the shade, and snow again.
    #[test]
    fn new_snow_lies_on_bare_ground_and_on_old_snow() {
        let (rate, temperature) =
            (snow("0:2,3:2,3.1:0,9:0,9.1:2"), track("temperature", "0:-3,3:-3,4:6,9:6,9.1:-3"));
        let at = |time: f64| Snowpack { hours: 1.0, ..falling(&rate, &temperature) }.at(time);
        // Some 8.1 mm fall; 5.5 mm can melt by 9 h. So 3 mm before the start and 1 h less of it are
        // gone by then.
        let (bare, again) = (at(9.0), at(10.1));
        println!("{:?} {:?} {:?} {:?}", bare.open(), shaded(&bare), again.open(), shaded(&again));
        assert!((bare.fell.water - 8.1).abs() < 1e-6);
        assert!(bare.open().water > 2.0 && shaded(&bare).water > bare.open().water + 2.0);
        assert!((again.open().water - bare.open().water - 2.1).abs() < 0.1);
        // Twice as fast, as a place that gets half of it: bare at 9 h, and white an hour later.
        let place = MELT_PACES.iter().position(|pace| *pace == 2.0).unwrap();
        let [thin, new] = [&bare, &again].map(|pack| pack.left.unwrap()[place]);
        assert!(thin.water == 0.0 && thin.film > 0.0 && (new.water - 2.05).abs() < 0.1, "{thin:?} {new:?}");
        // Its density is that of new snow.
        assert!(new.depth() / new.water > 0.0095, "{new:?}");
    }

    /// Keyframes 3 s apart.
    fn keys(values: &[f64]) -> String {
        let keys = values.iter().enumerate().map(|(k, v)| format!("{}:{v}", 3 * k));
        keys.collect::<Vec<_>>().join(",")
    }

    proptest! {
        #[test]
        fn what_fell_lies_or_has_melted(
            rates in prop::collection::vec(0.0..5.0f64, 2..5),
            temperatures in prop::collection::vec(-8.0..8.0f64, 2..5),
            hours in 0.0..20.0f64,
            time in -2.0..12.0f64,
        ) {
            let (rate, temperature) = (snow(&keys(&rates)), track("temperature", &keys(&temperatures)));
            let pack = Snowpack { hours, ..falling(&rate, &temperature) }.at(time);
            let before = (hours + time.min(0.0)).max(0.0) * rates[0];
            let fell = before + rate.integral(0.0, time.max(0.0));
            prop_assert!((pack.fell.water - fell).abs() < 1e-6 * fell.max(1.0), "{pack:?} {fell}");
            // What is open melts by the degrees that there were, as far as it has any snow, and the
            // slower the more is left.
            let warm: Vec<f64> = (0..1200).map(|k| 0.01 * f64::from(k) + 0.005).filter(|at| *at < time)
                .map(|at| temperature.at(at).number().unwrap().max(0.0) * 0.01).collect();
            let before_start = temperatures[0].max(0.0) * (hours + time.min(0.0)).max(0.0);
            let can = MELT_MM_PER_K_H * (warm.iter().sum::<f64>() + before_start);
            let left = pack.open().water;
            prop_assert!(left > fell - can - 0.05 && left < fell + 1e-6, "{pack:?} {fell} {can}");
            if let Some(left) = pack.left {
                prop_assert!(left.windows(2).all(|pair| pair[1].water <= pair[0].water));
                prop_assert!(left.iter().all(|stock| stock.depth() >= 0.0 && stock.film >= 0.0));
            }
        }

        /// No jumps: in a minute no more changes than can fall and melt, nor dries than can dry.
        #[test]
        fn it_changes_evenly(
            rates in prop::collection::vec(0.0..5.0f64, 2..5),
            temperatures in prop::collection::vec(-8.0..8.0f64, 2..5),
            time in 0.0..12.0f64,
        ) {
            let (rate, temperature) = (snow(&keys(&rates)), track("temperature", &keys(&temperatures)));
            let snow = Snowpack { hours: 2.0, ..falling(&rate, &temperature) };
            let [first, next] = [0.0, 1.0 / 60.0].map(|later| snow.at(time + later));
            let all = |pack: &SnowpackState| pack.left.unwrap_or([pack.fell; MELT_PACES.len()]);
            for ((a, b), pace) in all(&first).iter().zip(all(&next)).zip(MELT_PACES) {
                // 5 mm/h of new snow, 8 degrees of melt, and some settling.
                let most = (5.0 + 8.0 * MELT_MM_PER_K_H * pace) / 60.0;
                prop_assert!((a.water - b.water).abs() <= most, "{a:?} {b:?}");
                // Snow that falls at 3 degrees has 231 kg/m^3, at -8 degrees 70; of old snow a mm
                // of water is that deep too.
                prop_assert!((a.depth() - b.depth()).abs() <= most / 67.0 + 0.001 * a.depth(), "{a:?} {b:?}");
                let most_film = most.max(DRYING_MM_PER_H / 60.0) + 1e-9;
                prop_assert!((a.film - b.film).abs() <= most_film, "{a:?} {b:?}");
            }
        }
    }
}
