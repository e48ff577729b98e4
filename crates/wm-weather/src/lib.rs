//! Weather as physics, for scenes of splats.
//!
//! A [`Weather`] is a list of effects with parameters over time. [`Weather::at`] gives one instant of
//! it, [`Instant::over`] what a renderer needs of that over one site. Nothing here keeps state, so any
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
pub mod optics;
pub mod panorama;
pub mod paper;
pub mod param;
pub mod particles;
pub mod picture;
pub mod presets;
pub mod reference_page;
pub mod scan;
pub mod shelter;
#[cfg(test)]
mod testing;
mod threads;
pub mod track;
pub mod weather;
pub mod wind;

pub use dome::Dome;
pub use easing::Easing;
pub use effects::{EFFECTS, Effect};
pub use file::WeatherError;
pub use optics::{Atmosphere, Daylight, Site};
pub use panorama::{Panorama, PanoramaFault};
pub use param::{Param, Value};
pub use picture::Picture;
pub use track::{Key, Track};
pub use weather::{Fidelity, Instant, Seen, Sky, Weather};
pub use wind::Wind;
