//! Places in weather: a scene with its facts, splats and prepared assets, and the frames and sweeps
//! that are rendered of it.
//!
//! [`Renderer`] is a device. [`Renderer::load`] turns a scene into a [`PreparedPlace`], and
//! [`Renderer::render`] answers a [`FrameRequest`]: weather, camera, time and layers. What takes
//! seconds to prepare for a weather, such as the ground under snow, is an asset ([`assets`]), made
//! once and kept. Lidars ([`lidar`]), radars ([`radar`]) and devices with a lens and a shutter
//! ([`camera_model`]) look at the same place in the same weather.
//!
//! Frames are pure functions of (scene, weather, camera, time): the same inputs give the same bytes
//! on the CPU, on any number of threads.

pub mod assets;
mod bake;
pub mod camera_model;
mod drawing;
mod error;
pub mod flow;
pub mod frame;
mod frame_camera;
pub mod labels;
pub mod lamps;
mod layers;
mod lens_view;
pub mod levels;
pub mod lidar;
mod moments;
mod motion;
mod motion_spec;
pub mod output;
pub mod panorama_file;
mod picture;
mod place;
mod place_light;
mod place_water;
mod progress;
pub mod radar;
pub mod reduce;
mod render;
mod renderer;
mod request;
pub mod rig;
pub mod sensor;
pub mod sequence;
mod shot;
mod sweep_picture;
mod tags;
#[cfg(test)]
mod testing;
mod thinned;
pub mod view;

pub use bake::BakedScene;
pub use error::{Error, Result};
pub use frame_camera::FrameCamera;
pub use layers::{LayerPasses, Layers, PictureLayer};
pub use lens_view::{LensSpec, LensView};
pub use motion::{CameraMotion, Mount};
pub use motion_spec::MotionSpec;
pub use picture::Picture;
pub use place::{LevelCounts, PlaceFacts, PlaceOptions, PreparedPlace};
pub use progress::Progress;
pub use renderer::Renderer;
pub use request::{FrameRequest, NextFrame};
pub use sequence::VideoFile;
pub use shot::{MovingCamera, Patience};
pub use tags::picture_tags;
// Types of these crates stand in public signatures.
pub use wm_render::{CpuConfig, Device};
pub use wm_scene::{Camera, LensModel, LookAt, Metadata, Scene};
pub use wm_weather::Weather;
