//! Noise of an image sensor.
//!
//! A pixel that is as bright as display white holds `full_well / gain` electrons at a gain of
//! `iso / 100`. Their number is a Poisson variate of its mean, the readout adds a normal error, and
//! the converter cuts the range into 2^bits levels. Values above white are cut off. Each number is
//! a function of (seed, frame, pixel, channel).

use rayon::prelude::*;
use wm_base::color::{srgb_decode, srgb_encode};
use wm_base::random::{self, RandomStream};
use wm_render::Frame;
use wm_render::frame::ColorEncoding;

/// Electrons above which a Poisson variate is taken for a normal one: its skewness is below 0.16
/// then.
const MIN_NORMAL_ELECTRONS: f64 = 40.0;
/// ISO at which a full pixel is white.
const BASE_ISO: f64 = 100.0;
/// The purpose of its random numbers.
const RANDOM_PURPOSE: u64 = 0x5e;

/// The noise of an image sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Sensitivity, ISO: 100 is the base, at which a full pixel is white.
    pub iso: f64,
    /// Electrons that a pixel holds.
    pub full_well: f64,
    /// Standard deviation of the readout, electrons.
    pub readout: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// The seed of its random numbers.
    pub seed: u64,
}

impl Default for SensorNoise {
    /// A small sensor at its base.
    fn default() -> Self {
        Self { iso: BASE_ISO, full_well: 10_000.0, readout: 3.0, bits: 12, seed: 0 }
    }
}

impl SensorNoise {
    /// Checks its numbers.
    ///
    /// # Errors
    /// A line that names the value.
    pub fn check(&self) -> Result<(), String> {
        for (name, value, range) in [
            ("ISO", self.iso, [10.0, 1e6]),
            ("full well", self.full_well, [10.0, 1e7]),
            ("readout noise", self.readout, [0.0, 1e4]),
            ("number of bits", f64::from(self.bits), [4.0, 16.0]),
        ] {
            if !(range[0]..=range[1]).contains(&value) {
                return Err(format!("the {name} is {value}: it must be from {} to {}", range[0], range[1]));
            }
        }
        Ok(())
    }

    /// Adds the noise of frame `index` of the sensor `sensor` to a picture that was made `gain`
    /// times as bright as the base exposure: gains above 1 are more sensitivity.
    pub(super) fn apply(&self, frame: &mut Frame, sensor: u32, index: u32, gain: f64) {
        let electrons = self.full_well * BASE_ISO / (self.iso * gain.max(1.0));
        let top = f64::from((1u32 << self.bits) - 1);
        let random = RandomStream::new(random::bits(self.seed, u64::from(sensor)), RANDOM_PURPOSE, index);
        let is_srgb = frame.encoding == ColorEncoding::Srgb;
        let width = 3 * frame.width.max(1) as usize;
        frame.rgb.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                // Two blocks of numbers a pixel: normal ones, and uniform ones.
                let number = 2 * (y * width / 3 + x) as u64;
                let normal = random.normal3(number);
                for (k, value) in pixel.iter_mut().enumerate() {
                    let light =
                        if is_srgb { srgb_decode(f64::from(*value).max(0.0)) } else { f64::from(*value) };
                    let mean = electrons * light.clamp(0.0, 1.0);
                    let counted = if mean > MIN_NORMAL_ELECTRONS {
                        mean + (mean + self.readout * self.readout).sqrt() * normal[k]
                    } else {
                        poisson(mean, random.uniform(4 * (number + 1) + k as u64)) + self.readout * normal[k]
                    };
                    let level = (counted / electrons * top).round().clamp(0.0, top) / top;
                    *value = if is_srgb { srgb_encode(level) } else { level } as f32;
                }
            }
        });
    }
}

/// The Poisson variate of a mean at a quantile, by adding up probabilities.
fn poisson(mean: f64, quantile: f64) -> f64 {
    let mut probability = (-mean).exp();
    let mut sum = probability;
    let mut count = 0.0;
    // Beyond this only rounding is left.
    while sum < quantile && count < 10.0 * MIN_NORMAL_ELECTRONS {
        count += 1.0;
        probability *= mean / count;
        sum += probability;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grey picture in linear light.
    fn grey(light: f32, side: u32) -> Frame {
        Frame {
            width: side,
            height: side,
            encoding: ColorEncoding::Linear,
            rgb: vec![light; (3 * side * side) as usize],
            ..Frame::default()
        }
    }

    #[test]
    fn mean_and_variance_are_those_of_the_electrons() {
        let noise = SensorNoise::default();
        for light in [0.0005, 0.003, 0.02, 0.3, 0.9] {
            let mut frame = grey(light, 200);
            noise.apply(&mut frame, 0, 0, 1.0);
            let count = frame.rgb.len() as f64;
            let mean = frame.rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
            let variance = frame.rgb.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
            let light = f64::from(light);
            let step = 1.0 / 4095.0f64;
            let want = light / 10_000.0 + (3.0 / 10_000.0f64).powi(2) + step * step / 12.0;
            // Standard errors: sqrt(variance / count), and the variance's share sqrt(2 / count) =
            // 0.4 %. Black cuts off what is below.
            let is_cut = light < 0.002;
            assert!(
                (mean - light).abs() < if is_cut { 0.1 * light } else { 5.0 * (want / count).sqrt() },
                "{light}: {mean}"
            );
            assert!(
                (variance / want - 1.0).abs() < if is_cut { 0.2 } else { 0.02 },
                "{light}: {variance}, want {want}"
            );
        }
    }

    #[test]
    fn poisson_counts_have_their_mean_and_variance() {
        for mean in [0.3, 4.0, 39.0] {
            let counts: Vec<f64> =
                (0..20_000).map(|i| poisson(mean, (f64::from(i) + 0.5) / 20_000.0)).collect();
            let average = counts.iter().sum::<f64>() / 20_000.0;
            let variance = counts.iter().map(|v| (v - average).powi(2)).sum::<f64>() / 20_000.0;
            assert!((average / mean - 1.0).abs() < 0.002 && (variance / mean - 1.0).abs() < 0.01, "{mean}");
        }
    }

    #[test]
    fn frames_and_sensors_have_noise_of_their_own() {
        let made = |sensor, index| {
            let mut frame = grey(0.2, 16);
            SensorNoise::default().apply(&mut frame, sensor, index, 1.0);
            frame.rgb
        };
        assert_eq!(made(0, 0), made(0, 0));
        assert_ne!(made(0, 0), made(0, 1));
        assert_ne!(made(0, 0), made(1, 0));
        assert_ne!(made(0, 4096), made(1, 0));
    }
}
