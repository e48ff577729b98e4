//! Poses and times of the frames of a clip.

use super::KittiRig;
use super::calibration::{numbers_text, pose_rows};
use crate::{ClipInfo, ClipRecord, ReadingInfo, RigidPose};
use std::fmt::Write;

/// The frames of a clip, each by the reading that stands for it.
pub(in super::super) struct KittiTrajectory {
    /// One reading per frame: that of the lidar, or of the first camera where there is no lidar.
    pub(super) frames: Vec<ReadingInfo>,
}

impl KittiTrajectory {
    pub(in super::super) fn new(rig: &KittiRig<'_>, record: &ClipRecord) -> Self {
        let sensor = rig.lidar.or_else(|| rig.cameras.first().copied());
        Self { frames: key_readings(record, sensor).copied().collect() }
    }

    /// The times of the frames, nanoseconds since 1970.
    pub(in super::super) fn times(&self, clip: &ClipInfo) -> impl Iterator<Item = i64> {
        self.frames.iter().map(|frame| frame.timestamp(clip))
    }

    /// Lines of `poses.txt`: the rows of `T_w_cam0`, 3x4; the world are the axes of camera 0 at the
    /// first frame.
    pub(in super::super) fn pose_lines(&self, rig: &KittiRig<'_>) -> String {
        let poses = self.frames.iter().map(|frame| frame.world_from_rig.then(&rig.rig_from_camera0));
        let first = poses.clone().next().map_or(RigidPose::IDENTITY, |pose| pose.inverse());
        poses.fold(String::new(), |mut text, pose| {
            let _ = writeln!(text, "{}", numbers_text(&pose_rows(&first.then(&pose))));
            text
        })
    }

    /// Lines of `times.txt`: seconds since the first frame.
    pub(in super::super) fn time_lines(&self) -> String {
        let first = self.frames.first().map_or(0.0, |frame| frame.time);
        self.frames.iter().fold(String::new(), |mut text, frame| {
            let _ = writeln!(text, "{:.9e}", frame.time - first);
            text
        })
    }
}

/// The times of a sensor's readings of frames, nanoseconds since 1970.
pub(in super::super) fn times(
    record: &ClipRecord,
    sensor: Option<usize>,
) -> impl Iterator<Item = i64> + Clone + '_ {
    key_readings(record, sensor).map(|info| info.timestamp(&record.clip))
}

fn key_readings(
    record: &ClipRecord,
    sensor: Option<usize>,
) -> impl Iterator<Item = &ReadingInfo> + Clone + '_ {
    record.readings.iter().filter(move |info| info.is_key && Some(info.sensor) == sensor)
}
