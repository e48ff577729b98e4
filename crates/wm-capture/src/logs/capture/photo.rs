//! Pictures of logs as arrays of bytes.

use crate::logs::files::{MAX_BINARY_BYTES, fault, read_bytes};
use std::io::Cursor;
use std::path::Path;
use wm_base::FormatError;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Longest side of a picture, px, and most pixels.
const MAX_SIDE_PX: usize = 32_768;
const MAX_PIXELS: u64 = 1 << 27;

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
        let decoded = if bytes.starts_with(b"\x89PNG") { png(&bytes) } else { jpeg(&bytes) };
        let (width, height, channels, bytes) = decoded.map_err(|what| fault(path, what))?;
        if (width, height) != size {
            return Err(fault(
                path,
                format!("{width}x{height} px, and {}x{} in the calibration", size.0, size.1),
            ));
        }
        let bytes = match channels {
            3 => bytes,
            4 => bytes.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            channels => bytes.chunks_exact(channels).flat_map(|pixel| [pixel[0]; 3]).collect(),
        };
        Ok(Self { width, height, bytes })
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
    let bytes = read_bytes(path, MAX_BINARY_BYTES)?;
    let (width, height, channels, bytes) = png(&bytes).map_err(|what| fault(path, what))?;
    Ok((width, height, bytes.chunks_exact(channels).map(|pixel| pixel[0]).collect()))
}

/// Width, height, channels and bytes.
type Decoded = Result<(u32, u32, usize, Vec<u8>), String>;

fn jpeg(bytes: &[u8]) -> Decoded {
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| format!("no JPEG that can be read: {e:?}"))?;
    let (width, height) = decoder.dimensions().ok_or("it has no size")?;
    check(width as u64, height as u64)?;
    let rgb = decoder.decode().map_err(|e| format!("no JPEG that can be read: {e:?}"))?;
    Ok((width as u32, height as u32, 3, rgb))
}

fn png(bytes: &[u8]) -> Decoded {
    let told = |e: png::DecodingError| format!("no PNG that can be read: {e}");
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: 64 << 20 });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(told)?;
    let (width, height) = (reader.info().width, reader.info().height);
    check(width.into(), height.into())?;
    let mut data = vec![0; reader.output_buffer_size().ok_or("it is too large")?];
    let info = reader.next_frame(&mut data).map_err(told)?;
    data.truncate(info.buffer_size());
    Ok((width, height, info.color_type.samples(), data))
}

fn check(width: u64, height: u64) -> Result<(), String> {
    match (1..=MAX_PIXELS).contains(&(width * height)) {
        true => Ok(()),
        false => Err(format!("{width}x{height} px; at most {MAX_PIXELS} pixels are read")),
    }
}
