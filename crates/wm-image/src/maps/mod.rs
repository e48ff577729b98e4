//! Depth, normal and mask maps of photos that are given as files.
//!
//! | file | values | channels |
//! |---|---|---|
//! | `.png` | 8 or 16-bit counts | grey or colour |
//! | `.tif`, `.tiff` | 16, 32 or 64-bit floats, 8 or 16-bit counts; strips or tiles | 1 to 4, interleaved |
//! | `.exr` | 16 or 32-bit floats | see [`read_map`] |
//! | `.npy` | little-endian f32 | `[H, W]`, `[H, W, C]` with 1 to 4 |
//!
//! A file becomes a [`Map`] of the numbers in it; what they mean is said beside it: [`DepthForm`],
//! [`NormalAxes`], `Map::to_mask`. Which file belongs to a photo is told by its name
//! ([`MapFolder`]). Pixels are those of the photo without its lens: where a camera has distortion,
//! the maps are of the pinhole picture, or made so
//! (`Photos::without_lens` of `wm-train`).

mod depth;
mod error;
mod exr;
mod find;
mod map;
mod normal;
mod npy;
mod png;
mod resample;
#[cfg(test)]
mod tests;
mod tiff;
mod unit;

pub use depth::DepthForm;
pub use error::{MapError, MapFault};
pub use find::MapFolder;
pub use map::{MAX_VALUES, Map, Stored};
pub use normal::NormalAxes;
pub use resample::Filter;
pub use unit::DepthUnit;

use std::{
    fs::File,
    io::Read,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
};

/// Longest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 31;
/// A file's format by its first bytes.
#[derive(Clone, Copy)]
enum Format {
    Png,
    Tiff,
    Exr,
    Npy,
}

impl Format {
    fn of(bytes: &[u8]) -> Option<Self> {
        const SIGNATURES: [(&[u8], Format); 7] = [
            (b"\x89PNG\r\n\x1a\n", Format::Png),
            (b"II*\0", Format::Tiff),
            (b"MM\0*", Format::Tiff),
            (b"II+\0", Format::Tiff),
            (b"MM\0+", Format::Tiff),
            (b"\x76\x2f\x31\x01", Format::Exr),
            (b"\x93NUMPY", Format::Npy),
        ];
        SIGNATURES.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, format)| *format)
    }
}

/// Reads a map; the format is told by the content.
///
/// The channels of an EXR file are taken in this order: Z alone where there is no X beside it; N.X,
/// N.Y, N.Z; X, Y, Z; R, G, B; Y; else the first.
///
/// # Errors
/// [`MapError`] if the file is missing, damaged, too large, or of another kind. Sizes are believed
/// only if the file is long enough for them.
pub fn read_map(path: &Path) -> Result<Map, MapError> {
    let fault = |fault| MapError { path: path.into(), fault };
    let bytes = read_file(path).map_err(fault)?;
    let Some(format) = Format::of(&bytes) else { return Err(fault(MapFault::Unknown)) };
    // A map that trips a decoder's own checks is a bad map, not the end of the program.
    let decoded = catch_unwind(AssertUnwindSafe(|| match format {
        Format::Png => png::decode(&bytes),
        Format::Tiff => tiff::decode(&bytes),
        Format::Exr => exr::decode(&bytes),
        Format::Npy => npy::decode(path),
    }));
    decoded.unwrap_or_else(|_| Err(MapFault::Damaged("the decoder gave up".into()))).map_err(fault)
}

fn read_file(path: &Path) -> Result<Vec<u8>, MapFault> {
    let cannot = |e: std::io::Error| MapFault::Unreadable(e.to_string());
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        return Err(MapFault::Unreadable("it is no regular file".into()));
    }
    if about.len() > MAX_FILE_BYTES {
        return Err(MapFault::Large(format!("{} bytes", about.len())));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(MAX_FILE_BYTES).read_to_end(&mut bytes)).map_err(cannot)?;
    Ok(bytes)
}
