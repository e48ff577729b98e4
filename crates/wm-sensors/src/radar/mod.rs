//! Automotive radar in the same weather: plausible, not validated.
//!
//! A fan of rays meets the splats of a place; each hit has an RCS by the angle of its surface,
//! guessed for all materials alike. The radar equation, with the attenuation of the rain, makes
//! powers of them in cells of range, azimuth and velocity; rain and noise add speckle, and a
//! threshold that goes by the cells around makes detections. Fog and dry snow do nothing.
//!
//! # Types to know
//! - [`RadarModel`]: a radar, from a preset ([`RADAR_PRESETS`]) or a TOML file.
//! - [`RadarScene`]: splats and weather.
//! - [`radar_sweep`], [`RadarScanOptions`]: one sweep.
//! - [`RadarSweep`]: its detections, which [`RadarSweep::save`] writes as PLY, PCD or NPY.
//!
//! # Example
//! A plate of 2 m that faces a radar that comes nearer at 10 m/s:
//! ```
//! use glam::DVec3;
//! use wm_render::RaySplats;
//! use wm_render::simd::SimdPath;
//! use wm_scene::Splats;
//! use wm_sensors::radar::{RadarClass, RadarModel, RadarScanOptions, RadarScene, radar_sweep};
//! use wm_sensors::{EvenMotion, SensorPose};
//! use wm_weather::{Site, Weather};
//!
//! let mut plate = Splats::zeroed(1, 0);
//! plate.means[0] = [40.0, 0.0, 0.0];
//! plate.log_scales[0] = [f32::ln(0.001), f32::ln(0.4), f32::ln(0.4)];
//! plate.quats[0] = [1.0, 0.0, 0.0, 0.0];
//! plate.logit_opacities[0] = 9.0;
//!
//! let scene = RadarScene {
//!     splats: &RaySplats::new(&plate, |_| true),
//!     weather: &Weather::clear().at(0.0).prepare(&Site::PLAIN),
//!     site: &Site::PLAIN,
//!     shelter: None,
//!     path: SimdPath::widest(),
//! };
//! let start = SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z);
//! let motion = EvenMotion { start, velocity: DVec3::X * 10.0 };
//! let radar = RadarModel::find("mid-range-77")?;
//! let made = radar_sweep(&radar, &motion, &scene, &RadarScanOptions::default());
//! let found = made.detections.iter().find(|one| one.class == RadarClass::Surface).unwrap();
//! assert!((found.range - 40.0).abs() < 0.3 && (found.velocity + 10.0).abs() < 0.12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How a sweep is made
//! The weather gives the rate and the velocity of the rain alone. Rays make scatterers (`sweep.rs`)
//! by a law of angles (`surface.rs`); cells (`cells.rs`) add them up with rain (`rain.rs`) and
//! noise, and are held against those around them. The cells of one azimuth are one array, made on
//! one thread; a random number is a function of its cell. Only detections look up their scatterers
//! once more, for elevation and class, so that no cell keeps them.
//!
//! # Limits
//! RCS is of an order of magnitude: there are no materials, no corners that reflect back, no
//! polarisation and no multipath. Nothing moves but the sensor and the rain. Side lobes,
//! interference, saturation, spray and a wet cover of the antenna are left out.

mod cells;
mod formats;
mod model;
mod rain;
mod surface;
mod sweep;
#[cfg(test)]
mod tests;

pub use crate::presets::RADAR_PRESETS;
pub use model::RadarModel;
pub use sweep::{RadarClass, RadarDetection, RadarScanOptions, RadarScene, RadarSweep, radar_sweep};
