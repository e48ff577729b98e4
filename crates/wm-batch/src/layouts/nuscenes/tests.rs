//! The synthetic set, read back by code that knows the files alone.

use super::*;
use crate::testing::{self, SPOT};
use crate::{Condition, RigidPose};
use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, HashMap, HashSet};

fn written(frames: u32) -> BTreeMap<String, Vec<u8>> {
    testing::written(&LAYOUT, frames)
}

type Rows = Vec<Value>;

fn rows(files: &BTreeMap<String, Vec<u8>>, table: &str) -> Rows {
    serde_json::from_slice(&files[&format!("v1.0-synthetic/{table}.json")]).unwrap()
}

fn by_token(rows: &Rows) -> HashMap<&str, &Value> {
    rows.iter().map(|row| (row["token"].as_str().unwrap(), row)).collect()
}

fn text<'a>(row: &'a Value, key: &str) -> &'a str {
    row[key].as_str().unwrap()
}

fn vector(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn pose(row: &Value) -> RigidPose {
    let (q, t) = (vector(&row["rotation"]), vector(&row["translation"]));
    RigidPose { rotation: DQuat::from_xyzw(q[1], q[2], q[3], q[0]), translation: DVec3::from_slice(&t) }
}

#[test]
fn tables_link_and_files_are_there() {
    let files = written(8);
    let names = "category attribute visibility instance sensor calibrated_sensor ego_pose log scene sample \
                 sample_data sample_annotation map lidarseg";
    let tables: Vec<(&str, Rows)> = names.split(' ').map(|name| (name, rows(&files, name))).collect();
    let find = |table: &str| &tables.iter().find(|(name, _)| *name == table).unwrap().1;
    for (name, rows) in &tables {
        let tokens = by_token(rows);
        assert_eq!(tokens.len(), rows.len(), "{name}");
        for row in rows {
            assert!(text(row, "token").len() == 32);
            for (key, other) in [
                ("sample_token", "sample"),
                ("scene_token", "scene"),
                ("log_token", "log"),
                ("first_sample_token", "sample"),
                ("last_sample_token", "sample"),
                ("ego_pose_token", "ego_pose"),
                ("calibrated_sensor_token", "calibrated_sensor"),
                ("sensor_token", "sensor"),
                ("sample_data_token", "sample_data"),
            ] {
                if let Some(token) = row.get(key) {
                    assert!(by_token(find(other)).contains_key(token.as_str().unwrap()), "{name}.{key}");
                }
            }
            if let Some(path) = row.get("filename") {
                assert!(files.contains_key(path.as_str().unwrap()), "{path}");
            }
            if let Some(next) = row.get("next").filter(|next| **next != "") {
                let next = tokens[next.as_str().unwrap()];
                assert_eq!(next["prev"], row["token"]);
                assert!(next["timestamp"].as_i64() > row["timestamp"].as_i64());
            }
        }
    }
    // Two clips of 20 frames at 10 Hz and five sensors; every fifth frame is a sample.
    let readings = find("sample_data");
    assert_eq!((readings.len(), find("sample").len(), find("lidarseg").len()), (200, 8, 8));
    assert_eq!(readings.iter().filter(|row| row["is_key_frame"] == true).count(), 40);
    let starts = |table: &str, key: &str| find(table).iter().filter(|row| row[key] == "").count();
    assert_eq!([starts("sample", "prev"), starts("sample", "next")], [2, 2]);
    assert_eq!([starts("sample_data", "prev"), starts("sample_data", "next")], [10, 10]);
    // All files are named by a table, but for the tables themselves and the splits.
    let named: HashSet<&str> =
        tables.iter().flat_map(|(_, rows)| rows).filter_map(|row| row.get("filename")?.as_str()).collect();
    assert_eq!(files.len(), named.len() + tables.len() + 1);
    // A sweep belongs to the next sample.
    let samples = by_token(find("sample"));
    for row in readings {
        let (own, sample) = (row["timestamp"].as_i64().unwrap(), samples[text(row, "sample_token")]);
        let late = sample["timestamp"].as_i64().unwrap() - own;
        assert!((0..500_000).contains(&late) || sample["next"] == "", "{late}");
    }
}

#[test]
fn points_are_seen_where_pictures_show_them() {
    let (files, set) = (written(8), testing::set());
    let [readings, poses, calibrations, sensors] =
        ["sample_data", "ego_pose", "calibrated_sensor", "sensor"].map(|name| rows(&files, name));
    let (poses, calibrations, sensors) = (by_token(&poses), by_token(&calibrations), by_token(&sensors));
    let calibration = |row: &Value| calibrations[text(row, "calibrated_sensor_token")];
    let channel = |row: &Value| text(sensors[text(calibration(row), "sensor_token")], "channel").to_owned();
    let world_from_sensor =
        |row: &Value| pose(poses[text(row, "ego_pose_token")]).then(&pose(calibration(row)));
    let mut seen = HashSet::new();
    for lidar in readings.iter().filter(|row| channel(row) == "LIDAR_TOP") {
        let bytes = &files[text(lidar, "filename")];
        let value = |k: usize| f64::from(f32::from_le_bytes(bytes[4 * k..4 * k + 4].try_into().unwrap()));
        assert_eq!((bytes.len(), value(3), value(4), value(9)), (60 * 20, 40.0, 15.0, 14.0));
        let world = world_from_sensor(lidar).point(DVec3::new(value(0), value(1), value(2)));
        assert!(world.distance(SPOT) < 1e-5, "{world}");
        for camera in
            readings.iter().filter(|row| row["timestamp"] == lidar["timestamp"] && row["fileformat"] == "jpg")
        {
            let k: Vec<Vec<f64>> =
                calibration(camera)["camera_intrinsic"].as_array().unwrap().iter().map(vector).collect();
            let k = DMat3::from_cols_array_2d(&[0, 1, 2].map(|row| [0, 1, 2].map(|column| k[column][row])));
            let pixel = k * world_from_sensor(camera).inverse().point(world);
            let index = ["CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT"]
                .iter()
                .position(|name| *name == channel(camera))
                .unwrap();
            let info = set.sensors[index].camera().unwrap();
            let point = world_from_sensor(camera).inverse().point(SPOT);
            if point.z > 1.0 {
                for (k, expected) in testing::project(info, point).into_iter().enumerate() {
                    assert!((pixel[k] / pixel.z + 0.5 - expected).abs() < 1e-3);
                }
                seen.insert(index);
            }
        }
    }
    assert_eq!(seen.len(), 3);
}

#[test]
fn classes_and_radars_are_as_the_devkit_reads_them() {
    let files = written(8);
    let classes = files.iter().find(|(path, _)| path.starts_with("lidarseg/")).unwrap().1;
    assert_eq!((classes.len(), &classes[..4], classes[20]), (60, &[29, 24, 28, 29][..], 0));
    let radar = files.iter().find(|(path, _)| path.starts_with("sweeps/RADAR_FRONT/")).unwrap().1;
    let data = radar.windows(12).position(|bytes| bytes == b"DATA binary\n").unwrap() + 12;
    assert_eq!(radar.len() - data, 4 * 43 + 1);
    let record = &radar[data + 43..];
    let value = |at: usize| f32::from_le_bytes(record[at..at + 4].try_into().unwrap());
    assert_eq!((value(0), value(4), record[12], record[13], value(15)), (21.0, -1.0, 1, 1, 6.0));
    assert!((value(19).hypot(value(23)) - 7.5).abs() < 1e-5 && value(19) < 0.0);
    assert!((value(27).hypot(value(31)) - 0.25).abs() < 1e-6 && value(27) > 0.0);
    // The reader wants a record and takes one of NaN for none.
    let none = files::radar(&[]);
    let data = none.len() - 44;
    assert!(
        none[..data].ends_with(b"POINTS 1\nDATA binary\n") && none[data..data + 4] == f32::NAN.to_le_bytes()
    );
}

#[test]
fn files_do_not_depend_on_blocks() {
    assert!(written(1) == written(20));
}

#[test]
fn descriptions_say_the_weather() {
    let files = written(8);
    let scenes = rows(&files, "scene");
    let words: Vec<&str> = scenes.iter().map(|row| text(row, "description")).collect();
    assert_eq!(words, ["rain 25 mm/h, visibility 900 m, day", "snow 1.5 mm/h, visibility 900 m, night"]);
    let mut weather = testing::clips()[0].weather.clone();
    (weather.condition, weather.rain_rate, weather.mor) = (Condition::Fog, 0.0, 61.237);
    assert_eq!(tables::description(&weather), "fog, visibility 61.2 m, day");
    let splits: Value = serde_json::from_slice(&files["v1.0-synthetic/splits.json"]).unwrap();
    assert_eq!(splits["synthetic_val"][0], "000001-bend-snow");
}

#[test]
fn channels_are_named_by_direction_where_one_sensor_looks_there() {
    let mut set = testing::set();
    assert_eq!(
        channels(&set),
        ["CAM_FRONT", "CAM_FRONT_LEFT", "CAM_FRONT_RIGHT", "LIDAR_TOP", "RADAR_FRONT"]
    );
    for (index, name) in [(0, "tele-1"), (3, "roof"), (4, "radar_b")] {
        let mut other = set.sensors[index].clone();
        other.name = name.into();
        set.sensors.push(other);
    }
    let names = channels(&set);
    assert_eq!(
        [0, 3, 4, 5, 6, 7].map(|index| names[index].as_str()),
        ["CAM_FRONT", "LIDAR_TOP", "RADAR_BUMPER", "CAM_TELE_1", "LIDAR_ROOF", "RADAR_B"]
    );
}
