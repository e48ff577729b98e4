//! JPEG: pictures for pages.

use anyhow::{Context, Result};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// Bytes `[H, W, 3]` as a JPEG of a quality of 1-100.
///
/// # Errors
/// The picture is too large for one.
pub fn encode(
    rgb: &[u8],
    (width, height): (u32, u32),
    quality: u8,
    sampling: SamplingFactor,
) -> Result<Vec<u8>> {
    let side = |side: u32| {
        u16::try_from(side).with_context(|| format!("{width}x{height} px are too many for a JPEG"))
    };
    let mut out = Vec::with_capacity(rgb.len() / 8);
    let mut encoder = Encoder::new(&mut out, quality);
    encoder.set_sampling_factor(sampling);
    encoder.encode(rgb, side(width)?, side(height)?, ColorType::Rgb)?;
    Ok(out)
}
