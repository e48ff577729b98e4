//! Argoverse 2 sensor logs (Wilson et al. 2021).
//!
//! `calibration/{egovehicle_SE3_sensor,intrinsics}.feather`, `city_SE3_egovehicle.feather`,
//! `annotations.feather`, `sensors/cameras/NAME/NS.jpg`, `sensors/lidar/NS.feather`. Sweeps are in
//! the vehicle's axes at their time, their motion taken out. Pictures have been undistorted by its
//! makers: k1, k2 and k3 of the intrinsics are those of the lens before, and are not used. Boxes
//! are in the vehicle's axes at their time.

pub(super) mod table;

use super::files::{
    MAX_BINARY_BYTES, fault, files_if_there, files_in, folders_in, has_files, pose_of_quaternion, read_bytes,
};
use super::log::{DrivingLog, LogCamera, LogFormat, check_cameras, displaced, moved};
use super::records::{ChosenLog, LogOptions, Records, choose_folder, logs_in};
use super::sweep::SweepRecords;
use super::track::{EgoTrack, LogBox, LogTrack};
use crate::RigidPose;
use crate::feather::FeatherTable;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use table::table_of;
use wm_base::FormatError;
use wm_scene::camera::Distortion;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat { name: "Argoverse 2", read };

/// Latitude and longitude of the origins of the cities' axes, degrees.
const CITY_ORIGINS_DEG: [(&str, [f64; 2]); 6] = [
    ("ATX", [30.27464237939507, -97.7404457407424]),
    ("DTW", [42.29993066912924, -83.17555750783717]),
    ("MIA", [25.77452579915163, -80.19656914449405]),
    ("PAO", [37.416065, -122.13571963362166]),
    ("PIT", [40.44177902989321, -80.01294377242584]),
    ("WDC", [38.889377, -77.0355047439081]),
];
/// Nanoseconds since 1970 before which no log was recorded: their times are those of the GPS or of
/// a test.
const MIN_TIME_NS: i64 = 1_000_000_000_000_000_000;
const POSES_FILE: &str = "city_SE3_egovehicle.feather";
const INTRINSICS_FILE: &str = "calibration/intrinsics.feather";
const POSE_COLUMNS: [&str; 7] = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let Some((path, note)) = find(path, options)? else { return Ok(None) };
    let path = path.as_path();
    let mut records = Records::new(options.skip_bad);
    let mut log = DrivingLog::begun(path, note);
    let track = ego_track(&path.join(POSES_FILE), &mut log, &mut records)?;
    cameras(path, options, &track, &mut log, &mut records)?;
    let at = |stem: &str| {
        let time = stem.parse().ok()?;
        Some((time, track.at(time)?))
    };
    let sweeps = files_if_there(&path.join("sensors/lidar"), &["feather"])?;
    log.add_sweeps(sweeps, SweepRecords::Feather, at, "sweeps have no pose", &mut records);
    log.tracks = tracks(&path.join("annotations.feather"), &track, &mut records)?;
    log.location = place(path, log.origin);
    log.is_north_known = log.location.is_some();
    log.warnings.extend(records.warnings());
    Ok(Some(log))
}

fn find(path: &Path, options: &LogOptions) -> Result<Option<ChosenLog<PathBuf>>, FormatError> {
    let lacks = |log: &Path| {
        let has_photos = |folder: &PathBuf| has_files(folder, &["jpg", "png"]);
        if !log.join(INTRINSICS_FILE).is_file() {
            Some(format!("no {INTRINSICS_FILE}"))
        } else if !folders_in(&log.join("sensors/cameras")).iter().any(has_photos) {
            Some("no pictures".into())
        } else {
            None
        }
    };
    choose_folder(path, "logs", options, logs_in(path, |log| log.join(POSES_FILE).is_file()), lacks)
}

/// Reads columns of a file.
fn table(path: &Path, names: &[&str]) -> Result<FeatherTable, FormatError> {
    table_of(path, &read_bytes(path, MAX_BINARY_BYTES)?, names)
}

/// Columns of floats.
fn floats_of(path: &Path, table: &mut FeatherTable, names: &[&str]) -> Result<Vec<Vec<f64>>, FormatError> {
    names.iter().map(|name| table.floats(name).map_err(|what| fault(path, what))).collect()
}

/// The poses of the rows; `None` for those that are damaged and left out.
fn poses_of(
    path: &Path,
    table: &mut FeatherTable,
    records: &mut Records,
) -> Result<Vec<Option<RigidPose>>, FormatError> {
    let columns = floats_of(path, table, &POSE_COLUMNS)?;
    let rows = columns.iter().map(Vec::len).min().unwrap_or(0);
    let mut pose = |row: usize| {
        let at = |column: usize| columns[column][row];
        let pose = pose_of_quaternion([at(0), at(1), at(2), at(3)], DVec3::new(at(4), at(5), at(6)));
        records.sound("poses", pose.map_err(|what| fault(path, format!("row {}: {what}", row + 1))))
    };
    (0..rows).map(&mut pose).collect()
}

fn ego_track(path: &Path, log: &mut DrivingLog, records: &mut Records) -> Result<EgoTrack, FormatError> {
    let mut table = table(path, &[&["timestamp_ns"], &POSE_COLUMNS[..]].concat())?;
    let times = table.ints("timestamp_ns").map_err(|what| fault(path, what))?;
    let poses = poses_of(path, &mut table, records)?;
    log.captured =
        times.get(times.len() / 2).filter(|time| **time > MIN_TIME_NS).map(|time| *time as f64 * 1e-9);
    let poses: Vec<(i64, RigidPose)> =
        times.into_iter().zip(poses).filter_map(|(time, pose)| Some((time, pose?))).collect();
    let mut poses = records.without_jumps(path, poses, |(time, pose)| (*time, pose.translation))?;
    let Some((_, first)) = poses.first() else { return Err(fault(path, "there are no poses in it")) };
    log.origin = first.translation;
    for (_, pose) in &mut poses {
        *pose = moved(*pose, log.origin);
    }
    Ok(EgoTrack::new(poses))
}

fn cameras(
    path: &Path,
    options: &LogOptions,
    track: &EgoTrack,
    log: &mut DrivingLog,
    records: &mut Records,
) -> Result<(), FormatError> {
    let file = path.join("calibration/egovehicle_SE3_sensor.feather");
    let mut table_ = table(&file, &[&["sensor_name"], &POSE_COLUMNS[..]].concat())?;
    let names = table_.texts("sensor_name").map_err(|what| fault(&file, what))?;
    // The calibration is refused where it is damaged.
    let poses = poses_of(&file, &mut table_, &mut Records::new(false))?;
    let poses: BTreeMap<String, RigidPose> =
        names.into_iter().zip(poses).filter_map(|(name, pose)| Some((name, pose?))).collect();

    let file = path.join(INTRINSICS_FILE);
    let columns = ["fx_px", "fy_px", "cx_px", "cy_px", "width_px", "height_px"];
    let mut table_ = table(&file, &[&["sensor_name"], &columns[..]].concat())?;
    let names = table_.texts("sensor_name").map_err(|what| fault(&file, what))?;
    let values = floats_of(&file, &mut table_, &columns)?;
    let folder = path.join("sensors/cameras");
    let known: Vec<&str> = names.iter().map(String::as_str).collect();
    check_cameras(path, options, &known)?;
    for (row, name) in names.iter().enumerate() {
        // The stereo pair shows grey pictures of what the ring shows in colour.
        let is_wanted = if options.cameras.is_empty() {
            name.starts_with("ring_")
        } else {
            options.cameras.contains(name)
        };
        // Names are of others: none may lead out of the log.
        let own = folder.join(name);
        if !is_wanted || name.contains(['/', '\\']) || !own.is_dir() {
            continue;
        }
        let Some(rig_from_camera) = poses.get(name) else {
            let what = format!("camera {name:?} has no pose in egovehicle_SE3_sensor.feather");
            return Err(fault(&file, what));
        };
        let at = |column: usize| values[column].get(row).copied().unwrap_or(f64::NAN);
        let side = |value: f64| if (1.0..=32_768.0).contains(&value) { value as u32 } else { 0 };
        let camera = LogCamera {
            name: name.clone(),
            size: (side(at(4)), side(at(5))),
            focal: [at(0), at(1)],
            center: [at(2) + 0.5, at(3) + 0.5],
            distortion: Distortion::None,
        };
        let world_from_camera = |stem: &str| {
            let time = stem.parse().ok()?;
            Some((time, track.at(time)?.then(rig_from_camera)))
        };
        let lost = format!("pictures of {name} have no pose");
        log.add_camera(camera, files_in(&own, &["jpg", "png"])?, world_from_camera, &lost, records);
    }
    Ok(())
}

/// The boxes; none if there is no file.
fn tracks(path: &Path, ego: &EgoTrack, records: &mut Records) -> Result<Vec<LogTrack>, FormatError> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let others = ["timestamp_ns", "track_uuid", "category", "length_m", "width_m", "height_m"];
    let mut table = table(path, &[&others[..], &POSE_COLUMNS[..]].concat())?;
    let told = |what: String| fault(path, what);
    let times = table.ints("timestamp_ns").map_err(told)?;
    let (ids, kinds) = (table.texts("track_uuid").map_err(told)?, table.texts("category").map_err(told)?);
    let sides = floats_of(path, &mut table, &others[3..])?;
    let poses = poses_of(path, &mut table, records)?;
    let mut found = BTreeMap::<String, (String, Vec<LogBox>)>::new();
    let rows = times.iter().zip(ids).zip(kinds).zip(poses).enumerate();
    for (row, (((time, id), category), rig_from_box)) in rows {
        let Some((world_from_rig, rig_from_box)) = ego.at(*time).zip(rig_from_box) else { continue };
        let side = |axis: usize| sides[axis].get(row).copied().unwrap_or(f64::NAN);
        let size = DVec3::new(side(0), side(1), side(2));
        if !size.to_array().iter().all(|side| (0.0..1000.0).contains(side)) {
            let wrong = fault(path, format!("row {}: a box of {size} m", row + 1));
            records.sound("boxes", Err::<(), _>(wrong))?;
            continue;
        }
        let own = LogBox { timestamp: *time, world_from_box: world_from_rig.then(&rig_from_box), size };
        found.entry(id).or_insert_with(|| (category, Vec::new())).1.push(own);
    }
    Ok(found.into_iter().map(|(id, (category, boxes))| LogTrack::new(id, category, boxes)).collect())
}

/// Latitude and longitude of the origin, by the city in the name of the map.
fn place(path: &Path, origin: DVec3) -> Option<[f64; 2]> {
    let maps = files_in(&path.join("map"), &["json"]).ok()?;
    let city =
        |name: &str| CITY_ORIGINS_DEG.iter().find(|(city, _)| name.contains(&format!("____{city}_city_")));
    let (_, place) = maps.iter().find_map(|(name, _)| city(name))?;
    Some(displaced(*place, origin.x, origin.y))
}
