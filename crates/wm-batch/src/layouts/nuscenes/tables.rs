//! The tables, row by row.

use super::channels;
use super::names::{classes_path, is_key, microseconds, reading_path, reading_token, token, version};
use crate::layouts::surface_classes::LIDARSEG_NAMES;
use crate::{
    CameraInfo, ClipInfo, ClipRecord, ClipStream, FileSink, ReadingInfo, RigidPose, SensorInfo, SetError,
    SetInfo, WeatherInfo, utc,
};
use glam::DQuat;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A table as text; rows are written as they come.
struct Table {
    name: &'static str,
    text: Vec<u8>,
}

impl Table {
    fn new(name: &'static str) -> Self {
        Self { name, text: vec![b'['] }
    }

    fn push(&mut self, row: &Value) {
        self.text.extend_from_slice(if self.text.len() > 1 { b",\n" } else { b"\n" });
        self.text.extend_from_slice(row.to_string().as_bytes());
    }

    fn write(mut self, set: &SetInfo, files: &mut dyn FileSink) -> Result<(), SetError> {
        self.text.extend_from_slice(b"\n]\n");
        files.write(&format!("{}/{}.json", version(set), self.name), &self.text)
    }
}

/// Writes all tables, the map's picture and the splits.
pub(super) fn write(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    let channels = channels(set);
    let mut clip_tables = ClipTables::new(set, &channels);
    let mut splits: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut logs = Vec::new();
    for record in clips {
        let record = record?;
        let clip = &record.clip;
        clip_tables.add(&record);
        logs.push(token(set, &["log", &clip.name]));
        for split in [clip.split.clone(), format!("{}_{}", set.name, clip.split)] {
            splits.entry(split).or_default().push(clip.name.clone());
        }
    }
    clip_tables.write(files)?;
    let [sensors, calibrations] = sensor_tables(set, &channels);
    sensors.write(set, files)?;
    calibrations.write(set, files)?;
    let mut categories = Table::new("category");
    for (index, name) in LIDARSEG_NAMES.iter().enumerate() {
        categories.push(&json!({
            "token": token(set, &["category", name]), "name": name, "description": "", "index": index,
        }));
    }
    categories.write(set, files)?;
    for name in ["attribute", "visibility", "instance", "sample_annotation"] {
        Table::new(name).write(set, files)?;
    }
    let map_token = token(set, &["map"]);
    let map_path = format!("maps/{map_token}.png");
    let mut maps = Table::new("map");
    maps.push(&json!({
        "token": map_token, "log_tokens": logs, "category": "semantic_prior", "filename": map_path,
    }));
    maps.write(set, files)?;
    // The devkit opens the map's picture; one black pixel is nothing known.
    let pixel = wm_image::png::encode_rgb8(&[0; 3], wm_image::PictureSize::new(1, 1)).map_err(|error| {
        SetError::Layout { layout: "nuscenes", problem: format!("the map cannot be written: {error}") }
    })?;
    files.write(&map_path, &pixel)?;
    let splits = serde_json::to_string_pretty(&splits).unwrap_or_default();
    files.write(&format!("{}/splits.json", version(set)), splits.as_bytes())
}

/// Tables that have rows of each clip.
struct ClipTables<'a> {
    set: &'a SetInfo,
    channels: &'a [String],
    logs: Table,
    scenes: Table,
    samples: Table,
    sample_data: Table,
    ego_poses: Table,
    lidarseg: Option<Table>,
}

impl<'a> ClipTables<'a> {
    fn new(set: &'a SetInfo, channels: &'a [String]) -> Self {
        let has_lidar = set.sensors.iter().any(SensorInfo::is_lidar);
        Self {
            set,
            channels,
            logs: Table::new("log"),
            scenes: Table::new("scene"),
            samples: Table::new("sample"),
            sample_data: Table::new("sample_data"),
            ego_poses: Table::new("ego_pose"),
            lidarseg: has_lidar.then(|| Table::new("lidarseg")),
        }
    }

    fn write(self, files: &mut dyn FileSink) -> Result<(), SetError> {
        let tables = [self.logs, self.scenes, self.samples, self.sample_data, self.ego_poses];
        tables.into_iter().chain(self.lidarseg).try_for_each(|table| table.write(self.set, files))
    }

    fn add(&mut self, record: &ClipRecord) {
        let (set, clip) = (self.set, &record.clip);
        let samples = samples(set, record);
        let sample_token = |index: usize| {
            samples.get(index).map_or_else(String::new, |sample| {
                token(set, &["sample", &clip.name, &sample.frame.to_string()])
            })
        };
        let [log, scene] = ["log", "scene"].map(|table| token(set, &[table, &clip.name]));
        self.logs.push(&json!({
            "token": log, "logfile": clip.name, "vehicle": set.name,
            "date_captured": utc::date(clip.start, '-'), "location": clip.place.name,
        }));
        self.scenes.push(&json!({
            "token": scene, "log_token": log, "nbr_samples": samples.len(),
            "first_sample_token": sample_token(0),
            "last_sample_token": sample_token(samples.len().saturating_sub(1)),
            "name": clip.name, "description": description(&clip.weather),
        }));
        for (index, sample) in samples.iter().enumerate() {
            let before = index.checked_sub(1).map_or_else(String::new, sample_token);
            self.samples.push(&json!({
                "token": sample_token(index), "timestamp": sample.timestamp,
                "prev": before, "next": sample_token(index + 1), "scene_token": scene,
            }));
        }
        let mut counts = vec![0u32; set.sensors.len()];
        for info in &record.readings {
            counts[info.sensor] = counts[info.sensor].max(info.index + 1);
        }
        for info in &record.readings {
            // Of the sample that it is a key reading of, else of the next in time.
            let place = if is_key(set, info) {
                samples.partition_point(|sample| sample.frame < info.frame)
            } else {
                samples.partition_point(|sample| sample.timestamp < microseconds(clip, info))
            };
            let sample = sample_token(place.min(samples.len().saturating_sub(1)));
            self.add_reading(clip, info, &sample, counts[info.sensor]);
        }
    }

    fn add_reading(&mut self, clip: &ClipInfo, info: &ReadingInfo, sample: &str, count: u32) {
        let set = self.set;
        let token_of = |index: u32| reading_token(set, clip, info.sensor, index);
        let (own, timestamp) = (token_of(info.index), microseconds(clip, info));
        let camera = set.sensors[info.sensor].camera();
        let size = camera.map_or((0, 0), |camera| camera.size);
        let mut pose = pose_row(&info.world_from_rig);
        pose["token"] = json!(own);
        pose["timestamp"] = json!(timestamp);
        self.ego_poses.push(&pose);
        self.sample_data.push(&json!({
            "token": own, "sample_token": sample, "ego_pose_token": own,
            "calibrated_sensor_token": calibration_token(set, info.sensor), "timestamp": timestamp,
            "fileformat": if camera.is_some() { "jpg" } else { "pcd" }, "is_key_frame": is_key(set, info),
            "height": size.1, "width": size.0,
            "filename": reading_path(set, clip, &self.channels[info.sensor], info),
            "prev": info.index.checked_sub(1).map_or_else(String::new, token_of),
            "next": if info.index + 1 < count { token_of(info.index + 1) } else { String::new() },
        }));
        if let Some(lidarseg) = &mut self.lidarseg
            && is_key(set, info)
            && set.sensors[info.sensor].is_lidar()
        {
            lidarseg.push(&json!({
                "token": own, "sample_data_token": own, "filename": classes_path(set, &own),
            }));
        }
    }
}

/// A sample of a clip.
struct Sample {
    frame: u32,
    /// Microseconds.
    timestamp: i64,
}

/// The samples of a clip; the time of each is that of its lidar, or of its first sensor where there
/// is none.
fn samples(set: &SetInfo, record: &ClipRecord) -> Vec<Sample> {
    let mut samples: BTreeMap<u32, (bool, i64)> = BTreeMap::new();
    for info in record.readings.iter().filter(|info| is_key(set, info)) {
        let found = (set.sensors[info.sensor].is_lidar(), microseconds(&record.clip, info));
        let sample = samples.entry(info.frame).or_insert(found);
        if found.0 && !sample.0 {
            *sample = found;
        }
    }
    samples.into_iter().map(|(frame, (_, timestamp))| Sample { frame, timestamp }).collect()
}

fn sensor_tables(set: &SetInfo, channels: &[String]) -> [Table; 2] {
    let (mut sensors, mut calibrations) = (Table::new("sensor"), Table::new("calibrated_sensor"));
    for (index, (sensor, channel)) in set.sensors.iter().zip(channels).enumerate() {
        let own = token(set, &["sensor", &sensor.name]);
        // From nuScenes' axes of a lidar, x right and y forward, to x forward and y left.
        let quarter_turn = DQuat::from_rotation_z(-std::f64::consts::FRAC_PI_2);
        let pose = sensor.rig_from_sensor;
        let rotation = if sensor.is_lidar() { pose.rotation * quarter_turn } else { pose.rotation };
        sensors.push(&json!({ "token": own, "channel": channel, "modality": sensor.kind.name() }));
        let mut row = pose_row(&RigidPose { rotation, ..pose });
        row["token"] = json!(calibration_token(set, index));
        row["sensor_token"] = json!(own);
        row["camera_intrinsic"] = sensor.camera().map_or(json!([]), intrinsics);
        calibrations.push(&row);
    }
    [sensors, calibrations]
}

fn calibration_token(set: &SetInfo, sensor: usize) -> String {
    token(set, &["calibrated_sensor", &set.sensors[sensor].name])
}

fn intrinsics(camera: &CameraInfo) -> Value {
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.center);
    json!([[fx, 0.0, cx - 0.5], [0.0, fy, cy - 0.5], [0.0, 0.0, 1.0]])
}

fn pose_row(pose: &RigidPose) -> Value {
    let q = pose.rotation.normalize();
    json!({ "translation": pose.translation.to_array(), "rotation": [q.w, q.x, q.y, q.z] })
}

/// The weather in words. Names of places and weathers stay out, so that nobody finds "rain" in
/// "train".
pub(super) fn description(weather: &WeatherInfo) -> String {
    let mut words = Vec::new();
    if weather.rain_rate > 0.0 {
        words.push(format!("rain {} mm/h", rounded(weather.rain_rate)));
    }
    if weather.snow_rate > 0.0 {
        words.push(format!("snow {} mm/h", rounded(weather.snow_rate)));
    }
    let condition = weather.condition.name();
    if !words.iter().any(|word| word.starts_with(condition)) && condition != "night" {
        words.insert(0, condition.into());
    }
    if weather.mor.is_finite() {
        words.push(format!("visibility {} m", rounded(weather.mor)));
    }
    words.push(if weather.is_night { "night" } else { "day" }.into());
    words.join(", ")
}

/// Three digits of a number.
fn rounded(value: f64) -> f64 {
    let step = 10f64.powf(value.abs().max(1e-9).log10().floor() - 2.0);
    // Through text, so that 1.4000000000000001 is not shown.
    format!("{:.*}", usize::from(step < 1.0) * 9, (value / step).round() * step).parse().unwrap_or(value)
}
