//! Pictures as data URIs for HTML pages.

use anyhow::Result;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use std::fmt::Write;
use weather_magician::wm_image::maps::{Filter, Map};
use wm_image::jpeg::{self, SamplingFactor};
use wm_image::ramps::{ColorRamp, MISSING_COLOR, UNKNOWN_COLOR};

/// Maximum width of a picture beside others.
pub(crate) const MAX_WIDTH_PX: u32 = 480;
/// Below this quality, ringing at edges becomes visible.
const JPEG_QUALITY: u8 = 88;
/// Index of the last colour of a ramp; the two after it are [`MISSING_COLOR`] and [`UNKNOWN_COLOR`].
const LAST_RAMP_INDEX: u8 = 253;

/// A pixel of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum MapCell {
    /// A position on the colour ramp, 0-1.
    At(f64),
    /// Known, but not rendered.
    Missing,
    /// Unknown.
    Unknown,
}

/// Returns the size in which a picture is shown, px.
pub(crate) fn shown_size(size: (u32, u32)) -> (u32, u32) {
    at_most(size, MAX_WIDTH_PX)
}

fn at_most(size: (u32, u32), widest: u32) -> (u32, u32) {
    let (width, height) = size;
    if width <= widest {
        return size;
    }
    let scaled = f64::from(height) * f64::from(widest) / f64::from(width);
    (widest, (scaled.round() as u32).max(1))
}

/// Encodes colours, `[H, W, 3]`, 0-1, as a data URI of a JPEG, reduced by area averaging if wider
/// than `widest` px.
pub(crate) fn color(rgb: &[f32], size: (u32, u32), widest: u32) -> Result<String> {
    let (width, height) = at_most(size, widest);
    let small = Map::new(size.0, size.1, 3, rgb.to_vec()).resampled(width, height, Filter::Area);
    let bytes: Vec<u8> = small.values.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    let out = jpeg::encode(&bytes, (width, height), JPEG_QUALITY, SamplingFactor::F_1_1)?;
    Ok(data_uri("image/jpeg", &out))
}

/// Encodes numbers, `[H, W]` of [`shown_size`], in the colours of a ramp as a data URI of a PNG.
pub(crate) fn numbers(cells: &[MapCell], size: (u32, u32), ramp: ColorRamp) -> Result<String> {
    let last = f64::from(LAST_RAMP_INDEX);
    let mut palette: Vec<[u8; 3]> = (0..=LAST_RAMP_INDEX).map(|step| ramp(f64::from(step) / last)).collect();
    palette.extend([MISSING_COLOR, UNKNOWN_COLOR]);
    let index = |cell: &MapCell| match cell {
        MapCell::At(place) => (place.clamp(0.0, 1.0) * last).round() as u8,
        MapCell::Missing => LAST_RAMP_INDEX + 1,
        MapCell::Unknown => LAST_RAMP_INDEX + 2,
    };
    indexed(&cells.iter().map(index).collect::<Vec<u8>>(), size, &palette)
}

/// Encodes a picture with a palette as a data URI of a PNG.
pub(crate) fn indexed(indices: &[u8], size: (u32, u32), palette: &[[u8; 3]]) -> Result<String> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, size.0, size.1);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(palette.concat());
    let mut writer = encoder.write_header()?;
    writer.write_image_data(indices)?;
    writer.finish()?;
    Ok(data_uri("image/png", &out))
}

/// Returns for every shown pixel the index of its nearest map pixel: maps of numbers are not
/// averaged.
pub(crate) fn nearest(size: (u32, u32)) -> Vec<usize> {
    let (width, height) = shown_size(size);
    let along =
        |index: u32, from: u32, to: u32| ((2 * index + 1) as usize * from as usize) / (2 * to as usize);
    let row = |y: u32| {
        let start = along(y, size.1, height) * size.0 as usize;
        (0..width).map(move |x| start + along(x, size.0, width))
    };
    (0..height).flat_map(row).collect()
}

fn data_uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", BASE64_STANDARD.encode(bytes))
}

/// Returns a CSS gradient of a ramp, from left to right.
pub(crate) fn gradient(ramp: ColorRamp) -> String {
    const STOPS: u32 = 24;
    let mut out = "linear-gradient(90deg".to_owned();
    for stop in 0..=STOPS {
        let [r, g, b] = ramp(f64::from(stop) / f64::from(STOPS));
        let _ = write!(out, ",rgb({r} {g} {b})");
    }
    out + ")"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_pictures_are_shown_small() {
        assert_eq!(shown_size((480, 320)), (480, 320));
        assert_eq!(shown_size((1200, 887)), (480, 355));
        assert_eq!(nearest((960, 2)).len(), 480);
        assert_eq!(nearest((3, 2)), [0, 1, 2, 3, 4, 5]);
        assert!(
            color(&[0.5; 3 * 600 * 4], (600, 4), MAX_WIDTH_PX)
                .unwrap()
                .starts_with("data:image/jpeg;base64,/9j/")
        );
        let cells = [MapCell::At(0.0), MapCell::At(9.0), MapCell::Missing, MapCell::Unknown];
        assert!(
            numbers(&cells, (4, 1), wm_image::ramps::heat)
                .unwrap()
                .starts_with("data:image/png;base64,iVBOR")
        );
    }
}
