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
use crate::formats::{PointFormat, pcd_header, ply_header, write_records};
use std::path::Path;
use wm_base::npy;

/// Types and names of the numbers of a detection, in order.
const FIELDS: &str = "float x, float y, float z, float range, float azimuth, float elevation, \
                      float velocity, float ground_velocity, float rcs, float snr, uchar class";

fn numbers(one: &RadarDetection) -> [f32; 10] {
    let [x, y, z] = one.position;
    [x, y, z, one.range, one.azimuth, one.elevation, one.velocity, one.ground_velocity, one.rcs, one.snr]
}

impl RadarSweep {
    /// Writes the detections in the format of the name's extension, see
    /// [`PointFormat::of_detections`].
    ///
    /// # Errors
    /// [`SensorError`] if the format is unknown or the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), SensorError> {
        let (about, count) =
            (format!("{}, {} s", self.name.replace('\n', " "), self.time[0]), self.detections.len());
        let header = match PointFormat::of_detections(path)? {
            PointFormat::Ply => {
                let about = format!(
                    "comment {about}, metres, radians, m/s, dBsm, dB; class 0 surface, 1 rain, 2 noise\n"
                );
                ply_header(&about, FIELDS, count)
            }
            PointFormat::Pcd => pcd_header(&format!("# {about}\n"), FIELDS, count),
            // NPY: detections have no other.
            _ => {
                let row = |one: &RadarDetection| {
                    numbers(one).into_iter().chain([f32::from(one.class as u8)]).collect::<Vec<f32>>()
                };
                let values: Vec<f32> = self.detections.iter().flat_map(row).collect();
                return Ok(npy::write(path, &values, &[count, 11])?);
            }
        };
        write_records(path, &header, &self.detections, |one, out| {
            numbers(one).iter().for_each(|v| out.extend(v.to_le_bytes()));
            out.push(one.class as u8);
        })
    }
}
