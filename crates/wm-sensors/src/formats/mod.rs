//! Files of points: PLY, PCD, NPY, LAS and KITTI's .bin.
//!
//! | extension | what it is | a point |
//! |---|---|---|
//! | `.ply` | binary PLY, little-endian | x y z intensity range time (float), column (uint), ring (ushort), return, class (uchar) |
//! | `.pcd` | PCD 0.7, binary | the same |
//! | `.npy` | NumPy, float32 `[N, 10]` | x y z intensity range time ring column return class |
//! | `.las` | LAS 1.2, point format 3 | mm, in the world also where the scene has a local origin; intensity in 16 bits, time, grey, class, ring as point source |
//! | `.bin` | KITTI, float32 `[N, 4]` | x y z intensity (0-1) |
//!
//! All are written whole or not at all.

mod las;
mod records;

pub(crate) use records::{pcd_header, ply_header, write_records};

use crate::error::SensorError;
use crate::sweep::{LidarPoint, LidarSweep};
use std::path::Path;
use wm_base::npy;

/// A format of points, and of the detections of a radar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointFormat {
    /// Binary PLY.
    Ply,
    /// Point Cloud Library.
    Pcd,
    /// NumPy.
    Npy,
    /// LAS of ASPRS.
    Las,
    /// KITTI.
    Bin,
}

/// Types and names of the numbers of a point in PLY and PCD: 32 bytes.
const FIELDS: &str = "float x, float y, float z, float intensity, float range, float time, \
                      uint column, ushort ring, uchar return, uchar class";

impl PointFormat {
    /// The format of points in a file, by its name's extension.
    ///
    /// # Errors
    /// [`SensorError::Extension`] if it has another.
    pub fn of(path: &Path) -> Result<Self, SensorError> {
        let formats = "points are written to names that end in .ply, .pcd, .npy, .las or .bin";
        Self::among(&[Self::Ply, Self::Pcd, Self::Npy, Self::Las, Self::Bin], path, formats)
    }

    /// The format of detections in a file, by its name's extension: PLY, PCD or NPY.
    ///
    /// # Errors
    /// [`SensorError::Extension`] if it has another.
    pub fn of_detections(path: &Path) -> Result<Self, SensorError> {
        let formats = "detections are written to names that end in .ply, .pcd or .npy";
        Self::among(&[Self::Ply, Self::Pcd, Self::Npy], path, formats)
    }

    /// Finds the format whose extension a path has, in either case.
    fn among(all: &[Self], path: &Path, formats: &'static str) -> Result<Self, SensorError> {
        let own = path.extension().map(|text| text.to_string_lossy().to_lowercase()).unwrap_or_default();
        let found = all.iter().copied().find(|format| format.extension() == own);
        found.ok_or_else(|| SensorError::Extension { path: path.into(), formats })
    }

    /// The extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Npy => "npy",
            Self::Las => "las",
            Self::Bin => "bin",
        }
    }
}

impl LidarSweep {
    /// Writes the points in the format of the name's extension, see [`PointFormat`].
    ///
    /// # Errors
    /// [`SensorError`] if the format is unknown, the points do not fit it, or the file cannot be
    /// written.
    pub fn save(&self, path: &Path) -> Result<(), SensorError> {
        let name = self.name.replace('\n', " ");
        match PointFormat::of(path)? {
            PointFormat::Ply => {
                let about = format!(
                    "comment {name}, {} s, metres; class 0 surface, 1 drop, 2 flake, 3 air, 4 ghost\n{}",
                    self.time[0],
                    self.origin_line("comment ")
                );
                write_records(path, &ply_header(&about, FIELDS, self.points.len()), &self.points, record)
            }
            PointFormat::Pcd => {
                let [x, y, z, w] = glam::DQuat::from_mat3(&self.pose.world_from_sensor).to_array();
                let origin = self.origin_line("# ");
                let about = format!("# {name}; sensor in the scene, wxyz: {w} {x} {y} {z}\n{origin}");
                write_records(path, &pcd_header(&about, FIELDS, self.points.len()), &self.points, record)
            }
            PointFormat::Bin => write_records(path, b"", &self.points, |point, out| {
                let [x, y, z] = point.position;
                [x, y, z, point.intensity / 255.0].iter().for_each(|v| out.extend(v.to_le_bytes()));
            }),
            PointFormat::Npy => {
                let row = |point: &LidarPoint| {
                    let LidarPoint { position: [x, y, z], intensity, range, time, .. } = *point;
                    let (rank, class) = (f32::from(point.rank as u8), f32::from(point.class as u8));
                    [x, y, z, intensity, range, time, point.ring.into(), point.column as f32, rank, class]
                };
                let values: Vec<f32> = self.points.iter().flat_map(row).collect();
                Ok(npy::write(path, &values, &[self.points.len(), 10])?)
            }
            PointFormat::Las => las::save(self, path),
        }
    }

    /// A line of comment on where in the world the origin of the points is; empty if it is there
    /// too.
    fn origin_line(&self, comment: &str) -> String {
        match self.origin.to_array() {
            [0.0, 0.0, 0.0] => String::new(),
            [x, y, z] => format!("{comment}origin in the world: {x} {y} {z} m\n"),
        }
    }
}

/// A point in PLY and PCD, see [`FIELDS`].
fn record(point: &LidarPoint, out: &mut Vec<u8>) {
    let [x, y, z] = point.position;
    [x, y, z, point.intensity, point.range, point.time].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(point.column.to_le_bytes());
    out.extend(point.ring.to_le_bytes());
    out.extend([point.rank as u8, point.class as u8]);
}

#[cfg(test)]
mod tests;
