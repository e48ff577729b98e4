//! The files of a data set: photos and maps.

use crate::PhotoPixel;
use std::{io, path::Path};
use wm_base::{FormatError, files::write_atomically, npy};
use wm_scene::Camera;

/// Writes a picture of `(width, height)` px, sRGB bytes, with a block of EXIF.
pub(crate) fn write_png(
    path: &Path,
    size: (u32, u32),
    rgb: &[u8],
    exif: Option<&[u8]>,
) -> Result<(), FormatError> {
    write_atomically(path, |out| {
        let mut encoder = png::Encoder::new(out, size.0, size.1);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let written = encoder.write_header().and_then(|mut writer| {
            if let Some(exif) = exif {
                writer.write_chunk(png::chunk::eXIf, exif)?;
            }
            writer.write_image_data(rgb)
        });
        Ok(written.map_err(io::Error::from)?)
    })
}

/// Writes depth, normals and sky of a photo to folders of these names.
pub(crate) fn write_maps(
    folder: &Path,
    stem: &str,
    camera: &Camera,
    pixels: &[PhotoPixel],
) -> Result<(), FormatError> {
    write_map(folder, "depth", stem, camera, pixels.iter().map(|pixel| pixel.depth as f32))?;
    let normal: Vec<f32> = pixels.iter().flat_map(|pixel| pixel.normal.as_vec3().to_array()).collect();
    let shape = [camera.height as usize, camera.width as usize, 3];
    npy::write(&folder.join("normal").join(format!("{stem}.npy")), &normal, &shape)?;
    write_map(folder, "sky", stem, camera, pixels.iter().map(|pixel| f32::from(u8::from(pixel.is_sky))))
}

/// Writes a map of one number per pixel to the folder `kind`.
pub(crate) fn write_map(
    folder: &Path,
    kind: &str,
    stem: &str,
    camera: &Camera,
    values: impl Iterator<Item = f32>,
) -> Result<(), FormatError> {
    let values: Vec<f32> = values.collect();
    let shape = [camera.height as usize, camera.width as usize];
    npy::write(&folder.join(kind).join(format!("{stem}.npy")), &values, &shape)
}
