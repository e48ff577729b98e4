//! Logs of ROS 2 as MCAP, which `ros2 bag play`, Foxglove, Rerun and Autoware open.
//!
//! `SPLIT/CLIP/` is a bag: a file `CLIP_N.mcap` for each block N and `metadata.yaml`. Files have
//! the profile `ros2`, definitions of messages (`ros2msg`) and messages in CDR; they are in chunks
//! of about 1 MiB, not compressed.
//!
//! | topic | type | |
//! |---|---|---|
//! | `/tf_static` | `tf2_msgs/msg/TFMessage` | `base_link` from each sensor, at the start of each file |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | `map` from `base_link`, at each instant at which a sensor reads |
//! | `/sensors/NAME/image/compressed` | `sensor_msgs/msg/CompressedImage` | JPEG |
//! | `/sensors/NAME/camera_info` | `sensor_msgs/msg/CameraInfo` | with each picture |
//! | `/sensors/NAME/points` | `sensor_msgs/msg/PointCloud2` | a lidar's sweep or a radar's detections |
//!
//! - `map` is the world, z up; `base_link` the rig, x forward, y left and z up; both in metres. A
//!   sensor's frame has its name. Frames of cameras are what ROS calls optical: x right, y down, z
//!   forward.
//! - The first pixel's centre is at (0, 0) as in OpenCV, so `cx` and `cy` in K and P are 0.5 less
//!   than ours. Lenses are `plumb_bob` (k1, k2, p1, p2, k3) or `equidistant` (k1 to k4).
//! - Points have the 32 bytes of Autoware's `PointXYZIRCAEDT`: x y z f32, intensity u8, return_type
//!   u8 (the return's number from 0), channel u16 (the ring), azimuth (from x towards y) and
//!   elevation f32 rad, distance f32 m, time_stamp u32 ns since the message's stamp, which is the
//!   start of the sweep.
//! - Detections have x y z f32 m, velocity f32 m/s (below 0 of what comes nearer), rcs f32 dB over
//!   1 m^2 and snr f32 dB.
//! - `-` in names of sensors becomes `_`, which is all that ROS allows.
//!
//! Source: mcap.dev/spec, the message definitions of ROS 2 Humble, version 5 of rosbag2's metadata.

mod cdr;
mod file;
mod metadata;
mod topics;

use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::cameras::{picture, refuse};
use crate::{BlockInfo, DatasetDetection, DatasetPoint, ReadingData, SensorReading, SetError};
use crate::{RigidPose, SetInfo, picture_files};
use cdr::{Field, FieldKind};
use file::McapFile;
use topics::{FRAMES, TF_STATIC_TOPIC, TF_TOPIC, file_name, frame, topics};
use wm_scene::LensModel;

const NAME: &str = "ros2-mcap";

/// Fields of a lidar's points.
const LIDAR_FIELDS: [Field; 10] = [
    ("x", FieldKind::F32),
    ("y", FieldKind::F32),
    ("z", FieldKind::F32),
    ("intensity", FieldKind::U8),
    ("return_type", FieldKind::U8),
    ("channel", FieldKind::U16),
    ("azimuth", FieldKind::F32),
    ("elevation", FieldKind::F32),
    ("distance", FieldKind::F32),
    ("time_stamp", FieldKind::U32),
];

/// Fields of a radar's detections.
const RADAR_FIELDS: [Field; 6] = [
    ("x", FieldKind::F32),
    ("y", FieldKind::F32),
    ("z", FieldKind::F32),
    ("velocity", FieldKind::F32),
    ("rcs", FieldKind::F32),
    ("snr", FieldKind::F32),
];

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "ROS 2 bags as MCAP: tf, JPEG with CameraInfo, PointCloud2 of lidars and radars",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| check(set).map_err(|problem| refuse(NAME, problem)),
    block: |block| Box::new(BagFile { block, file: None }),
    tables,
};

fn check(set: &SetInfo) -> Result<(), String> {
    if set.sensors.is_empty() {
        return Err("the rig has no sensor; add one".into());
    }
    for (index, sensor) in set.sensors.iter().enumerate() {
        let (name, frame) = (&sensor.name, frame(set, index));
        let begins = frame.starts_with(|c: char| c.is_ascii_alphabetic());
        if !begins || frame.contains("__") || frame.ends_with('_') {
            return Err(format!(
                "sensor \"{name}\" cannot be part of a topic; begin its name with a letter, without __ or an end in _"
            ));
        }
        if FRAMES.contains(&frame.as_str()) {
            return Err(format!("\"{name}\" is a frame of its own in ROS; rename the sensor"));
        }
        if (0..index).any(|other| topics::frame(set, other) == frame) {
            return Err(format!("two sensors are \"{frame}\" in ROS; rename sensor \"{name}\""));
        }
        if sensor.camera().is_some_and(|camera| camera.lens == Some(LensModel::Equirectangular)) {
            return Err(format!("CameraInfo has no equirectangular lens; change that of camera \"{name}\""));
        }
    }
    Ok(())
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    for record in clips {
        let record = record?;
        if !record.readings.is_empty() {
            let path = format!("{}/metadata.yaml", record.clip.folder());
            files.write(&path, metadata::of(set, &record).as_bytes())?;
        }
    }
    Ok(())
}

struct BagFile<'a> {
    block: BlockInfo<'a>,
    file: Option<OpenFile>,
}

impl BlockWriter for BagFile<'_> {
    fn write(&mut self, reading: &SensorReading<'_>, _files: &mut dyn FileSink) -> Result<(), SetError> {
        let BlockInfo { set, clip, .. } = self.block;
        let file = self.file.get_or_insert_with(|| OpenFile::new(&self.block));
        let (time, frame) = (reading.info.timestamp(clip), frame(set, reading.info.sensor));
        file.transform(time, reading.info.world_from_rig);
        let first = file.first_topic[reading.info.sensor];
        if let Some((sensor, camera, picture)) = picture(set, reading) {
            let jpeg = picture_files::jpeg(sensor, camera, picture.rgb)?;
            file.message(first, time, &cdr::picture(time, &frame, &jpeg));
            file.message(first + 1, time, &cdr::camera(time, &frame, camera));
        }
        match reading.data {
            ReadingData::Points(points) => {
                file.message(first, time, &cdr::points(time, &frame, &LIDAR_FIELDS, &point_bytes(points)));
            }
            ReadingData::Detections(found) => {
                file.message(first, time, &cdr::points(time, &frame, &RADAR_FIELDS, &detection_bytes(found)));
            }
            ReadingData::Picture(_) => {}
        }
        Ok(())
    }

    fn finish(self: Box<Self>, files: &mut dyn FileSink) -> Result<(), SetError> {
        let BlockInfo { clip, number, .. } = self.block;
        let Some(file) = self.file else { return Ok(()) };
        files.write(&format!("{}/{}", clip.folder(), file_name(clip, number)), &file.file.finish())
    }
}

/// A file that is being written.
struct OpenFile {
    file: McapFile,
    /// The channels, by topic.
    channels: Vec<u16>,
    /// The place of the first topic of each sensor.
    first_topic: Vec<usize>,
    /// The last time of `/tf`.
    time: Option<i64>,
}

impl OpenFile {
    /// Begins a file, with all topics and `/tf_static`.
    fn new(block: &BlockInfo<'_>) -> Self {
        let BlockInfo { set, clip, readings, .. } = *block;
        let mut file = McapFile::new("ros2", &set.program);
        let mut first_topic = vec![usize::MAX; set.sensors.len()];
        let mut schemas: Vec<(&str, u16)> = Vec::new();
        let mut channels = Vec::new();
        for (place, topic) in topics(set).iter().enumerate() {
            let name = topic.kind.name;
            let known = schemas.iter().find(|(known, _)| *known == name).map(|(_, schema)| *schema);
            let schema = known.unwrap_or_else(|| file.add_schema(name, "ros2msg", &topic.kind.schema()));
            schemas.push((name, schema));
            channels.push(file.add_channel(
                schema,
                &topic.name,
                "cdr",
                ("offered_qos_profiles", topic.quality()),
            ));
            if let Some(sensor) = topic.sensor {
                first_topic[sensor] = first_topic[sensor].min(place);
            }
        }
        let mut file = Self { file, channels, first_topic, time: None };
        let frames: Vec<String> = (0..set.sensors.len()).map(|sensor| frame(set, sensor)).collect();
        let poses: Vec<_> = frames
            .iter()
            .zip(&set.sensors)
            .map(|(frame, sensor)| (FRAMES[1], frame.as_str(), sensor.rig_from_sensor))
            .collect();
        if let Some(first) = readings.first() {
            let time = first.timestamp(clip);
            file.message(TF_STATIC_TOPIC, time, &cdr::transforms(time, &poses));
        }
        file
    }

    /// Writes `/tf` unless it has this instant.
    fn transform(&mut self, time: i64, world_from_rig: RigidPose) {
        if self.time.replace(time) != Some(time) {
            self.message(TF_TOPIC, time, &cdr::transforms(time, &[(FRAMES[0], FRAMES[1], world_from_rig)]));
        }
    }

    fn message(&mut self, topic: usize, time: i64, data: &[u8]) {
        self.file.message(self.channels[topic], u64::try_from(time).unwrap_or(0), data);
    }
}

/// A sweep in [`LIDAR_FIELDS`].
fn point_bytes(points: &[DatasetPoint]) -> Vec<u8> {
    let mut out = Vec::with_capacity(32 * points.len());
    for point in points {
        out.extend(point.position.into_iter().flat_map(f32::to_le_bytes));
        out.extend([point.intensity.round() as u8, point.rank]);
        out.extend(point.ring.to_le_bytes());
        out.extend([point.angles[0], point.angles[1], point.range].into_iter().flat_map(f32::to_le_bytes));
        out.extend(((f64::from(point.time) * 1e9).round() as u32).to_le_bytes());
    }
    out
}

/// Detections in [`RADAR_FIELDS`].
fn detection_bytes(detections: &[DatasetDetection]) -> Vec<u8> {
    let numbers = |found: &DatasetDetection| {
        let [x, y, z] = found.position;
        [x, y, z, found.velocity, found.rcs, found.snr]
    };
    detections.iter().flat_map(numbers).flat_map(f32::to_le_bytes).collect()
}

#[cfg(test)]
mod tests;
