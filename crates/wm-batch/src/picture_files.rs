//! Pictures as files in memory.

use crate::{CameraInfo, SensorInfo, SetError};
use wm_image::PictureSize;
use wm_image::jpeg::{self, SamplingFactor};

/// Quality of JPEG files, 1-100; public data sets store pictures of vehicles at 80 to 95.
const JPEG_QUALITY: u8 = 92;

/// Encodes `rgb [H, W, 3]` as a PNG.
pub(crate) fn png(sensor: &SensorInfo, camera: &CameraInfo, rgb: &[u8]) -> Result<Vec<u8>, SetError> {
    check_size(sensor, camera, rgb)?;
    let (width, height) = camera.size;
    wm_image::png::encode_rgb8(rgb, PictureSize::new(width, height)).map_err(|error| problem(sensor, &error))
}

/// Encodes `rgb [H, W, 3]` as a JPEG. Chroma has the full resolution: for half of it, the encoder
/// would take every fourth pixel instead of their mean, and small lights would lose their colour.
pub(crate) fn jpeg(sensor: &SensorInfo, camera: &CameraInfo, rgb: &[u8]) -> Result<Vec<u8>, SetError> {
    check_size(sensor, camera, rgb)?;
    jpeg::encode(rgb, camera.size, JPEG_QUALITY, SamplingFactor::F_1_1)
        .map_err(|error| problem(sensor, &error))
}

fn check_size(sensor: &SensorInfo, camera: &CameraInfo, rgb: &[u8]) -> Result<(), SetError> {
    let (width, height) = camera.size;
    if rgb.len() as u64 == 3 * u64::from(width) * u64::from(height) {
        return Ok(());
    }
    Err(problem(sensor, &format!("{} bytes are no picture of {width}x{height} px", rgb.len())))
}

fn problem(sensor: &SensorInfo, problem: &dyn std::fmt::Display) -> SetError {
    SetError::Picture { sensor: sensor.name.clone(), problem: problem.to_string() }
}
