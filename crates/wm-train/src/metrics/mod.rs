//! How near a picture is to a photo, one metric a file.

mod psnr;

pub use crate::ssim::Ssim;
pub use psnr::psnr;
