//! Real weather on real places: renders 3D Gaussian splatting scenes in fog, rain and snow.

pub mod assets;
mod error;
pub mod frame;
pub mod measure;
pub mod output;
pub mod panorama_file;
mod picture;
mod place;
mod progress;
pub mod reduce;
mod renderer;
mod tags;
pub mod view;

pub use error::{Error, Result};
pub use frame::MovingCamera;
pub use picture::Picture;
pub use place::{FrameOptions, Patience, PlaceOptions, PlaceView, PreparedPlace};
pub use progress::Progress;
pub use renderer::Renderer;
pub use tags::picture_tags;
pub use wm_render::{CpuConfig, Device};
pub use wm_scene::{Camera, LookAt, Scene};
pub use wm_weather::Weather;
