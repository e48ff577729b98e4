//! Topics of a bag, and the instants of its transforms.

use super::cdr::{self, MessageType};
use crate::{ClipInfo, ReadingInfo, RigidPose, SensorInfoKind, SetInfo};

/// Frames that no sensor may be named after.
pub(super) const FRAMES: [&str; 2] = ["map", "base_link"];

/// The name of the file of a block.
pub(super) fn file_name(clip: &ClipInfo, block: u32) -> String {
    format!("{}_{block}.mcap", clip.name)
}

/// The frame of a sensor.
pub(super) fn frame(set: &SetInfo, sensor: usize) -> String {
    set.sensors[sensor].name.replace('-', "_")
}

/// A topic of a bag.
pub(super) struct Topic {
    /// The name.
    pub(super) name: String,
    /// The messages.
    pub(super) kind: MessageType,
    /// True if players must keep its last message for those who come late.
    pub(super) is_kept: bool,
    /// The sensor of its readings.
    pub(super) sensor: Option<usize>,
}

impl Topic {
    /// The quality of service as rosbag2 keeps it: empty for the usual one.
    pub(super) fn quality(&self) -> &'static str {
        if self.is_kept { LATCHED } else { "" }
    }
}

/// Reliable, transient local, the last message: what `tf2_ros` asks of `/tf_static`.
const LATCHED: &str = "- history: 1\n  depth: 1\n  reliability: 1\n  durability: 1\n  deadline:\n    sec: 9223372036\n    \
                       nsec: 854775807\n  lifespan:\n    sec: 9223372036\n    nsec: 854775807\n  liveliness: 1\n  \
                       liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n  \
                       avoid_ros_namespace_conventions: false";

/// Places of the topics that no sensor has.
pub(super) const TF_STATIC_TOPIC: usize = 0;
pub(super) const TF_TOPIC: usize = 1;

/// All topics, grouped by sensor.
pub(super) fn topics(set: &SetInfo) -> Vec<Topic> {
    let tf =
        |name: &str, is_kept: bool| Topic { name: name.into(), kind: cdr::TRANSFORMS, is_kept, sensor: None };
    let mut topics = vec![tf("/tf_static", true), tf("/tf", false)];
    for (sensor, info) in set.sensors.iter().enumerate() {
        let frame = frame(set, sensor);
        let mut add = |end: &str, kind: MessageType| {
            let name = format!("/sensors/{frame}/{end}");
            topics.push(Topic { name, kind, is_kept: false, sensor: Some(sensor) });
        };
        match info.kind {
            SensorInfoKind::Camera(_) => {
                add("image/compressed", cdr::PICTURE);
                add("camera_info", cdr::CAMERA);
            }
            SensorInfoKind::Lidar { .. } | SensorInfoKind::Radar { .. } => add("points", cdr::POINTS),
            SensorInfoKind::Other { .. } => {}
        }
    }
    topics
}

/// The instants of readings in order, each once: one message of `/tf` each.
pub(super) fn instants<'a>(
    clip: &'a ClipInfo,
    readings: &'a [ReadingInfo],
) -> impl Iterator<Item = (i64, RigidPose)> {
    readings.chunk_by(|a, b| a.timestamp(clip) == b.timestamp(clip)).map(|same| {
        let first = &same[0];
        (first.timestamp(clip), first.world_from_rig)
    })
}
