//! Metrics of images against photos, of geometry against ground truth, and of collections of
//! images, one per file.

mod affine;
mod cmmd;
pub mod coverage;
mod depth;
mod floaters;
mod normal;
mod psnr;
mod sharpness;

pub use crate::ssim::Ssim;
pub use affine::fit_exposure;
pub use cmmd::{Cmmd, Collection, EmbeddingError, EmbeddingFault, Embeddings};
pub use coverage::{SurfaceLost, sky_covered, surface_lost};
pub use depth::{DELTA, DepthErrors, depth_errors};
pub use floaters::{FAINTEST, FloaterShare, Floaters};
pub use normal::{NormalErrors, angle, normal_errors};
pub use psnr::psnr;
pub use sharpness::sharpness;
