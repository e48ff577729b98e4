//! A device with a place on it.

use crate::error::{Failure, Outcome};
use weather_magician::Device;

/// The device of a name: auto, cpu, gpu or gpu:NAME.
pub fn device_of(name: &str) -> Outcome<Device> {
    name.parse().map_err(|error| Failure::Library(format!("device: {error}")))
}
