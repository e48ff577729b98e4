//! Constants of nature that several effects share.

/// Acceleration of free fall, m/s^2.
pub(crate) const GRAVITY: f64 = 9.81;
/// Density of water, kg/m^3.
pub(crate) const WATER_DENSITY: f64 = 1000.0;
/// Density of air, kg/m^3.
pub(crate) const AIR_DENSITY: f64 = 1.2;
