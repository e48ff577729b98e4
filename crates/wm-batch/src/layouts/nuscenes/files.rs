//! Files of readings.

use super::channels;
use super::names::{classes_path, is_key, reading_path, reading_token};
use crate::layouts::surface_classes::lidarseg_classes;
use crate::{
    BlockInfo, BlockWriter, DatasetDetection, DatasetPoint, FileSink, ReadingData, SensorInfoKind,
    SensorReading, picture_files,
};
use std::fmt::Write;

/// Class of points of the weather.
const NOISE_CLASS: u8 = 0;

/// Detections that move less are stationary.
const MAX_STATIONARY_SPEED_M_S: f32 = 1.0;

pub(super) fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    let (channels, classes) = (channels(set), lidarseg_classes(&set.labels));
    let class = move |point: &DatasetPoint| match point.source.is_weather() {
        true => NOISE_CLASS,
        false => classes.get(usize::from(point.label)).copied().unwrap_or(classes[0]),
    };
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let info = &reading.info;
        let sensor = &set.sensors[info.sensor];
        let path = reading_path(set, clip, &channels[info.sensor], info);
        match (&reading.data, &sensor.kind) {
            (ReadingData::Picture(picture), SensorInfoKind::Camera(camera)) => {
                files.write(&path, &picture_files::jpeg(sensor, camera, picture.rgb)?)
            }
            (ReadingData::Points(points), SensorInfoKind::Lidar { rings, .. }) => {
                files.write(&path, &lidar(points, *rings))?;
                if is_key(set, info) {
                    let classes: Vec<u8> = points.iter().map(&class).collect();
                    let token = reading_token(set, clip, info.sensor, info.index);
                    files.write(&classes_path(set, &token), &classes)?;
                }
                Ok(())
            }
            (ReadingData::Detections(detections), SensorInfoKind::Radar { .. }) => {
                files.write(&path, &radar(detections))
            }
            _ => Ok(()),
        }
    })
}

/// `[N, 5]`, f32: x right, y forward, z up, m, intensity 0-255 and ring, the lowest is 0.
fn lidar(points: &[DatasetPoint], rings: u16) -> Vec<u8> {
    let numbers = points.iter().flat_map(|point| {
        let [x, y, z] = point.position;
        [-y, x, z, point.intensity, f32::from(rings.saturating_sub(1).saturating_sub(point.ring))]
    });
    numbers.flat_map(f32::to_le_bytes).collect()
}

/// A PCD file with nuScenes' eighteen fields, 43 bytes a record.
pub(super) fn radar(detections: &[DatasetDetection]) -> Vec<u8> {
    let count = detections.len().max(1);
    let mut header = String::from("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n");
    header += "FIELDS x y z dyn_prop id rcs vx vy vx_comp vy_comp is_quality_valid ambig_state x_rms y_rms invalid_state pdh0 vx_rms vy_rms\n";
    header += "SIZE 4 4 4 1 2 4 4 4 4 4 1 1 1 1 1 1 1 1\nTYPE F F F I I F F F F F I I I I I I I I\n";
    header += "COUNT 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1 1\n";
    // Writing to a string cannot fail.
    let _ = write!(header, "WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n");
    let mut bytes = header.into_bytes();
    let nothing = DatasetDetection {
        position: [f32::NAN; 3],
        velocity: f32::NAN,
        ground_velocity: f32::NAN,
        rcs: f32::NAN,
        snr: f32::NAN,
        is_rain: false,
    };
    let records = if detections.is_empty() { std::slice::from_ref(&nothing) } else { detections };
    for (id, detection) in records.iter().enumerate() {
        let [x, y, z] = detection.position;
        let range = x.hypot(y).max(f32::MIN_POSITIVE);
        let along = |speed: f32| [speed * x / range, speed * y / range];
        let ([vx, vy], [vx_comp, vy_comp]) = (along(detection.velocity), along(detection.ground_velocity));
        let dyn_prop = u8::from(detection.ground_velocity.abs() < MAX_STATIONARY_SPEED_M_S);
        bytes.extend([x, y, z].into_iter().flat_map(f32::to_le_bytes));
        bytes.push(dyn_prop);
        bytes.extend((id as i16).to_le_bytes());
        bytes.extend([detection.rcs, vx, vy, vx_comp, vy_comp].into_iter().flat_map(f32::to_le_bytes));
        // A valid measurement, its velocity not ambiguous (3), errors unknown, state valid (0),
        // false alarm below 25 % (1), errors unknown.
        bytes.extend([1, 3, 0, 0, 0, 1, 0, 0]);
    }
    // nuScenes' own files have one byte more, and the devkit asserts that there is one.
    bytes.push(b'\n');
    bytes
}
