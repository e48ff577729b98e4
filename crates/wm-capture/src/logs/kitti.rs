//! The parts that both forms of KITTI share: calibration files, and cameras of projection matrices.
//!
//! Pictures are rectified: pinholes. `P_i` maps the axes of the rectified first camera to pixels of
//! camera i. KITTI's own are `K [I | b]`, shifted by b; sets in its layout with cameras that look
//! elsewhere have `K [R | b]`.

use super::files::{fault, fault_in_line, numbers, pose_of, read_text};
use super::log::LogCamera;
use crate::RigidPose;
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use wm_base::FormatError;
use wm_scene::camera::Distortion;

/// A file of lines `KEY: NUMBERS`.
pub(super) struct KittiCalibration {
    pub(super) path: PathBuf,
    /// Line and numbers by key.
    values: BTreeMap<String, (usize, Vec<f64>)>,
}

impl KittiCalibration {
    /// Reads it. Values that are no numbers, such as dates, are stepped over.
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let text = read_text(path)?;
        let mut values = BTreeMap::new();
        for (index, line) in text.lines().enumerate() {
            let Some((key, rest)) = line.split_once(':') else { continue };
            if let Ok(numbers) = numbers(path, index + 1, rest) {
                values.insert(key.trim().to_owned(), (index + 1, numbers));
            } else if ["R", "T", "P", "Tr"].iter().any(|start| key.trim().starts_with(start)) {
                // A matrix with a broken number.
                return numbers(path, index + 1, rest).map(|_| Self { path: path.into(), values });
            }
        }
        Ok(Self { path: path.into(), values })
    }

    /// The numbers of a key.
    pub(super) fn get<const N: usize>(&self, key: &str) -> Result<[f64; N], FormatError> {
        let Some((line, values)) = self.values.get(key) else {
            let what = format!("it has no line \"{key}:\"; unpack the calibration again");
            return Err(fault(&self.path, what));
        };
        values.as_slice().try_into().map_err(|_| {
            let count = values.len();
            fault_in_line(&self.path, *line, format!("{key} has {count} numbers, not {N}"))
        })
    }

    /// The pose of keys R and T, or of one key with 12 numbers.
    pub(super) fn pose(&self, rotation: &str, translation: Option<&str>) -> Result<RigidPose, FormatError> {
        let (axes, shift) = match translation {
            Some(translation) => (self.get::<9>(rotation)?, self.get::<3>(translation)?),
            None => {
                let [a, b, c, x, d, e, f, y, g, h, i, z] = self.get::<12>(rotation)?;
                ([a, b, c, d, e, f, g, h, i], [x, y, z])
            }
        };
        let axes = DMat3::from_cols_array(&axes).transpose();
        pose_of(&axes, DVec3::from(shift)).map_err(|what| fault(&self.path, format!("{rotation}: {what}")))
    }

    /// The camera of a projection matrix, and its axes in those of the rectified first camera.
    pub(super) fn camera(
        &self,
        key: &str,
        name: &str,
        size: (u32, u32),
    ) -> Result<(LogCamera, RigidPose), FormatError> {
        let [a, b, c, tx, d, e, f, ty, g, h, i, tz] = self.get::<12>(key)?;
        let [first, second, third] = [[a, b, c], [d, e, f], [g, h, i]].map(DVec3::from);
        // K is upper triangular, so that the rows of the rotation come out one after the other, the
        // last first.
        let (forward, scale) = (third.normalize_or_zero(), third.length());
        let (cy, down) = (second.dot(forward) / scale, second.reject_from_normalized(forward) / scale);
        let (down, fy) = (down.normalize_or_zero(), down.length());
        let (cx, skew) = (first.dot(forward) / scale, first.dot(down) / scale);
        let right =
            (first - first.project_onto_normalized(forward) - first.project_onto_normalized(down)) / scale;
        let (right, fx) = (right.normalize_or_zero(), right.length());
        let axes = DMat3::from_cols(right, down, forward).transpose();
        // Written so that NaN is refused.
        let is_pinhole = skew.abs() < 1e-3 * fx && fx < 1e9 && fy < 1e9 && axes.determinant() > 0.99;
        if !is_pinhole {
            return Err(fault(&self.path, format!("{key} is no projection of a rectified camera")));
        }
        let z = tz / scale;
        let shift = DVec3::new((tx / scale - cx * z) / fx, (ty / scale - cy * z) / fy, z);
        let camera_from_rectified =
            pose_of(&axes, shift).map_err(|what| fault(&self.path, format!("{key}: {what}")))?;
        let camera = LogCamera {
            name: name.into(),
            size,
            focal: [fx, fy],
            center: [cx + 0.5, cy + 0.5],
            distortion: Distortion::None,
        };
        Ok((camera, camera_from_rectified.inverse()))
    }
}
