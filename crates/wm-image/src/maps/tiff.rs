//! Maps as TIFF: floats, or counts of 8 or 16 bits, in strips or tiles. The first picture of a
//! file.

use super::error::MapFault;
use super::map::{Map, Stored, check_size, words};
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};

pub(super) fn decode(bytes: &[u8]) -> Result<Map, MapFault> {
    let mut limits = Limits::default();
    // The size is looked at before pixels are read; this is for what lies between.
    limits.decoding_buffer_size = 2 << 30;
    limits.intermediate_buffer_size = 1 << 30;
    limits.ifd_value_size = 16 << 20;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(|e| words(&e))?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(|e| words(&e))?;
    let color = decoder.colortype().map_err(|e| words(&e))?;
    let (channels, bits) = (u64::from(color.num_samples()), u64::from(color.bit_depth()));
    check_size(width.into(), height.into(), channels, bits.div_ceil(8), bytes.len())?;
    let (tile_width, tile_height) = decoder.chunk_dimensions();
    // Tiles reach over the border, but not over a second picture.
    check_size(tile_width.into(), tile_height.into(), channels, bits.div_ceil(8), bytes.len())?;
    let (values, stored): (Vec<f32>, Stored) = match decoder.read_image().map_err(|e| words(&e))? {
        DecodingResult::F32(values) => (values, Stored::Floats),
        DecodingResult::F16(values) => (values.into_iter().map(f32::from).collect(), Stored::Floats),
        DecodingResult::F64(values) => (values.into_iter().map(|v| v as f32).collect(), Stored::Floats),
        DecodingResult::U16(values) => {
            (values.into_iter().map(f32::from).collect(), Stored::Counts(f32::from(u16::MAX)))
        }
        DecodingResult::U8(values) => {
            (values.into_iter().map(f32::from).collect(), Stored::Counts(f32::from(u8::MAX)))
        }
        _ => return Err(MapFault::Unsupported("a TIFF of neither floats nor 8 or 16-bit counts".into())),
    };
    // Of channels that lie apart only the first is read, of 1-bit pixels a byte has eight.
    let pixels = width as usize * height as usize;
    if values.len() as u64 != pixels as u64 * channels || channels > 4 {
        return Err(MapFault::Unsupported(format!(
            "a TIFF of {bits} bits and {channels} channels, which may lie apart"
        )));
    }
    Ok(Map { stored, ..Map::new(width, height, channels as u32, values) })
}
