//! nuScenes (Caesar et al. 2020): one scene of a version's tables.
//!
//! Tables are read record by record, and only the records of the scene are kept: `sample_data.json`
//! of the whole set is over a gigabyte. Pictures and sweeps between key frames are taken, too.
//! Poses are of the record's own time; sweeps are, as the devkit has them, in the axes of that
//! time. Times are microseconds.

mod tables;

use super::files::{excerpt, fault, folders_in, name_of, pose_of_quaternion, read_table, shown};
use super::log::{
    DrivingLog, LogCamera, LogFormat, LogPicture, LogPictureMasks, check_cameras, displaced, is_asked, moved,
};
use super::records::{Candidate, LogOptions, Records, choose};
use super::sweep::{LogSweep, SweepRecords};
use super::track::{LogBox, LogTrack};
use crate::RigidPose;
use glam::DVec3;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use tables::{
    AnnotationRecord, CalibratedRecord, DataRecord, FileRecord, InstanceRecord, MapLogRecord, NamedRecord,
    PoseRecord, SampleRecord, SceneRecord, SensorRecord,
};
use wm_base::FormatError;
use wm_base::file_index::{FileIndex, FileKind, FilePlace, FoundFile};
use wm_scene::camera::Distortion;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat { name: "nuScenes", read };

/// Pictures and sweeps.
const SENSOR_FILES: FileKind =
    FileKind { extensions: &["jpg", "jpeg", "png", "bin", "pcd"], endings: &[], skipped: &[] };
/// Share of the pictures of key frames from which on a scene's files are there.
const MIN_PRESENT_SHARE: f64 = 0.9;
/// Most records of one scene in a table.
const MAX_SCENE_RECORDS: usize = 500_000;
/// Latitude and longitude of the origins of the maps, degrees.
const MAP_ORIGINS_DEG: [(&str, [f64; 2]); 4] = [
    ("boston-seaport", [42.336849169438615, -71.05785369873047]),
    ("singapore-onenorth", [1.2882100868743724, 103.78475189208984]),
    ("singapore-hollandvillage", [1.2993652317780957, 103.78217697143555]),
    ("singapore-queenstown", [1.2782562240223188, 103.76741409301758]),
];

/// A sensor with its pose in the rig.
struct Calibrated {
    channel: String,
    is_camera: bool,
    rig_from_sensor: RigidPose,
    intrinsic: Vec<Vec<f64>>,
}

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let is_version =
        |folder: &PathBuf| folder.join("scene.json").is_file() && folder.join("sample_data.json").is_file();
    let whole = std::path::absolute(path).map_err(|e| FormatError::reading(path, e))?;
    let (versions, root) = if is_version(&whole) {
        let root = whole.parent().unwrap_or(&whole).to_owned();
        (vec![whole], root)
    } else {
        (folders_in(path).into_iter().filter(is_version).collect(), path.to_owned())
    };
    if versions.is_empty() {
        return Ok(None);
    }
    let files = FileIndex::new(&root, SENSOR_FILES);
    let (version, scene, notes) = scene(&versions, &files, options)?;
    let mut records = Records::new(options.skip_bad);
    let (source, name) = (path.into(), scene.name.clone());
    let mut log = DrivingLog { source, name, warnings: notes, ..DrivingLog::default() };
    let map = map_of(&version, &scene)?;
    let samples = samples(&version, &scene)?;
    log.captured = samples.values().nth(samples.len() / 2).map(|time| *time as f64 * 1e-6);

    let sensors = calibrated(&version)?;
    let data = data(&version, &samples, &sensors, options)?;
    let poses = ego_poses(&version, &data, &mut records)?;
    let first = data
        .iter()
        .filter(|record| poses.contains_key(&record.ego_pose_token))
        .min_by_key(|record| record.timestamp);
    let first = first.and_then(|record| poses.get(&record.ego_pose_token));
    log.origin = first.map_or(DVec3::ZERO, |pose| pose.translation);
    if let Some((_, place)) = MAP_ORIGINS_DEG.iter().find(|(name, _)| Some(*name) == map.as_deref()) {
        log.location = Some(displaced(*place, log.origin.x, log.origin.y));
        log.is_north_known = true;
    }
    assemble(&mut log, &version, &sensors, data, &poses, &files, &mut records)?;
    log.tracks = tracks(&version, &samples, log.origin, &mut records)?;
    log.warnings.extend(records.warnings());
    Ok(Some(log))
}

fn nanoseconds(microseconds: i64) -> i64 {
    microseconds.saturating_mul(1000)
}

/// The scene that is asked for, or the first whose files are there, with its version and what was
/// passed over.
fn scene(
    versions: &[PathBuf],
    files: &FileIndex,
    options: &LogOptions,
) -> Result<(PathBuf, SceneRecord, Vec<String>), FormatError> {
    let mut notes = Vec::new();
    let mut failed = None;
    let known = shown(versions.iter().map(|version| name_of(version)));
    for version in versions {
        let scenes = scenes(version)?;
        let asked = options.scene.as_deref();
        // By name or token.
        let of_token = asked.and_then(|asked| scenes.iter().find(|scene| scene.token == asked));
        let asked = of_token.map(|scene| scene.name.clone()).or(asked.map(str::to_owned));
        let is_choice = versions.len() > 1 || scenes.len() > 1;
        let has = |scene: &SceneRecord| asked.as_ref().is_none_or(|asked| scene.name == *asked);
        let is_here = scenes.iter().any(has);
        let lacks = if is_choice && is_here {
            missing(version, files, &scenes, options)?
        } else {
            vec![None; scenes.len()]
        };
        let candidates = scenes.into_iter().zip(lacks);
        let candidates = candidates
            .map(|(scene, lacks)| Candidate { name: scene.name.clone(), value: scene, lacks })
            .collect();
        match choose(&version.join("scene.json"), "scenes", candidates, asked.as_deref()) {
            Ok((scene, note)) => {
                notes.extend(note);
                if versions.len() > 1 {
                    let own = name_of(version);
                    notes.push(format!(
                        "of the versions {known}, {own} is read; give the folder of another to read that"
                    ));
                }
                return Ok((version.clone(), scene, notes));
            }
            // That of a version that has the scene says most.
            Err(error) if is_here || failed.is_none() => failed = Some(error),
            Err(_) => {}
        }
    }
    Err(failed.unwrap_or_else(|| fault(files.folder(), "there is no scene in it")))
}

/// The scenes of a version, by name.
fn scenes(version: &Path) -> Result<Vec<SceneRecord>, FormatError> {
    let mut scenes = Vec::new();
    read_table::<SceneRecord>(&version.join("scene.json"), |record| {
        scenes.push(record);
        if scenes.len() > MAX_SCENE_RECORDS { Err("there are too many scenes".into()) } else { Ok(()) }
    })?;
    scenes.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(scenes)
}

/// For each scene what it lacks, in words: fewer than nine in ten of the pictures of its key frames
/// are there. Where that is so of all, that with the most lacks nothing. Scenes after the first
/// that lacks nothing are not looked at, unless one is asked for.
fn missing(
    version: &Path,
    files: &FileIndex,
    scenes: &[SceneRecord],
    options: &LogOptions,
) -> Result<Vec<Option<String>>, FormatError> {
    let index: BTreeMap<&str, usize> =
        scenes.iter().enumerate().map(|(index, scene)| (scene.token.as_str(), index)).collect();
    let mut samples = BTreeMap::new();
    read_table::<SampleRecord>(&version.join("sample.json"), |record| {
        if let Some(scene) = index.get(record.scene_token.as_str()) {
            samples.insert(record.token, *scene);
        }
        Ok(())
    })?;
    let sensors = calibrated(version)?;
    check_channels(version, &sensors, options)?;
    let mut names = vec![Vec::new(); scenes.len()];
    read_table::<FileRecord>(&version.join("sample_data.json"), |record| {
        let is_asked = |sensor: &Calibrated| sensor.is_camera && is_asked(options, &sensor.channel);
        if record.is_key_frame
            && let Some(scene) = samples.get(&record.sample_token)
            && sensors.get(&record.calibrated_sensor_token).is_some_and(is_asked)
        {
            names[*scene].push(record.filename);
        }
        Ok(())
    })?;
    let mut counts = Vec::with_capacity(names.len());
    let share = |there: usize, all: usize| there as f64 / all.max(1) as f64;
    for names in &names {
        let there = names.iter().filter(|name| matches!(files.find(name), Ok(Some(_)))).count();
        counts.push((there, names.len()));
        if options.scene.is_none() && share(there, names.len()) >= MIN_PRESENT_SHARE {
            break;
        }
    }
    let most = counts.iter().map(|(there, all)| share(*there, *all)).fold(0.0, f64::max);
    let enough = most.clamp(f64::MIN_POSITIVE, MIN_PRESENT_SHARE);
    let lacks = |index: usize| {
        let (there, all) = *counts.get(index)?;
        (share(there, all) < enough).then(|| format!("{there} of {all} pictures of key frames are there"))
    };
    Ok((0..scenes.len()).map(lacks).collect())
}

/// The name of the scene's map, if it is told.
fn map_of(version: &Path, scene: &SceneRecord) -> Result<Option<String>, FormatError> {
    let path = version.join("log.json");
    if !path.is_file() {
        return Ok(None);
    }
    let maps = collected(&path, "there are too many logs", |record: MapLogRecord| {
        Ok((record.token == scene.log_token).then_some((record.token, record.location)))
    })?;
    Ok(maps.into_values().next())
}

/// The entries that `entry` makes of the records of a table, [`MAX_SCENE_RECORDS`] at most, else
/// `too_many` is the error.
fn collected<R: DeserializeOwned, T>(
    path: &Path,
    too_many: &str,
    mut entry: impl FnMut(R) -> Result<Option<(String, T)>, String>,
) -> Result<BTreeMap<String, T>, FormatError> {
    let mut all = BTreeMap::new();
    read_table(path, |record| {
        all.extend(entry(record)?);
        if all.len() > MAX_SCENE_RECORDS { Err(too_many.into()) } else { Ok(()) }
    })?;
    Ok(all)
}

/// The times of the scene's samples, microseconds, by token.
fn samples(version: &Path, scene: &SceneRecord) -> Result<BTreeMap<String, i64>, FormatError> {
    let path = version.join("sample.json");
    let samples = collected(&path, "the scene has too many samples", |record: SampleRecord| {
        Ok((record.scene_token == scene.token).then_some((record.token, record.timestamp)))
    })?;
    if samples.is_empty() {
        return Err(fault(&path, format!("scene {:?} has no samples", scene.name)));
    }
    Ok(samples)
}

/// Cameras and lidars by the token of their calibration.
fn calibrated(version: &Path) -> Result<BTreeMap<String, Calibrated>, FormatError> {
    const TOO_MANY: &str = "there are too many sensors";
    let channels = collected(&version.join("sensor.json"), TOO_MANY, |record: SensorRecord| {
        Ok(Some((record.token, (record.channel, record.modality))))
    })?;
    collected(&version.join("calibrated_sensor.json"), TOO_MANY, |record: CalibratedRecord| {
        let Some((channel, modality)) = channels.get(&record.sensor_token) else { return Ok(None) };
        let is_camera = modality == "camera";
        if !is_camera && modality != "lidar" {
            return Ok(None);
        }
        let pose = pose_of_quaternion(record.rotation, record.translation.into());
        let rig_from_sensor = pose.map_err(|what| format!("sensor {}: {what}", record.token))?;
        let (channel, intrinsic) = (channel.clone(), record.camera_intrinsic);
        Ok(Some((record.token, Calibrated { channel, is_camera, rig_from_sensor, intrinsic })))
    })
}

/// The records of pictures and sweeps of the scene.
fn data(
    version: &Path,
    samples: &BTreeMap<String, i64>,
    sensors: &BTreeMap<String, Calibrated>,
    options: &LogOptions,
) -> Result<Vec<DataRecord>, FormatError> {
    let path = version.join("sample_data.json");
    let mut data = Vec::new();
    read_table::<DataRecord>(&path, |record| {
        if samples.contains_key(&record.sample_token)
            && let Some(sensor) = sensors.get(&record.calibrated_sensor_token)
            && (!sensor.is_camera || is_asked(options, &sensor.channel))
        {
            data.push(record);
        }
        if data.len() > MAX_SCENE_RECORDS {
            Err("the scene has too many pictures and sweeps".into())
        } else {
            Ok(())
        }
    })?;
    check_channels(version, sensors, options)?;
    Ok(data)
}

/// Refuses cameras that are not in the data set.
fn check_channels(
    version: &Path,
    sensors: &BTreeMap<String, Calibrated>,
    options: &LogOptions,
) -> Result<(), FormatError> {
    let names: BTreeSet<&str> =
        sensors.values().filter(|sensor| sensor.is_camera).map(|sensor| sensor.channel.as_str()).collect();
    let names: Vec<&str> = names.into_iter().collect();
    check_cameras(&version.join("sample_data.json"), options, &names)
}

/// The poses of the records, by token.
fn ego_poses(
    version: &Path,
    data: &[DataRecord],
    records: &mut Records,
) -> Result<BTreeMap<String, RigidPose>, FormatError> {
    let times: BTreeMap<&str, i64> =
        data.iter().map(|record| (record.ego_pose_token.as_str(), nanoseconds(record.timestamp))).collect();
    let path = version.join("ego_pose.json");
    let mut poses = Vec::new();
    read_table::<PoseRecord>(&path, |record| {
        if let Some(time) = times.get(record.token.as_str()) {
            let pose = pose_of_quaternion(record.rotation, record.translation.into());
            let pose = pose.map_err(|what| fault(&path, format!("pose {}: {what}", record.token)));
            let pose = records.sound("poses", pose).map_err(|error| error.problem.to_string())?;
            poses.extend(pose.map(|pose| (*time, record.token, pose)));
        }
        Ok(())
    })?;
    let poses = records.without_jumps(&path, poses, |(time, _, pose)| (*time, pose.translation))?;
    Ok(poses.into_iter().map(|(_, token, pose)| (token, pose)).collect())
}

/// Makes pictures and sweeps of the records.
fn assemble(
    log: &mut DrivingLog,
    version: &Path,
    sensors: &BTreeMap<String, Calibrated>,
    data: Vec<DataRecord>,
    poses: &BTreeMap<String, RigidPose>,
    files: &FileIndex,
    records: &mut Records,
) -> Result<(), FormatError> {
    let mut cameras = BTreeMap::<String, usize>::new();
    let (all, mut missing, mut elsewhere) = (data.len(), None, 0);
    for record in data {
        let sensor = &sensors[&record.calibrated_sensor_token];
        let Some(world_from_rig) = poses.get(&record.ego_pose_token) else {
            records.lost("pictures and sweeps have no ego_pose", 1);
            continue;
        };
        // Names are of others: none may lead out of the data set.
        if Path::new(&record.filename)
            .components()
            .any(|part| !matches!(part, Component::Normal(_) | Component::CurDir))
        {
            let name = excerpt(&record.filename);
            let what = format!("the file name \"{name}\" leaves the data set");
            return Err(fault(&version.join("sample_data.json"), what));
        }
        let found = files.find(&record.filename).map_err(|e| fault(files.folder(), e.to_string()));
        let Some(found) = records.sound("names of files", found)? else { continue };
        let Some(FoundFile { path: file, place }) = found else {
            records.lost("pictures and sweeps of the scene have no file", 1);
            missing.get_or_insert_with(|| files.folder().join(&record.filename));
            continue;
        };
        elsewhere += usize::from(place != FilePlace::Exact);
        let world_from_sensor = moved(*world_from_rig, log.origin).then(&sensor.rig_from_sensor);
        let timestamp = nanoseconds(record.timestamp);
        if sensor.is_camera {
            let known = cameras.get(&record.calibrated_sensor_token).copied();
            let camera = known.unwrap_or(log.cameras.len());
            if known.is_none() {
                log.cameras.push(self::camera(sensor, &record).map_err(|what| {
                    fault(&version.join("calibrated_sensor.json"), format!("{}: {what}", sensor.channel))
                })?);
                cameras.insert(record.calibrated_sensor_token.clone(), camera);
            }
            let (world_from_camera, masks) = (world_from_sensor, LogPictureMasks::default());
            log.pictures.push(LogPicture { camera, file, timestamp, world_from_camera, masks });
        } else {
            let layout = SweepRecords::Floats { columns: 5, position: 0, intensity: Some(3), white: 255.0 };
            log.sweeps.push(LogSweep::still(file, timestamp, world_from_sensor, layout));
        }
    }
    if elsewhere > 0 {
        log.warnings
            .push(format!("{elsewhere} files are not at their paths; they were found by their names"));
    }
    match missing {
        Some(first) if log.pictures.is_empty() => {
            let what = format!(
                "no such file; of scene {} none of the pictures is there, of {all} pictures and sweeps; unpack that part of \
                 the data set, or name another with --log-scene",
                log.name
            );
            Err(fault(&first, what))
        }
        _ => Ok(()),
    }
}

fn camera(sensor: &Calibrated, record: &DataRecord) -> Result<LogCamera, String> {
    let [a, b, c] = sensor.intrinsic.as_slice() else {
        return Err(format!("camera_intrinsic has {} rows, not 3", sensor.intrinsic.len()));
    };
    let (&[fx, _, cx], &[_, fy, cy], [_, _, _]) = (a.as_slice(), b.as_slice(), c.as_slice()) else {
        return Err("camera_intrinsic must have rows of 3".into());
    };
    let side = |side: Option<f64>| match side {
        Some(side) if side.fract() == 0.0 && (1.0..=32_768.0).contains(&side) => Ok(side as u32),
        _ => Err("its pictures have no width and height"),
    };
    Ok(LogCamera {
        name: sensor.channel.clone(),
        size: (side(record.width)?, side(record.height)?),
        focal: [fx, fy],
        center: [cx + 0.5, cy + 0.5],
        distortion: Distortion::None,
    })
}

/// The things that have boxes in the scene.
fn tracks(
    version: &Path,
    samples: &BTreeMap<String, i64>,
    origin: DVec3,
    records: &mut Records,
) -> Result<Vec<LogTrack>, FormatError> {
    let names = |file: &str| -> Result<BTreeMap<String, String>, FormatError> {
        let path = version.join(file);
        if !path.is_file() {
            return Ok(BTreeMap::new());
        }
        collected(&path, "there are too many records", |record: NamedRecord| {
            Ok(Some((record.token, record.name)))
        })
    };
    let (categories, attributes) = (names("category.json")?, names("attribute.json")?);
    let path = version.join("sample_annotation.json");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    /// Boxes, and whether attributes say that it moves or that it is parked.
    #[derive(Default)]
    struct FoundTrack {
        boxes: Vec<LogBox>,
        moves: bool,
        stands: bool,
    }
    let mut found = BTreeMap::<String, FoundTrack>::new();
    let mut count = 0;
    read_table::<AnnotationRecord>(&path, |record| {
        let Some(time) = samples.get(&record.sample_token) else { return Ok(()) };
        let [width, length, height] = record.size;
        let pose = if record.size.iter().all(|side| (0.0..1000.0).contains(side)) {
            pose_of_quaternion(record.rotation, record.translation.into())
        } else {
            Err(format!("a box of {width} x {length} x {height} m"))
        };
        let pose = records.sound("boxes", pose.map_err(|what| fault(&path, what)));
        let Some(world_from_box) = pose.map_err(|error| error.problem.to_string())? else { return Ok(()) };
        let own = LogBox {
            timestamp: nanoseconds(*time),
            world_from_box: moved(world_from_box, origin),
            size: DVec3::new(length, width, height),
        };
        let entry = found.entry(record.instance_token).or_default();
        entry.boxes.push(own);
        for attribute in record.attribute_tokens.iter().filter_map(|token| attributes.get(token)) {
            entry.moves |=
                matches!(attribute.as_str(), "vehicle.moving" | "cycle.with_rider" | "pedestrian.moving");
            entry.stands |= matches!(attribute.as_str(), "vehicle.parked" | "cycle.without_rider");
        }
        count += 1;
        if count > MAX_SCENE_RECORDS { Err("the scene has too many boxes".into()) } else { Ok(()) }
    })?;
    let mut kinds = BTreeMap::new();
    let instances = version.join("instance.json");
    if !found.is_empty() && instances.is_file() {
        kinds = collected(&instances, "there are too many records", |record: InstanceRecord| {
            Ok(found.contains_key(&record.token).then_some((record.token, record.category_token)))
        })?;
    }
    let track = |id: String, found: FoundTrack| {
        let category = kinds.get(&id).and_then(|kind| categories.get(kind)).cloned().unwrap_or_default();
        let mut track = LogTrack::new(id, category, found.boxes);
        // Boxes of what is parked jitter; attributes know better.
        if found.stands && !found.moves {
            track.is_mover = false;
        }
        track.is_mover |= found.moves;
        track
    };
    Ok(found.into_iter().map(|(id, found)| track(id, found)).collect())
}
