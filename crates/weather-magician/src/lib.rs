//! Real weather on real places: renders 3D Gaussian splatting scenes in fog, rain and snow.

mod error;
pub mod panorama_file;
mod progress;
pub mod reduce;
pub mod view;

pub use error::{Error, Result};
pub use progress::Progress;
