//! Decodes photos: JPEG and PNG to 8-bit RGB, as stored. Colour profiles are not looked at, sRGB is
//! taken for granted.

use crate::header::{PhotoKind, read_header};
use std::{
    fs,
    io::Cursor,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
};
use thiserror::Error;
use wm_base::FormatError;
use wm_scene::camera::MAX_SIDE;
use zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions};
use zune_jpeg::JpegDecoder;

/// Most pixels of a photo: 256 million, 768 MiB decoded.
const MAX_PIXELS: u64 = 1 << 28;

/// A photo that cannot be read.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{}: {fault}", path.display())]
pub struct DecodeError {
    /// The file.
    pub path: PathBuf,
    /// The fault.
    pub fault: DecodeFault,
}

/// A fault of a photo file.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum DecodeFault {
    /// It cannot be read, is no JPEG or PNG, or is refused for its size.
    #[error("{0}")]
    Unreadable(String),
    /// It does not decode.
    #[error("the photo is damaged ({0}); copy it again")]
    Damaged(String),
}

impl DecodeError {
    /// Returns the fault of a file whose header cannot be read.
    #[must_use]
    pub fn of_header(error: &FormatError) -> Self {
        Self { path: error.path.clone(), fault: DecodeFault::Unreadable(error.problem.to_string()) }
    }
}

/// A picture as the file has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoded {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Colours `[H, W, 3]`.
    pub rgb: Vec<u8>,
    /// Opacities `[H, W]`, if any pixel is not opaque.
    pub alpha: Option<Vec<u8>>,
}

/// Reads a JPEG or PNG as it is stored. `fits` may refuse its size before it is decoded.
///
/// # Errors
/// [`DecodeError`] if it cannot be read, does not decode, or is refused
/// ([`DecodeFault::Unreadable`] with the words of `fits`).
pub fn read_photo(
    path: &Path,
    fits: &dyn Fn(u32, u32) -> Result<(), String>,
) -> Result<Decoded, DecodeError> {
    let header = read_header(path).map_err(|e| DecodeError::of_header(&e))?;
    fits(header.width, header.height)
        .map_err(|why| DecodeError { path: path.into(), fault: DecodeFault::Unreadable(why) })?;
    decode_photo(path, header.kind)
}

/// Decodes a photo of a known kind.
///
/// # Errors
/// [`DecodeError`] if it cannot be read or does not decode.
pub fn decode_photo(path: &Path, kind: PhotoKind) -> Result<Decoded, DecodeError> {
    let fault = |fault| DecodeError { path: path.into(), fault };
    let bytes = fs::read(path).map_err(|e| fault(DecodeFault::Unreadable(format!("cannot be read: {e}"))))?;
    decode(&bytes, kind).map_err(|what| fault(DecodeFault::Damaged(what)))
}

/// Decodes a photo.
///
/// # Errors
/// A few words on what is wrong with it.
pub fn decode(bytes: &[u8], kind: PhotoKind) -> Result<Decoded, String> {
    let decoder = match kind {
        PhotoKind::Jpeg => jpeg,
        PhotoKind::Png => png,
    };
    // A photo that trips a decoder's own checks is a bad photo, not the end of a training of hours.
    let decoded = catch_unwind(AssertUnwindSafe(|| decoder(bytes)))
        .unwrap_or_else(|_| Err("the decoder gave up".into()))?;
    let pixels = u64::from(decoded.width) * u64::from(decoded.height);
    if decoded.rgb.len() as u64 != 3 * pixels {
        return Err("its pixels do not fill its size".into());
    }
    Ok(decoded)
}

fn too_large(width: u64, height: u64) -> Option<String> {
    let is_large = width > MAX_SIDE.into() || height > MAX_SIDE.into() || width * height > MAX_PIXELS;
    is_large.then(|| format!("{width} x {height} px are more than can be held"))
}

fn jpeg(bytes: &[u8]) -> Result<Decoded, String> {
    if !is_whole(bytes) {
        return Err("cut off: it has no end marker".into());
    }
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE as usize)
        .set_max_height(MAX_SIDE as usize)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| words(&e))?;
    let (width, height) = decoder.dimensions().ok_or("it has no size")?;
    if let Some(fault) = too_large(width as u64, height as u64) {
        return Err(fault);
    }
    let rgb = decoder.decode().map_err(|e| words(&e))?;
    Ok(Decoded { width: width as u32, height: height as u32, rgb, alpha: None })
}

/// Returns true if a JPEG has its end marker. Decoders fill up what is missing with grey, so that
/// half a photo would be taken for a whole one.
///
/// It is looked for behind the header, which may hold a whole JPEG as a preview, and backwards,
/// since some programs append data of their own. Entropy-coded data cannot contain it.
fn is_whole(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xda;
    let mut at = 2;
    while let Some([0xff, marker, high, low]) = bytes.get(at..).and_then(|rest| rest.first_chunk()) {
        match marker {
            // Padding before a marker.
            0xff => at += 1,
            &START_OF_SCAN => break,
            _ => at += 2 + usize::from(u16::from_be_bytes([*high, *low])),
        }
    }
    bytes.get(at..).is_some_and(|rest| rest.windows(2).rev().any(|pair| pair == [0xff, 0xd9]))
}

fn png(bytes: &[u8]) -> Result<Decoded, String> {
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 64 << 20 });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| words(&e))?;
    let (width, height) = (reader.info().width, reader.info().height);
    if let Some(fault) = too_large(width.into(), height.into()) {
        return Err(fault);
    }
    let size = reader.output_buffer_size().ok_or("it is larger than memory")?;
    let mut out = vec![0; size];
    let info = reader.next_frame(&mut out).map_err(|e| words(&e))?;
    out.truncate(info.buffer_size());
    let (rgb, alpha) = match info.color_type {
        png::ColorType::Rgb => (out, None),
        png::ColorType::Rgba => split::<4>(&out, |[r, g, b, a]| ([r, g, b], a)),
        png::ColorType::Grayscale => (out.iter().flat_map(|v| [*v; 3]).collect(), None),
        png::ColorType::GrayscaleAlpha => split::<2>(&out, |[v, a]| ([v; 3], a)),
        png::ColorType::Indexed => return Err("its palette was not understood".into()),
    };
    Ok(Decoded { width, height, rgb, alpha })
}

fn split<const N: usize>(
    pixels: &[u8],
    part: impl Fn([u8; N]) -> ([u8; 3], u8),
) -> (Vec<u8>, Option<Vec<u8>>) {
    let (pixels, _) = pixels.as_chunks::<N>();
    let rgb = pixels.iter().flat_map(|pixel| part(*pixel).0).collect();
    let alpha: Vec<u8> = pixels.iter().map(|pixel| part(*pixel).1).collect();
    let is_opaque = alpha.iter().all(|a| *a == u8::MAX);
    (rgb, (!is_opaque).then_some(alpha))
}

/// The message of a decoder on one line.
fn words(error: &dyn std::fmt::Debug) -> String {
    let text: String = format!("{error:?}").chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    text.chars().take(160).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;
    use wm_scene::testing::data;

    /// A PNG of 8-bit rows.
    pub(crate) fn encode(width: u32, height: u32, color: png::ColorType, pixels: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(color);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header().unwrap().write_image_data(pixels).unwrap();
        out
    }

    #[test]
    fn pngs_of_every_kind() {
        let read = |bytes: &[u8]| decode(bytes, PhotoKind::Png).unwrap();
        let rgb = read(&encode(2, 1, png::ColorType::Rgb, &[1, 2, 3, 4, 5, 6]));
        assert_eq!(rgb, Decoded { width: 2, height: 1, rgb: vec![1, 2, 3, 4, 5, 6], alpha: None });
        assert_eq!(read(&encode(2, 1, png::ColorType::Grayscale, &[7, 9])).rgb, [7, 7, 7, 9, 9, 9]);
        let rgba = read(&encode(2, 1, png::ColorType::Rgba, &[1, 2, 3, 255, 4, 5, 6, 0]));
        assert_eq!((rgba.rgb, rgba.alpha), (vec![1, 2, 3, 4, 5, 6], Some(vec![255, 0])));
        let grey = read(&encode(2, 1, png::ColorType::GrayscaleAlpha, &[7, 255, 9, 255]));
        assert_eq!((grey.rgb, grey.alpha), (vec![7, 7, 7, 9, 9, 9], None));
    }

    #[test]
    fn pngs_cut_at_any_byte_are_errors() {
        let pixels: Vec<u8> = (0..12 * 9 * 3).map(|v| (v * 37 % 251) as u8).collect();
        let bytes = encode(12, 9, png::ColorType::Rgb, &pixels);
        // What follows the pixels themselves (a checksum, the end chunk) may be missing.
        for end in 0..bytes.len() - 12 - 4 {
            let error = decode(&bytes[..end], PhotoKind::Png).unwrap_err();
            assert!(!error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn real_jpegs_are_decoded_and_cut_ones_told() {
        let Some(path) = data("photos/sceaux-castle/images/100_7100.jpg") else { return };
        let bytes = fs::read(path).unwrap();
        let photo = decode(&bytes, PhotoKind::Jpeg).unwrap();
        assert_eq!((photo.width, photo.height), (1200, 887));
        let mean = photo.rgb.iter().map(|v| u64::from(*v)).sum::<u64>() as f64 / photo.rgb.len() as f64;
        assert!((60.0..200.0).contains(&mean), "{mean}");
        for share in [1, 20, 50, 90, 99] {
            let end = bytes.len() * share / 100;
            let error = decode(&bytes[..end], PhotoKind::Jpeg).unwrap_err();
            assert!(!error.is_empty() && !error.contains('\n'), "{share}: {error}");
        }
    }

    proptest! {
        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), is_png: bool) {
            let start: &[u8] = if is_png { b"\x89PNG\r\n\x1a\n" } else { &[0xff, 0xd8, 0xff] };
            let kind = if is_png { PhotoKind::Png } else { PhotoKind::Jpeg };
            prop_assert!(decode(&[start, &bytes, &[0xff, 0xd9]].concat(), kind).is_err());
        }
    }
}
