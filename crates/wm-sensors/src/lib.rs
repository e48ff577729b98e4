//! Sensors other than cameras, in the same weather: lidar sweeps through scenes of Gaussian splats,
//! and radar ([`radar`]).
//!
//! A lidar sends pulses along [`BeamPattern`]s from a sensor that moves ([`SensorMotion`]). Each
//! pulse meets the splats of a place ([`wm_render::RaySplats`]) and the weather that cameras see
//! there: fog that dims it and sends light back, the very drops and flakes that fall in front of a
//! camera, wet ground that mirrors it away and snow that lies. What comes back is added up,
//! detected against noise and given out as points, each with its class.
//!
//! # Types to know
//! - [`LidarModel`]: a lidar, from a preset ([`PRESETS`]) or a TOML file.
//! - [`SensorPose`], [`SensorMotion`]: where it is, over time.
//! - [`LidarScene`]: splats, weather and wet surfaces.
//! - [`sweep()`], [`ScanOptions`]: one sweep.
//! - [`LidarSweep`]: its points, which [`LidarSweep::save`] writes as PLY, PCD, NPY, LAS or KITTI's
//!   .bin.
//!
//! # Example
//! A wall of one splat, 20 m ahead in fog:
//! ```
//! use glam::DVec3;
//! use wm_render::simd::SimdPath;
//! use wm_scene::Splats;
//! use wm_sensors::{DrySurfaces, EchoClass, LidarModel, LidarScene, ReturnMode, SensorPose, ScanOptions};
//! use wm_sensors::{reflecting_splats, sweep};
//! use wm_weather::{Site, Weather};
//!
//! let mut wall = Splats::zeroed(1, 0);
//! wall.means[0] = [20.0, 0.0, 0.0];
//! wall.log_scales[0] = [f32::ln(0.001), f32::ln(10.0), f32::ln(10.0)];
//! wall.quats[0] = [1.0, 0.0, 0.0, 0.0];
//! wall.logit_opacities[0] = 9.0;
//!
//! let lidar = LidarModel::find("vlp-16")?;
//! let weather = Weather::preset("clear")?.set("fog.mor", 200.0)?.at(0.0).prepare(&Site::PLAIN);
//! let scene = LidarScene {
//!     splats: &reflecting_splats(&wall, |_| true),
//!     mirrored: None,
//!     weather: &weather,
//!     site: &Site::PLAIN,
//!     shelter: None,
//!     surfaces: &DrySurfaces,
//!     path: SimdPath::widest(),
//! };
//! let pose = SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z);
//! // Near fog is stronger than the wall, which comes last.
//! let options = ScanOptions { returns: ReturnMode::Last, ..ScanOptions::default() };
//! let made = sweep(&lidar, &pose, &scene, &options);
//! assert!(made.count(EchoClass::Surface) > 500 && made.count(EchoClass::Air) > 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How a sweep is made
//! A lidar is another reader of the prepared weather. A pulse is one ray or seven through the
//! splats ([`wm_render::RayTracer`], on the renderer's device), each with an origin and a time of
//! its own. All that comes back is an echo, power at a distance (`echo.rs`): surfaces with the
//! reflectance that water and snow leave them (`surface.rs`), what wet ground mirrors, the air by
//! bins of half a pulse (`air.rs`), and particles (`drops.rs`). Echoes within half a pulse add up;
//! noise decides which are detected.
//!
//! The weather gives what only it knows: extinction and backscatter in the near infrared
//! ([`wm_weather::InfraredAir`]), and the particles near the sensor. The extinction is that of all
//! that falls, so particles add echoes and take nothing away. Echoes are not outputs of a render,
//! so a sweep is no pass of a frame plan.
//!
//! # Limits
//! Reflectances come from colours unless lying snow or water says more, so intensities are of an
//! order of magnitude. Ranges are as good as the splats: those trained on photos alone are
//! decimetres off at 30 m. Standing floods, the light of the sun in the receiver, crosstalk and
//! blooming are left out; hailstones are taken for drops.

mod air;
mod drops;
mod echo;
mod error;
pub mod events;
mod formats;
mod model;
pub mod pattern;
mod pose;
mod presets;
pub mod radar;
mod scene;
mod sensor_text;
mod surface;
mod sweep;
#[cfg(test)]
mod tests;

pub use echo::{EchoClass, ReturnMode, ReturnRank};
pub use error::SensorError;
pub use formats::PointFormat;
pub use model::LidarModel;
pub use pattern::{Beam, BeamPattern};
pub use pose::{EvenMotion, SensorMotion, SensorPose};
pub use presets::{PRESETS, about};
pub use scene::LidarScene;
pub use surface::{DrySurfaces, SurfaceState, SurfaceStates, base_reflectance, reflecting_splats};
pub use sweep::{LidarPoint, LidarSweep, PointFrame, ScanOptions, SubRays, sweep};
