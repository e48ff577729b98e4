//! The rain of a weather, its melting snow, and the drying after both, as steps until an instant.

use super::column::{SnowStep, WetStep};
use crate::cover::{MeltSample, Snowpack};
use crate::track::Track;

/// Steps of the rain before the start, and of the dry time after that.
const RAIN_STEP_COUNT: u32 = 96;
const DRY_STEP_COUNT: u32 = 48;
/// The first steps after the start, s, and the number of steps after which they are twice as long.
const FIRST_STEP_S: f64 = 0.125;
const STEPS_PER_DOUBLING: usize = 64;

/// Rain over the time of a weather.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RainHistory<'a> {
    /// Rain, mm/h, over time; `None` for none.
    pub(crate) rate: Option<&'a Track>,
    /// Rain before time 0, mm/h, and for how long, h.
    pub(crate) before: [f64; 2],
    /// Time between its end and time 0, h.
    pub(crate) stopped: f64,
    /// Drying while it rains and while it does not, mm/h.
    pub(crate) drying: [f64; 2],
    /// Seconds of wetting and drying in one of the shot.
    pub(crate) lapse: f64,
    /// Snow that lies and melts; `None` for none.
    pub(crate) snow: Option<Snowpack<'a>>,
}

impl RainHistory<'_> {
    /// The steps until `time`, s.
    pub(crate) fn steps(&self, time: f64) -> Vec<WetStep> {
        let (mut times, mut length) = (vec![time.min(0.0)], FIRST_STEP_S);
        while times[times.len() - 1] < time {
            times.push((times[times.len() - 1] + length).min(time));
            if (times.len() - 1).is_multiple_of(STEPS_PER_DOUBLING) {
                length *= 2.0;
            }
        }
        let melts = self.snow.map(|snow| snow.melts(&times)).unwrap_or_default();
        let mut steps = Vec::new();
        let mut even = |hours: f64, count: u32, rate: f64, snow: SnowStep| {
            if hours > 0.0 {
                let hours = hours / f64::from(count);
                let dries = hours * self.drying[usize::from(rate <= 0.0)];
                let snow = snow.divided(f64::from(count));
                let step = WetStep { hours, rain: rate * hours, dries, snow };
                steps.extend(std::iter::repeat_n(step, count as usize));
            }
        };
        // Snow that melted before the start did so while it fell.
        if let (Some(snow), Some(melted)) = (&self.snow, melts.first()) {
            let since = SnowStep::between(&MeltSample::NONE, melted);
            even(if since == SnowStep::default() { 0.0 } else { snow.hours }, RAIN_STEP_COUNT, 0.0, since);
        }
        let start = melts.first().map_or_else(SnowStep::default, |sample| SnowStep::between(sample, sample));
        // Before the start the weather is as at the start, but for its own rain.
        let early = (time.min(0.0) * self.lapse / 3600.0).abs();
        even(self.before[1] - (early - self.stopped).max(0.0), RAIN_STEP_COUNT, self.before[0], start);
        even(self.stopped - early, DRY_STEP_COUNT, 0.0, start);
        for (index, ends) in times.windows(2).enumerate() {
            let [from, to] = [ends[0], ends[1]];
            let hours = (to - from) * self.lapse / 3600.0;
            let rain = self.rate.map_or(0.0, |rate| rate.integral(from, to)).max(0.0) * self.lapse / 3600.0;
            let dries = hours * self.drying[usize::from(rain <= 0.0)];
            let snow = melts.get(index..index + 2);
            let snow = snow.map_or_else(SnowStep::default, |ends| SnowStep::between(&ends[0], &ends[1]));
            steps.push(WetStep { hours, rain, dries, snow });
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use crate::wetness::column::{Drainage, WetColumns};

    fn rate(text: &str) -> Track {
        testing::track("rain", "rate", text)
    }

    #[test]
    fn steps_hold_all_the_rain_until_an_instant() {
        let rate = rate("0:0,60:30,200:5");
        let history = RainHistory {
            rate: Some(&rate),
            before: [12.0, 0.5],
            stopped: 0.25,
            drying: [0.0, 0.3],
            lapse: 2.0,
            snow: None,
        };
        for time in [0.0, 3.0, 59.0, 400.0] {
            let steps = history.steps(time);
            let rain: f64 = steps.iter().map(|step| step.rain).sum();
            let hours: f64 = steps.iter().map(|step| step.hours).sum();
            let want = 6.0 + rate.integral(0.0, time) * 2.0 / 3600.0;
            assert!((rain - want).abs() < 1e-9, "{time}: {rain} {want}");
            assert!((hours - 0.75 - time * 2.0 / 3600.0).abs() < 1e-12);
        }
    }

    fn snow(param: &str, text: &str) -> Track {
        testing::track("snow_cover", param, text)
    }

    /// 4 cm of snow of 100 kg/m^3 are 4 mm of water, which melt at 5 degrees in 4.8 h.
    #[test]
    fn melt_water_is_the_water_of_the_snow() {
        let (depth, temperature) = (snow("depth", "0.04"), snow("temperature", "5"));
        let pack = Snowpack {
            depth: Some(&depth),
            rate: None,
            temperature: &temperature,
            density: Some(100.0),
            hours: 0.0,
            lapse: 3600.0,
        };
        let history =
            RainHistory { drying: [0.0, 0.2], lapse: 3600.0, snow: Some(pack), ..RainHistory::default() };
        let mut last = 0.0;
        for time in [0.0, 1.0, 2.4, 3.3, 5.6, 30.0] {
            let columns = WetColumns::dry(0.8).after(&history.steps(time));
            let column = columns.column(Drainage::Level, 1.0);
            let want = (4.0 / 24.0 * 5.0 * time).min(4.0);
            assert!((column.came - want).abs() <= 0.005 * want, "{time}: {column:?} {want}");
            let there = column.pores + column.store + column.ran_off + column.dried;
            assert!((there - column.came).abs() < 1e-9);
            // Nothing dries under snow but where it is thin.
            assert!(time > 4.0 || column.dried < 0.1, "{time}: {column:?}");
            assert!(column.came >= last);
            last = column.came;
            // Where half of the snow lies half of the water comes, by the end.
            let half = columns.column(Drainage::Level, 0.5).came;
            assert!(time < 6.0 || (half - 2.0).abs() < 0.02, "{time}: {half}");
        }
        let wet = |time: f64| WetColumns::dry(0.8).after(&history.steps(time)).wet(Drainage::Level, 1.0);
        assert!(wet(0.0).pores == 0.0 && wet(2.0).film > 0.1 && wet(30.0) == Default::default());
        // Snow that has melted before the start.
        let rate = testing::track("snowfall", "rate", "2");
        let pack = Snowpack { depth: None, rate: Some(&rate), hours: 12.0, ..pack };
        let columns = WetColumns::dry(0.8).after(&RainHistory { snow: Some(pack), ..history }.steps(0.0));
        let came = columns.column(Drainage::Level, 1.0).came;
        assert!((came - 10.0).abs() < 0.1, "{came}");
    }

    /// No jumps from one frame to the next.
    #[test]
    fn wetness_goes_on_evenly() {
        let rate = rate("0:0,2:40,30:0");
        let history =
            RainHistory { rate: Some(&rate), drying: [0.0, 0.3], lapse: 60.0, ..RainHistory::default() };
        let at = |time: f64| WetColumns::dry(0.8).after(&history.steps(time)).column(Drainage::Level, 1.0);
        for step in 0..300 {
            let time = 0.2 * f64::from(step);
            let [a, b] = [at(time), at(time + 0.04)];
            // 40 mm/h for 2.4 s come or run off.
            assert!(
                (a.store - b.store).abs() < 0.04 && (a.pores - b.pores).abs() < 0.03,
                "{time}: {a:?} {b:?}"
            );
        }
    }
}
