//! Weather as physics, for scenes of splats.
//!
//! A [`Weather`] is a list of effects with parameters over time. [`Weather::at`] gives one instant of
//! it, [`WeatherSample::prepare`] what a renderer needs of that over one site. Nothing here keeps state, so any
//! frame can be rendered alone.
//!
//! To add an effect: one file in [`effects`], one line in its list. Files, flags, help and
//! documentation read its table of parameters.

#![allow(clippy::needless_range_loop)] // Channel loops index several arrays at once.

pub mod cover;
pub mod dome;
pub mod easing;
pub mod effects;
pub mod file;
pub mod fused_surfaces;
pub mod image_file;
pub mod optics;
pub mod panorama;
pub mod paper;
pub mod param;
pub mod particles;
pub mod presets;
pub mod reference_page;
pub mod shelter;
#[cfg(test)]
mod testing;
mod threads;
pub mod track;
pub mod weather;
pub mod wind;

pub use dome::Dome;
pub use easing::Easing;
pub use effects::{EFFECTS, Effect, EffectRole, Need};
pub use file::WeatherError;
pub use image_file::ImageFile;
pub use optics::{Atmosphere, Daylight, Site};
pub use panorama::{Panorama, PanoramaError};
pub use param::{Param, ParamInput, ParamKind, ParamValue};
pub use track::{Keyframe, Track};
pub use weather::{Fidelity, Observer, PreparedWeather, Weather, WeatherSample};
pub use wind::Wind;
