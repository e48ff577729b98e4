//! Names of records: tokens, times and paths.

use crate::{ClipInfo, ReadingInfo, SensorInfoKind, SetInfo};
use sha2::{Digest, Sha256};

/// Samples a second.
const SAMPLE_RATE: f64 = 2.0;

/// Frames from a sample to the next, at least 1.
pub(super) fn key_interval(set: &SetInfo) -> u32 {
    ((set.frame_rate / SAMPLE_RATE).round() as u32).max(1)
}

/// Returns true for readings of samples.
pub(super) fn is_key(set: &SetInfo, info: &ReadingInfo) -> bool {
    info.is_key && info.frame.is_multiple_of(key_interval(set))
}

/// The folder of the tables.
pub(super) fn version(set: &SetInfo) -> String {
    format!("v1.0-{}", set.name)
}

/// The token of a record.
pub(super) fn token(set: &SetInfo, parts: &[&str]) -> String {
    let hash = Sha256::digest(format!("{}/{}", set.name, parts.join("/")));
    hash.iter().take(16).map(|byte| format!("{byte:02x}")).collect()
}

/// The token of a reading, and of its pose.
pub(super) fn reading_token(set: &SetInfo, clip: &ClipInfo, sensor: usize, index: u32) -> String {
    token(set, &["sample_data", &clip.name, &set.sensors[sensor].name, &index.to_string()])
}

/// Microseconds since 1970.
pub(super) fn microseconds(clip: &ClipInfo, info: &ReadingInfo) -> i64 {
    info.timestamp(clip).div_euclid(1000)
}

/// The path of a reading.
pub(super) fn reading_path(set: &SetInfo, clip: &ClipInfo, channel: &str, info: &ReadingInfo) -> String {
    let folder = if is_key(set, info) { "samples" } else { "sweeps" };
    let extension = match set.sensors[info.sensor].kind {
        SensorInfoKind::Camera(_) => "jpg",
        SensorInfoKind::Lidar { .. } => "pcd.bin",
        SensorInfoKind::Radar { .. } => "pcd",
        SensorInfoKind::Other { .. } => "bin",
    };
    format!("{folder}/{channel}/{}__{channel}__{}.{extension}", clip.name, microseconds(clip, info))
}

/// The path of the classes of a key sweep's points.
pub(super) fn classes_path(set: &SetInfo, token: &str) -> String {
    format!("lidarseg/{}/{token}_lidarseg.bin", version(set))
}
