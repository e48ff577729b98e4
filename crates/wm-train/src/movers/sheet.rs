//! The picture of the masks: photos with movers, and what is left out of the training in red.

use super::MoverMask;
use crate::photos::Photo;
use std::io::{self, Write};

/// The name of the picture in the run folder.
pub const FILE: &str = "movers.png";
/// Most photos in the picture.
pub(crate) const MAX_PHOTOS: usize = 24;
/// Photos side by side, and the width of each, px.
const PHOTOS_PER_ROW: usize = 4;
const PHOTO_WIDTH_PX: usize = 320;
/// The colour of movers, and its weight.
const MOVER_COLOR: [u32; 3] = [230, 20, 20];
const MOVER_WEIGHT: u32 = 3;

/// Writes photos with their masks as a PNG; nothing if there are none.
///
/// # Errors
/// The errors of `out`.
pub(crate) fn write(photos: &[(&Photo, &MoverMask)], out: &mut dyn Write) -> io::Result<()> {
    let Some((first, _)) = photos.first() else { return Ok(()) };
    let height = (PHOTO_WIDTH_PX * first.height as usize / first.width as usize).max(1);
    let (columns, rows) = (photos.len().min(PHOTOS_PER_ROW), photos.len().div_ceil(PHOTOS_PER_ROW));
    let mut rgb = vec![0u8; 3 * columns * PHOTO_WIDTH_PX * rows * height];
    for (number, (photo, mask)) in photos.iter().enumerate() {
        let corner = number / PHOTOS_PER_ROW * height * columns * PHOTO_WIDTH_PX
            + number % PHOTOS_PER_ROW * PHOTO_WIDTH_PX;
        let place = |pixel: usize| {
            3 * (corner + pixel / PHOTO_WIDTH_PX * columns * PHOTO_WIDTH_PX + pixel % PHOTO_WIDTH_PX)
        };
        for pixel in 0..PHOTO_WIDTH_PX * height {
            let x = pixel % PHOTO_WIDTH_PX * photo.width as usize / PHOTO_WIDTH_PX;
            let y = pixel / PHOTO_WIDTH_PX * photo.height as usize / height;
            let from = 3 * (y * photo.width as usize + x);
            rgb[place(pixel)..][..3].copy_from_slice(&photo.rgb[from..from + 3]);
        }
        for pixel in mask.pixels(PHOTO_WIDTH_PX as u32, height as u32) {
            for (value, red) in rgb[place(pixel)..][..3].iter_mut().zip(MOVER_COLOR) {
                *value = ((u32::from(*value) + MOVER_WEIGHT * red) / (1 + MOVER_WEIGHT)) as u8;
            }
        }
    }
    let mut encoder = png::Encoder::new(out, (columns * PHOTO_WIDTH_PX) as u32, (rows * height) as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    writer.write_image_data(&rgb).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)
}
