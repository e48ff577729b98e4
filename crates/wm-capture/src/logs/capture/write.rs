//! The files of a capture.

use super::points::ColoredPoints;
use crate::RigidPose;
use crate::logs::log::LogPicture;
use glam::DMat3;
use serde::Serialize;
use std::io;
use std::path::Path;
use wm_base::FormatError;
use wm_base::files::write_atomically;
use wm_scene::camera::Distortion;
use wm_scene::{Camera, Metadata};

/// A frame of `transforms.json`.
#[derive(Serialize)]
pub(super) struct Frame {
    file_path: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mask_path: Option<String>,
    /// world_from_camera with OpenGL axes, row by row.
    transform_matrix: [[f64; 4]; 4],
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    w: u32,
    h: u32,
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
    k3: f64,
    /// Seconds; other programs read it.
    time: f64,
}

#[derive(Serialize)]
struct Transforms {
    camera_model: &'static str,
    ply_file_path: &'static str,
    frames: Vec<Frame>,
}

impl Frame {
    pub(super) fn new(
        photo: &Camera,
        distortion: Distortion,
        picture: &LogPicture,
        file_path: String,
        mask_path: Option<String>,
    ) -> Self {
        let RigidPose { rotation, translation } = picture.world_from_camera;
        let axes = DMat3::from_quat(rotation);
        // OpenGL's y is up and its z backward.
        let rows = DMat3::from_cols(axes.x_axis, -axes.y_axis, -axes.z_axis).transpose();
        let row = |row: glam::DVec3, shift: f64| [row.x, row.y, row.z, shift];
        let [k1, k2, p1, p2, k3] = distortion.coefficients();
        Self {
            file_path,
            mask_path,
            transform_matrix: [
                row(rows.x_axis, translation.x),
                row(rows.y_axis, translation.y),
                row(rows.z_axis, translation.z),
                [0.0, 0.0, 0.0, 1.0],
            ],
            fl_x: photo.fx,
            fl_y: photo.fy,
            cx: photo.cx,
            cy: photo.cy,
            w: photo.width,
            h: photo.height,
            k1,
            k2,
            p1,
            p2,
            k3,
            time: picture.timestamp as f64 * 1e-9,
        }
    }
}

/// Writes `transforms.json`.
pub(super) fn transforms(path: &Path, frames: Vec<Frame>) -> Result<(), FormatError> {
    json(path, &Transforms { camera_model: "OPENCV", ply_file_path: "points.ply", frames })
}

/// Writes JSON.
pub(super) fn json(path: &Path, value: &impl Serialize) -> Result<(), FormatError> {
    let text = serde_json::to_vec_pretty(value)
        .map_err(|e| FormatError::value(path, format!("cannot be written as JSON: {e}")))?;
    write_atomically(path, |out| Ok(out.write_all(&text)?))
}

/// Writes facts as TOML.
pub(super) fn facts(path: &Path, facts: &Metadata) -> Result<(), FormatError> {
    let entries = facts.entries().map_err(|what| FormatError::value(path, what))?;
    let text: String = entries.iter().map(|(key, value)| format!("{key} = {value}\n")).collect();
    write_atomically(path, |out| Ok(out.write_all(text.as_bytes())?))
}

/// Writes points as binary PLY. Positions are doubles: they are read as such.
pub(super) fn points(path: &Path, points: &ColoredPoints) -> Result<(), FormatError> {
    write_atomically(path, |out| {
        let count = points.len();
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty double x\nproperty double y\nproperty double z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
        )?;
        for (position, color) in points.positions.iter().zip(&points.colors) {
            for value in position.to_array() {
                out.write_all(&value.to_le_bytes())?;
            }
            out.write_all(color)?;
        }
        Ok(())
    })
}

/// Writes a grey PNG `[H, W]`.
pub(super) fn grey(path: &Path, bytes: &[u8], width: u32, height: u32) -> Result<(), FormatError> {
    write_atomically(path, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Eight);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(bytes));
        Ok(written.map_err(io::Error::from)?)
    })
}
