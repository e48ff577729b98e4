//! Files of detections: PLY, PCD and NPY.
//!
//! | extension | contents | a detection |
//! |---|---|---|
//! | `.ply` | binary PLY, little-endian | x y z range azimuth elevation velocity ground_velocity rcs snr (float), class (uchar) |
//! | `.pcd` | PCD 0.7, binary | the same |
//! | `.npy` | NumPy, float32 `[N, 11]` | the same, in this order |
//!
//! All are written whole or not at all.

use super::sweep::{RadarDetection, RadarSweep};
use crate::error::SensorError;
use crate::formats::format_of;
use std::path::Path;
use wm_base::files::write_atomically;
use wm_base::npy;

/// A format of detections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadarFormat {
    /// Binary PLY.
    Ply,
    /// Point Cloud Library.
    Pcd,
    /// NumPy.
    Npy,
}

/// The names that detections are written to.
const FORMATS: &str = "detections are written to names that end in .ply, .pcd or .npy";

/// The numbers of a detection, in order.
const FIELDS: [&str; 10] =
    ["x", "y", "z", "range", "azimuth", "elevation", "velocity", "ground_velocity", "rcs", "snr"];

fn numbers(one: &RadarDetection) -> [f32; 10] {
    let [x, y, z] = one.position;
    [x, y, z, one.range, one.azimuth, one.elevation, one.velocity, one.ground_velocity, one.rcs, one.snr]
}

impl RadarFormat {
    /// The format of a name's extension.
    ///
    /// # Errors
    /// [`SensorError::Extension`] if it has another.
    pub fn of(path: &Path) -> Result<Self, SensorError> {
        format_of(path, &[Self::Ply, Self::Pcd, Self::Npy], Self::extension, FORMATS)
    }

    /// The extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Npy => "npy",
        }
    }
}

impl RadarSweep {
    /// Writes the detections in the format of the name's extension, see [`RadarFormat`].
    ///
    /// # Errors
    /// [`SensorError`] if the format is unknown or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), SensorError> {
        let header = match RadarFormat::of(path)? {
            RadarFormat::Ply => self.ply_header(),
            RadarFormat::Pcd => self.pcd_header(),
            RadarFormat::Npy => {
                let row = |one: &RadarDetection| {
                    numbers(one).into_iter().chain([f32::from(one.class as u8)]).collect::<Vec<f32>>()
                };
                let values: Vec<f32> = self.detections.iter().flat_map(row).collect();
                return Ok(npy::write(path, &values, &[self.detections.len(), FIELDS.len() + 1])?);
            }
        };
        let mut bytes = header.into_bytes();
        for one in &self.detections {
            numbers(one).iter().for_each(|v| bytes.extend(v.to_le_bytes()));
            bytes.push(one.class as u8);
        }
        write_atomically(path, |out| Ok(out.write_all(&bytes)?))?;
        Ok(())
    }

    fn ply_header(&self) -> String {
        let floats: String = FIELDS.iter().map(|name| format!("property float {name}\n")).collect();
        format!(
            "ply\nformat binary_little_endian 1.0\ncomment {}, {} s, metres, radians, m/s, dBsm, dB; class 0 surface, 1 rain, 2 noise\n\
             element vertex {}\n{floats}property uchar class\nend_header\n",
            self.name.replace('\n', " "),
            self.time[0],
            self.detections.len()
        )
    }

    fn pcd_header(&self) -> String {
        let count = self.detections.len();
        let each = |what: &str| format!("{what} ").repeat(FIELDS.len());
        format!(
            "# .PCD v0.7 - Point Cloud Data file format\n# {}, {} s\nVERSION 0.7\nFIELDS {} class\nSIZE {}1\nTYPE {}U\nCOUNT {}1\n\
             WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n",
            self.name.replace('\n', " "),
            self.time[0],
            FIELDS.join(" "),
            each("4"),
            each("F"),
            each("1"),
        )
    }
}
