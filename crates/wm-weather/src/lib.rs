//! Physical weather for scenes of Gaussian splats: fog, haze, smog, rain, snowfall, lying snow,
//! dust, wind and sky.
//!
//! A program picks a weather, samples it at a time and prepares the sample for a place. The result
//! gives a renderer of [`wm_render`] its hooks: the air, the falling particles, the sky and the
//! look of the finished picture. Nothing keeps state, so any frame can be rendered alone.
//!
//! # Types to know
//! - [`Weather`]: effects with their parameters over time; from a preset, a TOML file or
//!   [`Weather::set`].
//! - [`Site`]: the scale, the up direction, the ground and the light of a place.
//! - [`PreparedWeather`]: a weather at one time and place ([`Weather::at`],
//!   [`WeatherSample::prepare`]).
//! - [`Observer`]: the camera, its velocity and the shelter above it.
//! - [`Effect`]: an entry of [`EFFECTS`], with its table of parameters, its role and its needs.
//!
//! # Example
//! ```
//! use wm_weather::{EffectRole, Site, Weather};
//!
//! let weather = Weather::preset("fog")?.set("fog.mor", 80.0)?.set("rain.rate", "0:2,10:25")?;
//! assert!(weather.has(EffectRole::Falls));
//!
//! let site = Site { metres_per_unit: 0.4, airlight: [0.7, 0.75, 0.8], ..Site::PLAIN };
//! let prepared = weather.at(5.0).prepare(&site);
//! assert_eq!(prepared.falling[0].rate, 13.5);
//! # Ok::<(), wm_weather::WeatherError>(())
//! ```
//!
//! To add an effect, write one file in [`effects`] and add its name to the list there. Files,
//! options, help, documentation and the instruments of `measure` read the effect's own table.

#![allow(clippy::needless_range_loop)] // Channel loops index several arrays at once.

pub mod cover;
pub mod dome;
pub(crate) mod easing;
pub(crate) mod effects;
pub(crate) mod file;
pub mod fused_surfaces;
pub(crate) mod grade;
pub(crate) mod image_file;
pub(crate) mod infrared;
mod lanes;
pub mod lens;
mod level;
pub mod light;
mod light_fault;
mod linear_picture;
pub mod open_water;
pub mod optics;
pub mod panorama;
pub mod paper;
pub mod param;
pub mod particles;
mod physics;
pub(crate) mod point_grid;
pub mod presets;
pub mod reference_page;
pub mod shelter;
pub mod splash;
mod surfel;
#[cfg(test)]
mod testing;
mod threads;
pub(crate) mod track;
pub mod water;
pub mod weather;
pub mod wetness;
pub(crate) mod wind;

pub use easing::Easing;
pub use effects::effect::WeatherSample;
pub use effects::{EFFECTS, Effect, EffectRole, Need};
pub use file::WeatherError;
pub use image_file::ImageFile;
pub use infrared::InfraredAir;
pub use light_fault::light_fault;
pub use optics::{Atmosphere, CapturedSky, Daylight, EarthPlace, LampLevels, LampSource, Site, SiteLight};
pub use panorama::{Panorama, PanoramaError};
pub use param::{Param, ParamInput, ParamKind, ParamValue};
pub use track::{Keyframe, Track};
pub use weather::{Fidelity, Observer, PassWeather, PixelContribution, PreparedWeather, Weather};
pub use wind::Wind;
