//! JPEG: pictures for pages.

use jpeg_encoder::{ColorType, Encoder, EncodingError};
use thiserror::Error;

pub use jpeg_encoder::SamplingFactor;

/// The reason why a picture could not be encoded as a JPEG.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum JpegError {
    /// A side is longer than the format allows.
    #[error("{0}x{1} px are too many for a JPEG: a side has at most 65,535")]
    TooLarge(u32, u32),
    /// The encoder refused the picture.
    #[error(transparent)]
    Encode(#[from] EncodingError),
}

/// Encodes bytes `[H, W, 3]` of a width and a height as a JPEG with a quality of 1-100.
///
/// # Errors
/// [`JpegError`] if a side is longer than 65,535 px.
pub fn encode(
    rgb: &[u8],
    size: (u32, u32),
    quality: u8,
    sampling: SamplingFactor,
) -> Result<Vec<u8>, JpegError> {
    let (width, height) = size;
    let side = |side: u32| u16::try_from(side).map_err(|_| JpegError::TooLarge(width, height));
    let mut out = Vec::with_capacity(rgb.len() / 8);
    let mut encoder = Encoder::new(&mut out, quality);
    encoder.set_sampling_factor(sampling);
    encoder.encode(rgb, side(width)?, side(height)?, ColorType::Rgb)?;
    Ok(out)
}
