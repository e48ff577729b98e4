//! Pictures of logs as arrays of bytes.

use crate::logs::files::{MAX_BINARY_BYTES, fault, read_bytes};
use std::path::Path;
use wm_base::FormatError;
use wm_image::header::PhotoKind;
use wm_image::photo::{Decoded, decode};

/// A photo.
pub(super) struct Rgb {
    width: u32,
    height: u32,
    /// `[H, W, 3]`, sRGB.
    bytes: Vec<u8>,
}

impl Rgb {
    /// Reads a JPEG or PNG that must have this size, px.
    pub(super) fn read(path: &Path, size: (u32, u32)) -> Result<Self, FormatError> {
        let bytes = read_bytes(path, MAX_BINARY_BYTES)?;
        let kind = if bytes.starts_with(b"\x89PNG") { PhotoKind::Png } else { PhotoKind::Jpeg };
        let Decoded { width, height, rgb, .. } = decoded(path, &bytes, kind)?;
        if (width, height) != size {
            return Err(fault(
                path,
                format!("{width}x{height} px, and {}x{} in the calibration", size.0, size.1),
            ));
        }
        Ok(Self { width, height, bytes: rgb })
    }

    /// The index of the pixel at these px.
    pub(super) fn pixel(&self, x: f64, y: f64) -> Option<usize> {
        let is_within =
            (0.0..f64::from(self.width)).contains(&x) && (0.0..f64::from(self.height)).contains(&y);
        is_within.then(|| y as usize * self.width as usize + x as usize)
    }

    /// The colour of a pixel.
    pub(super) fn at(&self, pixel: usize) -> [u8; 3] {
        self.bytes.as_chunks::<3>().0.get(pixel).copied().unwrap_or_default()
    }
}

/// A picture of one channel, the first of its colours: width, height and bytes.
pub(super) fn read_grey(path: &Path) -> Result<(u32, u32, Vec<u8>), FormatError> {
    let picture = decoded(path, &read_bytes(path, MAX_BINARY_BYTES)?, PhotoKind::Png)?;
    Ok((picture.width, picture.height, picture.rgb.into_iter().step_by(3).collect()))
}

fn decoded(path: &Path, bytes: &[u8], kind: PhotoKind) -> Result<Decoded, FormatError> {
    let name = if kind == PhotoKind::Png { "PNG" } else { "JPEG" };
    decode(bytes, kind).map_err(|what| fault(path, format!("no {name} that can be read: {what}")))
}
