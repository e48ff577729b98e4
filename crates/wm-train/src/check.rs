//! Checks configurations, which are also written by hand.

use std::ops::RangeInclusive;
use thiserror::Error;

/// Largest weight and step length: larger ones overflow.
pub(crate) const MAX_WEIGHT: f64 = 1e9;
/// Range of shares without 0 and 1, whose logits are infinite.
pub(crate) const SHARE: RangeInclusive<f64> = 1e-6..=1.0 - 1e-6;
pub(crate) const WEIGHT: RangeInclusive<f64> = 0.0..=MAX_WEIGHT;
pub(crate) const COUNT: RangeInclusive<f64> = 1.0..=u32::MAX as f64;

/// A value of a configuration and the range in which it must lie.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ConfigValue {
    pub(crate) name: &'static str,
    pub(crate) value: f64,
    pub(crate) range: RangeInclusive<f64>,
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
    pub(crate) name: &'static str,
    pub(crate) value: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
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
