//! Exposures: how bright a picture becomes.
//!
//! An automatic exposure brings the mean logarithm of the luminance to [`MIDDLE_GREY`], with a lag:
//! it goes by `integral L(t - s) e^(-s / lag) ds / lag` over the seconds before the frame, with `L`
//! from small pictures at whole multiples of [`METERING_STEP_S`]. So the exposure of a frame is a
//! function of its time alone.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::str::FromStr;
use wm_base::color::luminance;
use wm_render::Frame;

/// Target of the mean luminance, linear light.
const MIDDLE_GREY: f64 = 0.18;
/// Minimum light in the mean: darker pixels count as this.
const MIN_LUMINANCE: f64 = 1e-4;
/// Time constant: an exposure has followed a step by 63 % after this, s.
const TIME_CONSTANT_S: f64 = 0.5;
/// Time between two measurements, s.
const METERING_STEP_S: f64 = 0.1;
/// Time before a frame that its exposure depends on, s: earlier light counts for less than 1 %.
const METERING_WINDOW_S: f64 = 2.5;
/// Samples of the integral per step.
const SAMPLES_PER_STEP: u32 = 8;
/// Least and greatest change of an automatic exposure, stops.
const LIMITS_EV: [f64; 2] = [-4.0, 6.0];

/// The exposure of a camera, over that of the photos that the scene was made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraExposure {
    /// So many stops more: 1 is twice as bright.
    Stops(f64),
    /// Exposes to a middle grey on average, with a lag of half a second.
    Auto,
}

impl Default for CameraExposure {
    fn default() -> Self {
        Self::Stops(0.0)
    }
}

impl FromStr for CameraExposure {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        match text.parse::<f64>() {
            Ok(stops) if (-20.0..=20.0).contains(&stops) => Ok(Self::Stops(stops)),
            _ => Err(format!("`{text}` is not an exposure: use auto, or stops from -20 to 20")),
        }
    }
}

/// Mean of the natural logarithm of the luminance of a picture, linear light.
pub(super) fn log_mean(frame: &Frame) -> f64 {
    let light = frame.rgb_linear();
    let pixels = light.as_chunks::<3>().0;
    let of = |pixel: &[f32; 3]| luminance(pixel.map(f64::from)).max(MIN_LUMINANCE).ln();
    pixels.iter().map(of).sum::<f64>() / pixels.len().max(1) as f64
}

/// Mean logarithms of the luminance at multiples of [`METERING_STEP_S`].
#[derive(Clone, Debug, Default)]
pub(super) struct LightMeter {
    measured: BTreeMap<i64, f64>,
}

impl LightMeter {
    /// The gain of an automatic exposure at `time`, s; `measure` returns the mean logarithm of the
    /// luminance at a time.
    pub(crate) async fn gain<E>(
        &mut self,
        time: f64,
        mut measure: impl AsyncFnMut(f64) -> Result<f64, E>,
    ) -> Result<f64, E> {
        // A path and a weather begin at 0: what would be before is as at the beginning.
        let begin = if time >= 0.0 { 0 } else { i64::MIN };
        let last = (time / METERING_STEP_S).ceil() as i64;
        let first = ((time - METERING_WINDOW_S) / METERING_STEP_S).floor() as i64;
        for step in first.max(begin)..=last {
            if let Entry::Vacant(entry) = self.measured.entry(step) {
                entry.insert(measure(step as f64 * METERING_STEP_S).await?);
            }
        }
        let (mut sum, mut total) = (0.0, 0.0);
        let points = ((METERING_WINDOW_S / METERING_STEP_S) as u32) * SAMPLES_PER_STEP;
        for point in 0..points {
            let before = (f64::from(point) + 0.5) * METERING_WINDOW_S / f64::from(points);
            let at = (time - before) / METERING_STEP_S;
            let (step, share) = (at.floor() as i64, at - at.floor());
            let light = |step: i64| self.measured.get(&step.max(begin)).copied().unwrap_or_default();
            let weight = (-before / TIME_CONSTANT_S).exp();
            sum += weight * (light(step) * (1.0 - share) + light(step + 1) * share);
            total += weight;
        }
        let stops = (MIDDLE_GREY.ln() - sum / total) / std::f64::consts::LN_2;
        Ok(stops.clamp(LIMITS_EV[0], LIMITS_EV[1]).exp2())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::at_once;

    /// The gain for light that steps from one to another at a time.
    fn gain(meter: &mut LightMeter, time: f64) -> f64 {
        let light = async |at: f64| Ok::<f64, ()>(if at < 3.0 { 0.045f64.ln() } else { 0.18f64.ln() });
        at_once(meter.gain(time, light)).unwrap()
    }

    #[test]
    fn exposure_follows_with_its_lag() {
        let mut meter = LightMeter::default();
        assert!((gain(&mut meter, 2.8) - 4.0).abs() < 1e-9);
        // After one lag 63 % of two stops are made up; the step itself is a tenth of a second wide.
        let stops = gain(&mut meter, 3.5).log2();
        assert!((stops - 2.0 * (-1.0f64).exp()).abs() < 0.12, "{stops}");
        assert!((gain(&mut meter, 6.0) - 1.0).abs() < 0.02);
    }

    #[test]
    fn any_frame_alone_has_the_exposure_of_the_sequence() {
        let mut meter = LightMeter::default();
        let all: Vec<f64> = (0..120).map(|frame| gain(&mut meter, f64::from(frame) / 25.0)).collect();
        for frame in [0, 60, 77, 119] {
            assert_eq!(all[frame], gain(&mut LightMeter::default(), frame as f64 / 25.0));
        }
    }
}
