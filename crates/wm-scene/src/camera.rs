//! A pinhole camera: intrinsics, pose and near plane.

mod distortion;
mod lens;
mod lens_file;
mod look_at;
mod pinhole;
mod rigid;

pub use distortion::Distortion;
pub use lens::LensModel;
pub use look_at::LookAt;
pub use pinhole::{Camera, CameraError, FOV_RANGE_DEG, MAX_PIXELS, MAX_SIDE};
pub use rigid::{PoseFault, rotation_of, viewmat_at, viewmat_of};
