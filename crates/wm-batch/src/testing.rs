//! A small synthetic set: a car with three cameras, a lidar and a radar that drives a curve, twice.

use crate::{
    BlockInfo, CameraInfo, ClipInfo, ClipRecord, Condition, DatasetDetection, DatasetPoint, FileSink,
    LAYOUTS, Layout, PictureReading, PlaceInfo, PointSource, ReadingData, ReadingInfo, RigidPose, SensorInfo,
    SensorInfoKind, SensorReading, SetError, SetInfo, WeatherInfo,
};
use glam::{DMat3, DQuat, DVec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Width and height of its pictures, px.
const SIZE: (u32, u32) = (64, 40);
/// Frames of each clip.
pub const FRAMES_PER_CLIP: u32 = 20;
const FRAMES_PER_BLOCK: u32 = 8;

/// Files in memory, by path.
#[derive(Debug, Default)]
pub struct MemorySink(pub BTreeMap<String, Vec<u8>>);

impl FileSink for MemorySink {
    fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError> {
        assert!(self.0.insert(path.into(), bytes.to_vec()).is_none(), "{path} is written twice");
        Ok(())
    }
}

/// Files in a folder.
#[derive(Debug)]
pub struct FolderSink(pub PathBuf);

impl FileSink for FolderSink {
    fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError> {
        let path = self.0.join(path);
        let fault =
            |error: std::io::Error| SetError::Write { path: path.clone(), problem: error.to_string() };
        std::fs::create_dir_all(path.parent().expect("a folder")).map_err(fault)?;
        std::fs::write(&path, bytes).map_err(fault)
    }
}

/// The set. Frames and all sensors have 10 Hz; cameras look ahead, left and right.
#[must_use]
pub fn set() -> SetInfo {
    let camera = |name: &str, yaw: f64, position: [f64; 3]| {
        let optical = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
        SensorInfo {
            name: name.into(),
            rig_from_sensor: RigidPose::new(
                DMat3::from_rotation_z(yaw.to_radians()) * optical,
                DVec3::from_array(position),
            ),
            rate: 10.0,
            kind: SensorInfoKind::Camera(CameraInfo {
                size: SIZE,
                focal: [40.0, 41.0],
                center: [32.5, 19.75],
                lens: None,
            }),
        }
    };
    let turned = DQuat::from_rotation_z(0.05) * DQuat::from_rotation_y(-0.02);
    SetInfo {
        name: "synthetic".into(),
        about: "A synthetic set".into(),
        program: "weather-magician 0.1.0".into(),
        sensors: vec![
            camera("front", 0.0, [1.5, 0.1, 1.4]),
            camera("left", 60.0, [1.4, 0.5, 1.4]),
            camera("right", -60.0, [1.4, -0.5, 1.4]),
            SensorInfo {
                name: "top".into(),
                rig_from_sensor: RigidPose { rotation: turned, translation: DVec3::new(0.9, 0.0, 1.9) },
                rate: 10.0,
                kind: SensorInfoKind::Lidar { model: "vlp-16".into(), rings: 16 },
            },
            SensorInfo {
                name: "bumper".into(),
                rig_from_sensor: RigidPose {
                    rotation: DQuat::IDENTITY,
                    translation: DVec3::new(3.4, 0.0, 0.5),
                },
                rate: 10.0,
                kind: SensorInfoKind::Radar { model: "ars-408".into() },
            },
        ],
        frame_rate: 10.0,
        labels: vec!["road".into(), "building".into()],
    }
}

/// The clips: rain by day and snow by night.
#[must_use]
pub fn clips() -> [ClipInfo; 2] {
    [("rain", Condition::Rain, false), ("snow", Condition::Snow, true)].map(|(name, condition, is_night)| {
        let number = u64::from(is_night);
        ClipInfo {
            number,
            name: format!("{number:06}-bend-{name}"),
            split: if is_night { "val".into() } else { "train".into() },
            start: 1_700_000_000_000_000_000 + number as i64 * 60_000_000_000,
            seconds: f64::from(FRAMES_PER_CLIP) / 10.0,
            place: PlaceInfo { name: "bend".into(), origin: Some([55.7, 13.2, 20.0]), is_north_known: true },
            weather: WeatherInfo {
                name: name.into(),
                condition,
                mor: 900.0,
                rain_rate: if is_night { 0.0 } else { 25.0 },
                snow_rate: if is_night { 1.5 } else { 0.0 },
                is_night,
                file: format!("name = \"{name}\"\n"),
            },
        }
    })
}

/// The readings of a clip, in order.
#[must_use]
pub fn readings(set: &SetInfo) -> Vec<ReadingInfo> {
    let pose = |time: f64| RigidPose {
        rotation: DQuat::from_rotation_z(0.3 * time) * DQuat::from_rotation_x(0.01),
        translation: DVec3::new(10.0 + 8.0 * time, -4.0 + time * time, 0.2 * time),
    };
    let of = |frame: u32| {
        (0..set.sensors.len()).map(move |sensor| {
            let time = f64::from(frame) / 10.0;
            let (index, block) = (frame, frame / FRAMES_PER_BLOCK);
            ReadingInfo { sensor, index, frame, is_key: true, block, time, world_from_rig: pose(time) }
        })
    };
    (0..FRAMES_PER_CLIP).flat_map(of).collect()
}

/// A point of the world that all lidars hit and pictures show as a red spot, m.
pub(crate) const SPOT: DVec3 = DVec3::new(30.0, 2.0, 1.0);

/// The layout of a name.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn layout(name: &str) -> &'static Layout {
    LAYOUTS.iter().find(|layout| layout.name == name).expect("a layout of this name")
}

/// Writes the set in a layout, eight frames per block.
///
/// # Errors
/// [`SetError`] of the layout.
pub fn write(layout: &Layout, files: &mut dyn FileSink) -> Result<(), SetError> {
    write_in_blocks(layout, FRAMES_PER_BLOCK, files)
}

/// The files of the set in a layout, `frames` frames per block, by path.
#[cfg(test)]
pub(crate) fn written(layout: &Layout, frames: u32) -> BTreeMap<String, Vec<u8>> {
    let mut files = MemorySink::default();
    write_in_blocks(layout, frames, &mut files).expect("files in memory");
    files.0
}

/// Writes the set in a layout, `frames` frames per block.
///
/// # Errors
/// [`SetError`] of the layout.
pub(crate) fn write_in_blocks(
    layout: &Layout,
    frames: u32,
    files: &mut dyn FileSink,
) -> Result<(), SetError> {
    let set = set();
    (layout.check)(&set)?;
    let clips = clips();
    let all: Vec<ReadingInfo> =
        readings(&set).into_iter().map(|info| ReadingInfo { block: info.frame / frames, ..info }).collect();
    for clip in &clips {
        for own in all.chunk_by(|a, b| a.block == b.block) {
            let mut block =
                (layout.block)(BlockInfo { set: &set, clip, number: own[0].block, readings: own });
            for info in own {
                with_data(&set, *info, &mut |reading| block.write(reading, files))?;
            }
            block.finish(files)?;
        }
    }
    let mut records = clips.into_iter().map(|clip| Ok(ClipRecord { clip, readings: all.clone() }));
    (layout.tables)(&set, &mut records, files)
}

/// The set as numbers for scripts that read its files with other programs: sensors with
/// `rig_from_sensor` as 4x4 rows and intrinsics (the first pixel's centre is at 0.5, 0.5), clips,
/// readings with `timestamp` (ns) and `world_from_sensor`, and the spot with its pixel in the
/// pictures that show it and its position in the sensors' axes.
#[must_use]
pub fn truth(set: &SetInfo) -> Value {
    let sensors = set.sensors.iter().map(|sensor| {
        let mut value = json!({
            "name": sensor.name,
            "kind": sensor.kind.name(),
            "rate": sensor.rate,
            "rig_from_sensor": rows(&sensor.rig_from_sensor),
        });
        match &sensor.kind {
            SensorInfoKind::Camera(camera) => {
                value["size"] = json!([camera.size.0, camera.size.1]);
                value["focal"] = json!(camera.focal);
                value["center"] = json!(camera.center);
            }
            SensorInfoKind::Lidar { model, rings } => {
                value["model"] = json!(model);
                value["rings"] = json!(rings);
            }
            SensorInfoKind::Radar { model } => value["model"] = json!(model),
            SensorInfoKind::Other { .. } => {}
        }
        value
    });
    let clips = clips().into_iter().map(|clip| {
        let readings = readings(set).into_iter().map(|info| {
            let mut value = json!({
                "sensor": set.sensors[info.sensor].name,
                "index": info.index,
                "frame": info.frame,
                "is_key": info.is_key,
                "timestamp": info.timestamp(&clip),
                "world_from_rig": rows(&info.world_from_rig),
                "world_from_sensor": rows(&info.world_from_sensor(set)),
                "spot": spot_in(set, &info).to_array(),
            });
            if set.sensors[info.sensor].camera().is_some() {
                value["spot_pixel"] = json!(spot_pixel(set, &info));
            }
            value
        });
        json!({
            "number": clip.number,
            "name": clip.name,
            "split": clip.split,
            "start": clip.start,
            "seconds": clip.seconds,
            "origin": clip.place.origin,
            "condition": clip.weather.condition.name(),
            "readings": readings.collect::<Vec<_>>(),
        })
    });
    json!({
        "name": set.name,
        "frame_rate": set.frame_rate,
        "labels": set.labels,
        "sensors": sensors.collect::<Vec<_>>(),
        "clips": clips.collect::<Vec<_>>(),
        "spot": SPOT.to_array(),
        "points": 60,
        "detections": 4,
    })
}

/// The rows of a pose as a 4x4 matrix.
fn rows(pose: &RigidPose) -> [[f64; 4]; 4] {
    pose.matrix().transpose().to_cols_array_2d()
}

/// The pixel of a point in front of a camera, in the camera's axes.
#[must_use]
pub fn project(camera: &CameraInfo, point: DVec3) -> [f64; 2] {
    [0, 1].map(|k| camera.focal[k] * point[k] / point.z + camera.center[k])
}

/// The pixel of a point in the camera's axes; `None` if the picture does not show it.
#[must_use]
pub fn pixel(camera: &CameraInfo, point: DVec3) -> Option<[f64; 2]> {
    let [x, y] = project(camera, point);
    let (width, height) = (f64::from(camera.size.0), f64::from(camera.size.1));
    (point.z > 0.1 && x >= 0.0 && y >= 0.0 && x < width && y < height).then_some([x, y])
}

/// The spot in the axes of a reading's sensor.
pub(crate) fn spot_in(set: &SetInfo, info: &ReadingInfo) -> DVec3 {
    info.world_from_sensor(set).inverse().point(SPOT)
}

/// The pixel of the spot; `None` if the reading is no picture or does not show it.
pub(crate) fn spot_pixel(set: &SetInfo, info: &ReadingInfo) -> Option<[f64; 2]> {
    pixel(set.sensors[info.sensor].camera()?, spot_in(set, info))
}

/// Checks the pixels at which files place the spot; when it is dropped, that more than ten pictures
/// show the spot.
#[cfg(test)]
#[derive(Debug, Default)]
pub(crate) struct SpotCount(usize);

#[cfg(test)]
impl SpotCount {
    /// Compares a pixel that files give, counted from the corner of the first.
    ///
    /// # Panics
    /// If the picture shows the spot elsewhere.
    pub(crate) fn add(&mut self, set: &SetInfo, info: &ReadingInfo, found: [f64; 2]) {
        if let Some(truth) = spot_pixel(set, info) {
            let off = (found[0] - truth[0]).hypot(found[1] - truth[1]);
            assert!(off < 1e-6, "{found:?} is not {truth:?}");
            self.0 += 1;
        }
    }
}

#[cfg(test)]
impl Drop for SpotCount {
    fn drop(&mut self) {
        assert!(std::thread::panicking() || self.0 > 10, "{} pictures show the spot", self.0);
    }
}

/// Makes what a sensor reads.
fn with_data(
    set: &SetInfo,
    info: ReadingInfo,
    take: &mut dyn FnMut(&SensorReading<'_>) -> Result<(), SetError>,
) -> Result<(), SetError> {
    let spot = spot_in(set, &info);
    match &set.sensors[info.sensor].kind {
        SensorInfoKind::Camera(camera) => {
            let pixels = (SIZE.0 * SIZE.1) as usize;
            let mut rgb: Vec<u8> =
                (0..pixels * 3).map(|i| (60 + (i * 7 + info.index as usize) % 40) as u8).collect();
            let clean = rgb.clone();
            let depth: Vec<f32> = (0..pixels).map(|i| 5.0 + (i / SIZE.0 as usize) as f32).collect();
            let flow = vec![0.5f32; pixels * 2];
            let states = vec![0u8; pixels];
            if let Some([x, y]) = pixel(camera, spot) {
                let at = 3 * (y as usize * SIZE.0 as usize + x as usize);
                rgb[at..at + 3].copy_from_slice(&[255, 0, 0]);
            }
            let picture = PictureReading {
                rgb: &rgb,
                clean: Some(&clean),
                depth: Some(&depth),
                flow: Some(&flow),
                flow_states: Some(&states),
            };
            take(&SensorReading { info, data: ReadingData::Picture(picture) })
        }
        SensorInfoKind::Lidar { .. } => {
            let at = |k: u32, position: DVec3, source: PointSource| DatasetPoint {
                position: position.as_vec3().to_array(),
                range: position.length() as f32,
                intensity: (40 + k) as f32,
                time: k as f32 * 1e-4,
                angles: [position.y.atan2(position.x) as f32, (position.z / position.length()).asin() as f32],
                ring: (k % 16) as u16,
                rank: 0,
                source,
                label: (k % 3) as u16,
            };
            let mut points = vec![at(0, spot, PointSource::Surface)];
            for k in 1..60u32 {
                let angle = f64::from(k) * 0.1;
                let position =
                    DVec3::new(12.0 * angle.cos(), 12.0 * angle.sin(), -1.5 + 0.05 * f64::from(k % 16));
                let source = match k {
                    20 => PointSource::Rain,
                    40 => PointSource::Snow,
                    _ => PointSource::Surface,
                };
                points.push(at(k, position, source));
            }
            take(&SensorReading { info, data: ReadingData::Points(&points) })
        }
        SensorInfoKind::Radar { .. } => {
            let of = |k: u8| DatasetDetection {
                position: [20.0 + f32::from(k), f32::from(k) - 2.0, 0.0],
                velocity: -7.5,
                ground_velocity: 0.25,
                rcs: 5.0 + f32::from(k),
                snr: 14.0,
                is_rain: k == 3,
            };
            take(&SensorReading { info, data: ReadingData::Detections(&[of(0), of(1), of(2), of(3)]) })
        }
        SensorInfoKind::Other { .. } => Ok(()),
    }
}
