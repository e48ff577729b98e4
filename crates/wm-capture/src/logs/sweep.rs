//! Sweeps of lidars.

use super::argoverse::table::read_points;
use super::files::{MAX_BINARY_BYTES, fault, read_bytes};
use super::track::EgoTrack;
use crate::RigidPose;
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wm_base::FormatError;

/// Farthest that a point may be from its lidar, m.
const MAX_RANGE_M: f64 = 1000.0;

/// The classes of SemanticKITTI that move: car, bicyclist, person, motorcyclist, on rails, bus,
/// truck, other vehicle.
const MOVING_CLASSES: std::ops::RangeInclusive<u16> = 252..=259;

/// A sweep of a lidar, in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LogSweep {
    /// The file.
    pub file: PathBuf,
    /// Nanoseconds.
    pub timestamp: i64,
    /// The lidar's place then, world axes, m.
    pub center: DVec3,
    /// Labels of SemanticKITTI, one a point.
    pub(super) labels: Option<PathBuf>,
    pub(super) records: SweepRecords,
    pub(super) motion: SweepMotion,
}

/// A point of a lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogPoint {
    /// World axes, m.
    pub position: DVec3,
    /// m from the lidar.
    pub range: f64,
    /// Intensity, 0-1 as far as the log keeps to it.
    pub intensity: f32,
    /// Nanoseconds.
    pub timestamp: i64,
    /// True if the log labels it as a part of something that moves.
    pub moves: bool,
}

/// The layout of a sweep's file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SweepRecords {
    /// Records of 32-bit floats.
    Floats {
        /// Floats a record.
        columns: usize,
        /// The first of x, y and z.
        position: usize,
        /// The intensity.
        intensity: Option<usize>,
        /// The intensity that is 1.
        white: f32,
    },
    /// Argoverse 2's Feather.
    Feather,
}

/// The motion of the axes that the points are in.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SweepMotion {
    /// All points are in the axes of one time.
    Still(RigidPose),
    /// The lidar turns counterclockwise and begins and ends behind it; each point is in the axes of
    /// its own time.
    Turning {
        /// The vehicle's poses.
        track: Arc<EgoTrack>,
        /// `rig_from_lidar`.
        rig_from_lidar: RigidPose,
        /// Nanoseconds, at azimuths of -180 and 180 degrees.
        span: (i64, i64),
    },
}

/// The points of a sweep, and the number of those that cannot be used: not finite, or farther than
/// a kilometre from the lidar.
pub(super) struct SweepPoints {
    pub(crate) points: Vec<LogPoint>,
    pub(crate) unusable: usize,
}

impl SweepRecords {
    /// Records of KITTI: x y z and intensity as floats.
    pub(super) const KITTI: Self = Self::Floats { columns: 4, position: 0, intensity: Some(3), white: 1.0 };
}

impl LogSweep {
    /// A sweep whose points are all in the axes of the lidar, or of the vehicle, at one time.
    pub(super) fn still(
        file: PathBuf,
        timestamp: i64,
        world_from_own: RigidPose,
        records: SweepRecords,
    ) -> Self {
        let (center, motion) = (world_from_own.translation, SweepMotion::Still(world_from_own));
        Self { file, timestamp, center, labels: None, records, motion }
    }

    /// Reads the points. Those that are not finite, at the lidar itself or farther than a kilometre
    /// from it are left out.
    ///
    /// # Errors
    /// The file is missing or damaged.
    pub fn points(&self) -> Result<Vec<LogPoint>, FormatError> {
        self.read().map(|sweep| sweep.points)
    }

    pub(super) fn read(&self) -> Result<SweepPoints, FormatError> {
        let raw = self.raw()?;
        let mut unusable = 0;
        let labels = self.labels.as_ref().map(|file| read_labels(file, raw.len())).transpose()?;
        let mut points = Vec::with_capacity(raw.len());
        for (index, ([x, y, z], intensity)) in raw.into_iter().enumerate() {
            let own = DVec3::new(x.into(), y.into(), z.into());
            let (position, timestamp) = match &self.motion {
                SweepMotion::Still(world_from_own) => (world_from_own.point(own), self.timestamp),
                SweepMotion::Turning { track, rig_from_lidar, span } => {
                    let share = (own.y.atan2(own.x) + PI) / TAU;
                    let time = span.0.saturating_add((share * span.1.abs_diff(span.0) as f64) as i64);
                    let Some(world_from_rig) = track.at(time) else { continue };
                    (world_from_rig.point(rig_from_lidar.point(own)), time)
                }
            };
            let range = position.distance(self.center);
            // Written so that NaN is not near.
            let is_near = range < MAX_RANGE_M;
            unusable += usize::from(!is_near);
            // What did not come back is at the lidar itself in some logs.
            if is_near && own.length_squared() > 1e-4 {
                let intensity = if intensity.is_finite() { intensity.max(0.0) } else { 0.0 };
                let moves = labels.as_ref().is_some_and(|labels| MOVING_CLASSES.contains(&labels[index]));
                points.push(LogPoint { position, range, intensity, timestamp, moves });
            }
        }
        Ok(SweepPoints { points, unusable })
    }

    /// Positions in the file's axes, and intensities.
    fn raw(&self) -> Result<Vec<([f32; 3], f32)>, FormatError> {
        let bytes = read_bytes(&self.file, MAX_BINARY_BYTES)?;
        match self.records {
            SweepRecords::Floats { columns, position, intensity, white } => {
                let size = 4 * columns;
                if bytes.len() % size != 0 {
                    let length = bytes.len();
                    return Err(fault(
                        &self.file,
                        format!(
                            "{length} bytes are no whole number of points of {size} bytes; copy the file again"
                        ),
                    ));
                }
                let record = |record: &[u8]| {
                    let (values, _) = record.as_chunks::<4>();
                    let at = |column: usize| f32::from_le_bytes(values[column]);
                    let intensity = intensity.map_or(0.0, |column| at(column) / white);
                    ([at(position), at(position + 1), at(position + 2)], intensity)
                };
                Ok(bytes.chunks_exact(size).map(record).collect())
            }
            SweepRecords::Feather => read_points(&self.file, &bytes),
        }
    }
}

/// The classes of as many points, the lower half of each label.
fn read_labels(file: &Path, points: usize) -> Result<Vec<u16>, FormatError> {
    let bytes = read_bytes(file, MAX_BINARY_BYTES)?;
    let (labels, rest) = bytes.as_chunks::<4>();
    if labels.len() != points || !rest.is_empty() {
        let length = bytes.len();
        return Err(fault(
            file,
            format!("{length} bytes are not the labels of {points} points; copy the file again"),
        ));
    }
    Ok(labels.iter().map(|[low, high, ..]| u16::from_le_bytes([*low, *high])).collect())
}
