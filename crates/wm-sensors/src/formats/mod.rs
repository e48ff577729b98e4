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

use crate::error::SensorError;
use crate::sweep::{LidarPoint, LidarSweep};
use std::io::Write;
use std::path::Path;
use wm_base::files::write_atomically;
use wm_base::{Problem, npy};

/// A format of points.
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

/// The names that points are written to.
const FORMATS: &str = "points are written to names that end in .ply, .pcd, .npy, .las or .bin";
/// Points that are written at once.
const PART_POINTS: usize = 4096;

impl PointFormat {
    /// The format of a name's extension.
    ///
    /// # Errors
    /// [`SensorError::Extension`] if it has another.
    pub fn of(path: &Path) -> Result<Self, SensorError> {
        let all = [Self::Ply, Self::Pcd, Self::Npy, Self::Las, Self::Bin];
        format_of(path, &all, Self::extension, FORMATS)
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

/// Finds the format whose extension a path has, in either case.
pub(crate) fn format_of<T: Copy>(
    path: &Path,
    all: &[T],
    extension: fn(T) -> &'static str,
    formats: &'static str,
) -> Result<T, SensorError> {
    let own = path.extension().map(|text| text.to_string_lossy().to_lowercase()).unwrap_or_default();
    let found = all.iter().copied().find(|format| extension(*format) == own);
    found.ok_or_else(|| SensorError::Extension { path: path.into(), formats })
}

impl LidarSweep {
    /// Writes the points in the format of the name's extension, see [`PointFormat`].
    ///
    /// # Errors
    /// [`SensorError`] if the format is unknown, the points do not fit it, or the file cannot be
    /// written.
    pub fn save(&self, path: &Path) -> Result<(), SensorError> {
        match PointFormat::of(path)? {
            PointFormat::Ply => self.records(path, &ply_header(self), record),
            PointFormat::Pcd => self.records(path, &pcd_header(self), record),
            PointFormat::Bin => self.records(path, "", |point, out| {
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

    /// Writes a header and a record a point.
    fn records(
        &self,
        path: &Path,
        header: &str,
        record: impl Fn(&LidarPoint, &mut Vec<u8>),
    ) -> Result<(), SensorError> {
        write_atomically(path, |out| {
            out.write_all(header.as_bytes())?;
            write_parts(&self.points, out, record)
        })?;
        Ok(())
    }
}

/// Writes records part by part.
fn write_parts(
    points: &[LidarPoint],
    out: &mut dyn Write,
    record: impl Fn(&LidarPoint, &mut Vec<u8>),
) -> Result<(), Problem> {
    let mut bytes = Vec::new();
    for part in points.chunks(PART_POINTS) {
        bytes.clear();
        part.iter().for_each(|point| record(point, &mut bytes));
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// A point in PLY and PCD: 32 bytes.
fn record(point: &LidarPoint, out: &mut Vec<u8>) {
    let [x, y, z] = point.position;
    [x, y, z, point.intensity, point.range, point.time].iter().for_each(|v| out.extend(v.to_le_bytes()));
    out.extend(point.column.to_le_bytes());
    out.extend(point.ring.to_le_bytes());
    out.extend([point.rank as u8, point.class as u8]);
}

/// A line of comment on where in the world the origin of the points is; empty if it is there too.
fn origin_line(sweep: &LidarSweep, comment: &str) -> String {
    let [x, y, z] = sweep.origin.to_array();
    if [x, y, z] == [0.0; 3] {
        String::new()
    } else {
        format!("{comment}origin in the world: {x} {y} {z} m\n")
    }
}

fn ply_header(sweep: &LidarSweep) -> String {
    let floats: String = ["x", "y", "z", "intensity", "range", "time"]
        .iter()
        .map(|name| format!("property float {name}\n"))
        .collect();
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment {}, {} s, metres; class 0 surface, 1 drop, 2 flake, 3 air, 4 ghost\n\
         {}element vertex {}\n{floats}property uint column\nproperty ushort ring\nproperty uchar return\nproperty uchar class\n\
         end_header\n",
        sweep.name.replace('\n', " "),
        sweep.time[0],
        origin_line(sweep, "comment "),
        sweep.points.len()
    )
}

fn pcd_header(sweep: &LidarSweep) -> String {
    let count = sweep.points.len();
    let origin = origin_line(sweep, "# ");
    let [w, x, y, z] = {
        let q = glam::DQuat::from_mat3(&sweep.pose.world_from_sensor);
        [q.w, q.x, q.y, q.z]
    };
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# {}; sensor in the scene, wxyz: {w} {x} {y} {z}\n{origin}VERSION 0.7\n\
         FIELDS x y z intensity range time column ring return class\nSIZE 4 4 4 4 4 4 4 2 1 1\nTYPE F F F F F F U U U U\n\
         COUNT 1 1 1 1 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n",
        sweep.name.replace('\n', " ")
    )
}

#[cfg(test)]
mod tests;
