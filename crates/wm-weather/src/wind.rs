//! The wind: a mean that the weather file says, and gusts about it.
//!
//! Gusts are a sum of waves whose strength falls with frequency as in Kaimal's spectrum (1972),
//! `S ~ 1 / (1 + 6 n)^(5/3)`, `n = f L / U`, along the wind and, half as strong, across. They are a
//! pure function of time, and so is how far the air has come: each wave has its integral. Where
//! speed or direction change over time it is the sum of Gauss-Legendre steps of at most a quarter
//! of a second from 0 on, whatever frames are requested.

use crate::param::ParamValue;
use crate::track::Track;
use glam::DVec2;
use std::f64::consts::TAU;
use wm_base::random::uniform;

/// Waves in each direction.
const WAVE_COUNT: usize = 12;
/// Slowest and fastest waves.
const FREQUENCY_LIMITS_HZ: [f64; 2] = [0.02, 1.5];
/// Length over speed that the spectrum goes by.
const SPECTRUM_LENGTH_M: f64 = 30.0;
/// Gusts across the wind, as a share of those along it.
const CROSSWIND_SHARE: f64 = 0.5;
const MAX_STEP_S: f64 = 0.25;

/// A gust's wave: amplitude, angular frequency, phase.
type Wave = [f64; 3];

/// A wind over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Wind {
    speed: Track,
    direction: Track,
    /// Gusts along and across the wind, of a strength of 1.
    waves: [Vec<Wave>; 2],
    gusts: f64,
}

impl Wind {
    /// Speed in m/s and heading in degrees (where it blows to, counted from the first level axis
    /// towards the second) over time; `gusts` is the standard deviation of the speed as a share of
    /// it.
    pub(crate) fn new(speed: Track, direction: Track, gusts: f64, seed: u64) -> Self {
        // The strength of waves goes by the typical speed of the whole time.
        let typical = speed.most().max(0.5);
        let [slowest, fastest] = FREQUENCY_LIMITS_HZ;
        let ratio = (fastest / slowest).powf(1.0 / (WAVE_COUNT - 1) as f64);
        let waves = [0u64, 1].map(|way| {
            let mut waves: Vec<Wave> = (0..WAVE_COUNT)
                .map(|i| {
                    let draw = |k: u64| uniform(seed ^ 0x9057_5000, 100 * way + 2 * i as u64 + k);
                    // A little off the row, so that they never come together again.
                    let f = slowest * ratio.powf(i as f64 + 0.6 * (draw(0) - 0.5));
                    let power = f / (1.0 + 6.0 * f * SPECTRUM_LENGTH_M / typical).powf(5.0 / 3.0);
                    [power.sqrt(), TAU * f, TAU * draw(1)]
                })
                .collect();
            let variance: f64 = waves.iter().map(|wave| 0.5 * wave[0] * wave[0]).sum();
            let scale = if way == 0 { 1.0 } else { CROSSWIND_SHARE } / variance.sqrt();
            waves.iter_mut().for_each(|wave| wave[0] *= scale);
            waves
        });
        Self { speed, direction, waves, gusts }
    }

    /// The mean wind without gusts, m/s along the two level axes.
    pub(crate) fn mean(&self, time: f64) -> [f64; 2] {
        let (sin, cos) = number(&self.direction.at(time)).to_radians().sin_cos();
        let speed = number(&self.speed.at(time));
        [speed * cos, speed * sin]
    }

    /// The wind, m/s along the two level axes.
    pub(crate) fn at(&self, time: f64) -> [f64; 2] {
        let along = |wave: &Wave| wave[0] * (wave[1] * time + wave[2]).cos();
        let [a, b] = self.waves.each_ref().map(|waves| self.gusts * waves.iter().map(along).sum::<f64>());
        turned(self.mean(time), [1.0 + a, b])
    }

    /// Returns the distance that the air has travelled since time 0, m along the two level axes.
    pub(crate) fn drift(&self, time: f64) -> [f64; 2] {
        // Steady before the first key, after the last, and between equal ones.
        let mut breaks: Vec<f64> = [&self.speed, &self.direction]
            .into_iter()
            .flat_map(Track::breaks)
            .chain([0.0, time])
            .filter(|at| (0.0f64.min(time)..=0.0f64.max(time)).contains(at))
            .collect();
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        let sum: DVec2 = breaks.windows(2).map(|pair| self.part(pair[0], pair[1])).sum();
        if time < 0.0 { -sum } else { sum }.to_array()
    }

    /// The integral between two times, with no key of a track between.
    fn part(&self, from: f64, to: f64) -> DVec2 {
        let middle = 0.5 * (from + to);
        let steady = |track: &Track| {
            let value = track.at(middle);
            // Three places, since an eased track may come back to where it was in one of them.
            [0.1, 0.35, 0.9].iter().all(|share| track.at(from + share * (to - from)) == value)
        };
        if steady(&self.speed) && steady(&self.direction) {
            let way = |wave: &Wave| {
                let end = |time: f64| (wave[1] * time + wave[2]).sin();
                wave[0] / wave[1] * (end(to) - end(from))
            };
            let [a, b] = self.waves.each_ref().map(|waves| self.gusts * waves.iter().map(way).sum::<f64>());
            return turned(self.mean(middle), [to - from + a, b]).into();
        }
        let steps = ((to - from) / MAX_STEP_S).ceil().max(1.0);
        let length = (to - from) / steps;
        // Gauss and Legendre with three points: exact to the fifth power.
        let points = [(-0.6f64.sqrt(), 5.0 / 18.0), (0.0, 4.0 / 9.0), (0.6f64.sqrt(), 5.0 / 18.0)];
        let mut sum = DVec2::ZERO;
        for step in 0..steps as u64 {
            let center = from + length * (step as f64 + 0.5);
            for (off, weight) in points {
                sum += weight * length * DVec2::from_array(self.at(center + 0.5 * length * off));
            }
        }
        sum
    }
}

/// `mean` times a complex number: along it and across.
fn turned(mean: [f64; 2], by: [f64; 2]) -> [f64; 2] {
    [mean[0] * by[0] - mean[1] * by[1], mean[0] * by[1] + mean[1] * by[0]]
}

fn number(value: &ParamValue) -> f64 {
    value.number().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Wind {
        /// No wind.
        fn calm() -> Self {
            let zero = || Track::constant(ParamValue::Number(0.0));
            Self::new(zero(), zero(), 0.0, 0)
        }
    }

    fn track(param: &str, text: &str) -> Track {
        crate::testing::track("wind", param, text)
    }

    #[test]
    fn drift_is_the_integral_of_wind_however_it_is_reached() {
        for (speed, direction) in [("6", "30"), ("0:2,4:9,9:9", "0:0,6:90"), ("0:0,3:5", "200")] {
            let wind = Wind::new(track("speed", speed), track("direction", direction), 0.25, 7);
            let (mut sum, step) = ([0.0; 2], 1e-3);
            for i in 0..12_000 {
                let at = wind.at((f64::from(i) + 0.5) * step);
                (0..2).for_each(|k| sum[k] += at[k] * step);
                if i % 1700 == 1699 {
                    let drift = wind.drift(f64::from(i + 1) * step);
                    assert!(
                        (0..2).all(|k| (drift[k] - sum[k]).abs() < 2e-5),
                        "{speed} {i}: {drift:?} {sum:?}"
                    );
                }
            }
        }
        let calm = Wind::calm();
        assert_eq!((calm.at(3.0), calm.drift(9.0), calm.drift(-2.0)), ([0.0; 2], [0.0; 2], [0.0; 2]));
    }

    #[test]
    fn gusts_are_as_strong_as_asked() {
        let wind = Wind::new(track("speed", "8"), track("direction", "0"), 0.2, 3);
        let values: Vec<[f64; 2]> = (0..20_000).map(|i| wind.at(0.37 * f64::from(i))).collect();
        let mean = |f: &dyn Fn(&[f64; 2]) -> f64| values.iter().map(f).sum::<f64>() / values.len() as f64;
        assert!((mean(&|v| v[0]) - 8.0).abs() < 0.05);
        assert!((mean(&|v| (v[0] - 8.0).powi(2)).sqrt() - 1.6).abs() < 0.08);
        assert!((mean(&|v| v[1].powi(2)).sqrt() - 0.8).abs() < 0.04);
    }
}
