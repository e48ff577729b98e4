//! Metrics of images against photos, of geometry against ground truth, and of collections of
//! images, one per file.

mod affine;
mod cmmd;
mod coverage;
mod depth;
mod floaters;
mod normal;
mod sharpness;

pub use crate::ssim::Ssim;
pub(crate) use affine::fit_exposure;
pub use cmmd::{Cmmd, Collection, EmbeddingError, EmbeddingFault, Embeddings};
pub use coverage::{DEPTH_TOLERANCE_SHARE, MIN_SURFACE_COVERAGE, SurfaceLost};
pub(crate) use coverage::{sky_covered, surface_lost};
pub use depth::DepthErrors;
pub(crate) use depth::depth_errors;
pub use floaters::FloaterShare;
pub(crate) use floaters::Floaters;
pub(crate) use normal::normal_errors;
pub use normal::{NormalErrors, angle};
pub(crate) use sharpness::sharpness;
