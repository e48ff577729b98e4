//! How near a picture is to a photo, and a scene to the place, one metric a file.

mod affine;
pub mod coverage;
mod depth;
mod floaters;
mod normal;
mod psnr;

pub use crate::ssim::Ssim;
pub use affine::fit_exposure;
pub use coverage::{SurfaceLost, sky_covered, surface_lost};
pub use depth::{DELTA, DepthErrors, depth_errors};
pub use floaters::{FAINTEST, FloaterShare, Floaters};
pub use normal::{NormalErrors, angle, normal_errors};
pub use psnr::psnr;
