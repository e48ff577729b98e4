//! Checks configurations, which are also written by hand.

use std::ops::RangeInclusive;
use thiserror::Error;

/// Largest weight and step length: larger ones overflow.
pub(crate) const MAX_WEIGHT: f64 = 1e9;
/// Range of shares without 0 and 1, whose logits are infinite.
pub(crate) const SHARE_RANGE: RangeInclusive<f64> = 1e-6..=1.0 - 1e-6;
pub(crate) const WEIGHT_RANGE: RangeInclusive<f64> = 0.0..=MAX_WEIGHT;
pub(crate) const COUNT_RANGE: RangeInclusive<f64> = 1.0..=u32::MAX as f64;

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
