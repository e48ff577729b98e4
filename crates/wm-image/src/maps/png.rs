//! Maps as PNG: counts of 8 or 16 bits.

use super::error::MapFault;
use super::map::{Map, Stored, check_size, words};
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use std::io::Cursor;

/// The text that says what a count of depth is, as `render` writes it.
const METRES_PER_COUNT: &str = "depth_metres_per_count";

pub(super) fn decode(bytes: &[u8]) -> Result<Map, MapFault> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: 64 << 20 });
    // Palettes to colours, 1 to 4 bits to 8; 16 bits stay.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|e| words(&e))?;
    let (color, depth) = reader.output_color_type();
    let channels = match color {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return Err(MapFault::Damaged("its palette was not understood".into())),
    };
    let (sample, full) = if depth == BitDepth::Sixteen { (2, 65535.0) } else { (1, 255.0) };
    let (width, height) = reader.info().size();
    check_size(width.into(), height.into(), channels.into(), sample, bytes.len())?;
    let size = reader.output_buffer_size().ok_or_else(|| MapFault::Large("its pixels".into()))?;
    let mut out = vec![0; size];
    let info = reader.next_frame(&mut out).map_err(|e| words(&e))?;
    out.truncate(info.buffer_size());
    let values: Vec<f32> = match sample {
        2 => out.as_chunks::<2>().0.iter().map(|pair| f32::from(u16::from_be_bytes(*pair))).collect(),
        _ => out.iter().map(|byte| f32::from(*byte)).collect(),
    };
    if values.len() != width as usize * height as usize * channels as usize {
        return Err(MapFault::Damaged("its pixels do not fill its size".into()));
    }
    let texts = &reader.info().uncompressed_latin1_text;
    let step = texts.iter().find(|text| text.keyword == METRES_PER_COUNT);
    let step = step.and_then(|text| text.text.parse().ok()).filter(|v: &f64| v.is_finite() && *v > 0.0);
    Ok(Map {
        stored: Stored::Counts(full),
        metres_per_step: step,
        ..Map::new(width, height, channels, values)
    })
}
