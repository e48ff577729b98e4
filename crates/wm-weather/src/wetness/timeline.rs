//! The rain of a weather, and the drying after it, as steps until an instant.

use super::column::WetStep;
use crate::track::Track;

/// Steps of the rain before the start, and of the dry time after that.
const BEFORE: u32 = 96;
const STOPPED: u32 = 48;
/// The first steps after the start, s, and the number of steps after which they are twice as long.
const STEP: f64 = 0.125;
const EACH: u32 = 64;

/// Rain over the time of a weather.
#[derive(Clone, Copy, Debug)]
pub struct RainHistory<'a> {
    /// Rain, mm/h, over time; `None` for none.
    pub rate: Option<&'a Track>,
    /// Rain before time 0, mm/h, and for how long, h.
    pub before: [f64; 2],
    /// Time between its end and time 0, h.
    pub stopped: f64,
    /// Drying while it rains and while it does not, mm/h.
    pub drying: [f64; 2],
    /// Seconds of wetting and drying in one of the shot.
    pub lapse: f64,
}

impl RainHistory<'_> {
    /// The steps until `time`, s.
    #[must_use]
    pub fn steps(&self, time: f64) -> Vec<WetStep> {
        let mut steps = Vec::new();
        let mut even = |hours: f64, count: u32, rate: f64| {
            if hours > 0.0 {
                let hours = hours / f64::from(count);
                let dries = hours * self.drying[usize::from(rate <= 0.0)];
                let step = WetStep { hours, rain: rate * hours, dries };
                steps.extend(std::iter::repeat_n(step, count as usize));
            }
        };
        // Before the start the weather is as at the start, but for its own rain.
        let early = (time.min(0.0) * self.lapse / 3600.0).abs();
        even(self.before[1] - (early - self.stopped).max(0.0), BEFORE, self.before[0]);
        even(self.stopped - early, STOPPED, 0.0);
        let (mut from, mut length, mut count) = (0.0, STEP, 0);
        while from < time {
            let to = (from + length).min(time);
            let hours = (to - from) * self.lapse / 3600.0;
            let rain = self.rate.map_or(0.0, |rate| rate.integral(from, to)).max(0.0) * self.lapse / 3600.0;
            let dries = hours * self.drying[usize::from(rain <= 0.0)];
            steps.push(WetStep { hours, rain, dries });
            from = to;
            count += 1;
            if count % EACH == 0 {
                length *= 2.0;
            }
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wetness::column::{Drainage, WetColumns};

    fn rate(text: &str) -> Track {
        let params = crate::effects::rain::EFFECT.params;
        Track::parse(params.iter().find(|param| param.name == "rate").unwrap(), text).unwrap()
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

    /// No jumps from one frame to the next.
    #[test]
    fn wetness_goes_on_evenly() {
        let rate = rate("0:0,2:40,30:0");
        let history = RainHistory {
            rate: Some(&rate),
            before: [0.0; 2],
            stopped: 0.0,
            drying: [0.0, 0.3],
            lapse: 60.0,
        };
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
