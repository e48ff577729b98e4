//! Checks configurations, which are also written by hand.

use crate::config::{HazeMode, TrainConfig};
use std::ops::RangeInclusive;
use thiserror::Error;
use wm_scene::sh;

/// Most steps.
const MAX_STEPS: u32 = 1_000_000;
/// Most splats of the sky: more of them would be smaller than pixels.
const MAX_SKY_SPLATS: f64 = 1e6;
/// Largest weight and step length: larger ones overflow.
const MAX_WEIGHT: f64 = 1e9;
/// Range of shares without 0 and 1, whose logits are infinite.
pub(crate) const SHARE: RangeInclusive<f64> = 1e-6..=1.0 - 1e-6;
pub(crate) const WEIGHT: RangeInclusive<f64> = 0.0..=MAX_WEIGHT;
pub(crate) const COUNT: RangeInclusive<f64> = 1.0..=u32::MAX as f64;

/// A value of a configuration and the range in which it must lie.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ConfigValue {
    name: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
}

impl ConfigValue {
    /// Returns `value` under its name in the configuration file, such as `densify.every`.
    pub(crate) fn new(name: &'static str, value: impl Into<f64>, range: RangeInclusive<f64>) -> Self {
        Self { name, value: value.into(), range }
    }
}

/// A value outside of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{name} is {value}; it must be {least} to {most}")]
pub struct ConfigError {
    name: &'static str,
    value: f64,
    least: f64,
    most: f64,
}

impl TrainConfig {
    /// Checks every value that steps divide by, index with or take the logarithm of.
    ///
    /// # Errors
    /// [`ConfigError`] names the first value that makes no training, and what it may be.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        let (loss, rates) = (&self.loss, &self.rates);
        let geometry = &loss.geometry;
        let values = [
            ("steps", f64::from(self.steps), 1.0..=f64::from(MAX_STEPS)),
            ("sh_degree", f64::from(self.sh_degree), 0.0..=f64::from(sh::MAX_DEGREE)),
            ("sh_every", f64::from(self.sh_every), COUNT),
            ("start_opacity", self.start_opacity, SHARE),
            ("start_scale", self.start_scale, 1e-6..=MAX_WEIGHT),
            ("start_fill", self.start_fill, 0.0..=1.0),
            ("sky_splats", f64::from(self.sky_splats), 0.0..=MAX_SKY_SPLATS),
            ("haze.mor", if let HazeMode::Mor(mor) = self.haze { mor } else { 1.0 }, 1e-6..=MAX_WEIGHT),
            ("loss.l1", loss.l1, WEIGHT),
            ("loss.ssim", loss.ssim, WEIGHT),
            ("loss.geometry.depth", geometry.depth, WEIGHT),
            ("loss.geometry.depth_hard", geometry.depth_hard, WEIGHT),
            ("loss.geometry.depth_soft", geometry.depth_soft, WEIGHT),
            ("loss.geometry.depth_local", geometry.depth_local, WEIGHT),
            ("loss.geometry.depth_margin", geometry.depth_margin, WEIGHT),
            ("loss.geometry.depth_from", geometry.depth_from, 0.0..=1.0),
            ("loss.geometry.depth_last", geometry.depth_last, f64::MIN_POSITIVE..=1.0),
            ("loss.geometry.every", f64::from(geometry.every), COUNT),
            ("loss.geometry.surface", geometry.surface, WEIGHT),
            ("loss.geometry.normal", geometry.normal, WEIGHT),
            ("loss.geometry.normal_from", geometry.normal_from, 0.0..=1.0),
            ("loss.geometry.flat", geometry.flat, WEIGHT),
            ("loss.geometry.smooth", geometry.smooth, WEIGHT),
            ("rates.means_first", rates.means_first, f64::MIN_POSITIVE..=MAX_WEIGHT),
            ("rates.means_last", rates.means_last, f64::MIN_POSITIVE..=MAX_WEIGHT),
            ("rates.quats", rates.quats, WEIGHT),
            ("rates.log_scales", rates.log_scales, WEIGHT),
            ("rates.logit_opacities", rates.logit_opacities, WEIGHT),
            ("rates.sh_dc", rates.sh_dc, WEIGHT),
            ("rates.sh_rest", rates.sh_rest, WEIGHT),
            ("rates.exposure", rates.exposure, WEIGHT),
        ];
        let values = values.map(|(name, value, range)| ConfigValue { name, value, range });
        let mut values = values.into_iter().chain(self.densify.strategy().values());
        match values.find(|value| !value.range.contains(&value.value)) {
            None => Ok(()),
            Some(ConfigValue { name, value, range }) => {
                Err(ConfigError { name, value, least: *range.start(), most: *range.end() })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Densify, Preset};
    use crate::densify::adaptive::AdaptiveConfig;

    #[test]
    fn presets_are_sound_and_nonsense_is_named() {
        for preset in [Preset::Draft, Preset::Quick, Preset::Standard, Preset::Best] {
            let mut config = TrainConfig::preset(preset);
            assert_eq!(config.check(), Ok(()));
            config.densify = Densify::Adaptive(AdaptiveConfig::for_steps(config.steps, 1000));
            assert_eq!(config.check(), Ok(()));
            config.set_steps(1);
            assert_eq!(config.check(), Ok(()));
        }
        let say = |change: fn(&mut TrainConfig)| {
            let mut config = TrainConfig::preset(Preset::Quick);
            change(&mut config);
            config.check().unwrap_err().to_string()
        };
        assert_eq!(say(|c| c.steps = 0), "steps is 0; it must be 1 to 1000000");
        assert_eq!(say(|c| c.sh_degree = 9), "sh_degree is 9; it must be 0 to 3");
        assert!(say(|c| c.rates.means_last = 0.0).starts_with("rates.means_last is 0; "));
        assert_eq!(say(|c| c.sky_splats = u32::MAX), "sky_splats is 4294967295; it must be 0 to 1000000");
        assert!(say(|c| c.loss.l1 = f64::NAN).starts_with("loss.l1 is NaN; "));
    }
}
