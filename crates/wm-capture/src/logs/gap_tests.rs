//! Logs with gaps and damage: what is missing is left out and said, and what is damaged is refused
//! or skipped.

use super::mini::{FRAME_COUNT, MiniLog};
use super::tests::{check_places, made, open};
use super::*;
use std::fs;
use std::ops::ControlFlow;

const SKIP: fn() -> LogOptions = || LogOptions { skip_bad: true, ..LogOptions::default() };

fn edit(path: &Path, change: impl Fn(&str) -> String) {
    fs::write(path, change(&fs::read_to_string(path).unwrap())).unwrap();
}

/// Replaces a line of a file, from 0.
fn set_line(path: &Path, number: usize, new: &str) {
    edit(path, |text| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[number] = new;
        lines.join("\n") + "\n"
    });
}

/// The error of opening a log, or of its capture.
fn failure(path: &Path, options: &LogOptions) -> String {
    match DrivingLog::open(path, options) {
        Err(error) => error.to_string(),
        Ok(log) => capture(&log.unwrap(), options.skip_bad).unwrap_err(),
    }
}

/// The summary of a log's capture.
fn capture(log: &DrivingLog, skip_bad: bool) -> Result<LogCaptureSummary, String> {
    let folder = tempfile::tempdir().unwrap();
    let options = LogCaptureOptions { depth_pixels: 1200, skip_bad };
    let made = log.write_capture(folder.path(), &options, &mut |_| ControlFlow::Continue(()));
    made.map(Option::unwrap).map_err(|error| error.to_string())
}

fn says(log: &[String], part: &str) -> bool {
    log.iter().any(|warning| warning.contains(part))
}

const SENSORS: [&str; 6] = [
    "oxts/timestamps.txt",
    "image_02/timestamps.txt",
    "image_03/timestamps.txt",
    "velodyne_points/timestamps.txt",
    "velodyne_points/timestamps_start.txt",
    "velodyne_points/timestamps_end.txt",
];

#[test]
fn an_empty_line_of_times_is_a_missing_record() {
    // The line of each sensor alone, and its file there or not.
    for (sensor, file) in SENSORS.into_iter().zip([
        "oxts/data/0000000002.txt",
        "image_02/data/0000000002.png",
        "image_03/data/0000000002.png",
        "velodyne_points/data/0000000002.bin",
        "velodyne_points/data/0000000002.bin",
        "velodyne_points/data/0000000002.bin",
    ]) {
        for is_lost in [true, false] {
            let (_folder, mini) = made(0);
            set_line(&mini.path.join(sensor), 2, "");
            if is_lost {
                fs::remove_file(mini.path.join(file)).unwrap();
            }
            let mut log = open(&mini);
            let (pictures, sweeps) = (log.pictures.len(), log.sweeps.len());
            let lost = [usize::from(sensor.starts_with("image")), usize::from(file.ends_with("bin"))];
            if sensor.ends_with("_start.txt") || sensor.ends_with("_end.txt") {
                // A sweep without its start or its end is taken as still.
                let kept = sweeps + usize::from(is_lost);
                assert_eq!((pictures, kept), (2 * FRAME_COUNT, FRAME_COUNT), "{sensor}");
                log.sweeps.retain(|sweep| !sweep.file.ends_with("0000000002.bin"));
            } else {
                assert_eq!([2 * FRAME_COUNT - pictures, FRAME_COUNT - sweeps], lost, "{sensor}");
                let is_said = says(&log.warnings, "have no time or no pose in oxts; they are left out");
                assert_eq!(is_said, !is_lost && lost != [0, 0], "{sensor} {:?}", log.warnings);
            }
            check_places("KITTI raw", &mini, &log);
        }
    }
}

#[test]
fn line_ends_and_marks_of_other_systems_are_nothing() {
    for change in [
        |text: &str| text.replace('\n', "\r\n"),
        |text: &str| format!("{text}\n \n\r\n"),
        |text: &str| format!("\u{feff}{}", text.trim_end()),
    ] {
        for index in [0, 1] {
            let (_folder, mini) = made(index);
            let names: &[&str] =
                if index == 0 { &SENSORS } else { &["times.txt", "../../poses/07.txt", "calib.txt"] };
            for name in names {
                edit(&mini.path.join(name), change);
            }
            let log = open(&mini);
            let warnings = if index == 0 { 0 } else { 1 };
            assert_eq!((log.sweeps.len(), log.warnings.len()), (FRAME_COUNT, warnings), "{:?}", log.warnings);
            check_places(log.format, &mini, &log);
        }
    }
}

#[test]
fn an_empty_line_of_poses_is_a_missing_frame() {
    for name in ["times.txt", "../../poses/07.txt"] {
        let (_folder, mini) = made(1);
        set_line(&mini.path.join(name), 3, "");
        let log = open(&mini);
        assert_eq!((log.pictures.len(), log.sweeps.len()), (FRAME_COUNT - 1, FRAME_COUNT - 1));
        assert!(says(&log.warnings, "1 pictures of image_2 have no pose or time"), "{:?}", log.warnings);
        assert!(says(&log.warnings, "1 sweeps have no pose or time"), "{:?}", log.warnings);
        check_places("KITTI odometry", &mini, &log);
    }
    // Without times, too.
    let (_folder, mini) = made(1);
    set_line(&mini.path.join("../../poses/07.txt"), 0, "");
    fs::remove_file(mini.path.join("times.txt")).unwrap();
    let log = open(&mini);
    assert_eq!((log.pictures.len(), log.pictures[0].timestamp), (FRAME_COUNT - 1, 100_000_000));
    check_places("KITTI odometry", &mini, &log);
}

type Damage = fn(&MiniLog);

/// Damage to one record of each kind, with what the error says and the lost pictures and sweeps.
const DAMAGED: [(usize, Damage, &str, [usize; 2]); 15] = [
    (0, |m| cut(m, "velodyne_points/data/0000000003.bin"), "no whole number of points", [0, 1]),
    (0, |m| put(m, "oxts/data/0000000003.txt", "49 nan 1 0 0 0"), "is not a finite number", [0, 0]),
    (0, |m| put(m, "oxts/data/0000000003.txt", "0 0 0 0 0 0"), "the vehicle jumps to", [0, 0]),
    (0, |m| line(m, "image_02/timestamps.txt", "2011-09-26 13:0"), "is no time such as", [1, 0]),
    (0, |m| put(m, "tracklet_labels.xml", "<tracklets"), "a tag without its end", [0, 0]),
    (1, |m| line(m, "../../poses/07.txt", "1 0 0 0 0 1 0"), "a pose has 12 or 16 numbers", [1, 1]),
    (1, |m| line(m, "times.txt", "0.3 0.4"), "a line must be one time", [1, 1]),
    (1, |m| cut(m, "labels/000003.label"), "are not the labels of", [0, 1]),
    (2, nuscenes_pose, "the quaternion has the length", [0, 1]),
    (2, |m| cut(m, &first_file(m, "samples/LIDAR_TOP")), "no whole number of points", [0, 1]),
    (3, |m| cut(m, &first_file(m, "sensors/lidar")), "copy the file again", [0, 1]),
    (4, |m| cut(m, "lidar/003.bin"), "no whole number of points", [0, 1]),
    (4, |m| put(m, "ego_pose/003.txt", "1 2 3"), "a pose has 12 or 16 numbers", [2, 1]),
    (4, |m| cut(m, "sky_masks/003_0.png"), "no PNG that can be read", [0, 0]),
    (5, |m| cut(m, "dynamic_masks/all/003_0.png"), "no PNG that can be read", [0, 0]),
];

fn put(mini: &MiniLog, name: &str, text: &str) {
    fs::write(mini.path.join(name), text).unwrap();
}

/// Takes the last bytes off.
fn cut(mini: &MiniLog, name: &str) {
    let path = mini.path.join(name);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
}

/// Replaces the fourth line.
fn line(mini: &MiniLog, name: &str, text: &str) {
    set_line(&mini.path.join(name), 3, text);
}

fn first_file(mini: &MiniLog, folder: &str) -> String {
    let mut names: Vec<String> = fs::read_dir(mini.path.join(folder))
        .unwrap()
        .map(|entry| format!("{folder}/{}", entry.unwrap().file_name().to_string_lossy()))
        .collect();
    names.sort();
    names.remove(0)
}

fn nuscenes_pose(mini: &MiniLog) {
    let path = mini.path.join("v1.0-mini/ego_pose.json");
    let mut table: Vec<serde_json::Value> = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let own = table.iter_mut().find(|record| record["token"] == "lidar-3").unwrap();
    own["rotation"] = serde_json::json!([0.0, 0.0, 0.0, 0.0]);
    fs::write(&path, serde_json::to_vec(&table).unwrap()).unwrap();
}

#[test]
fn a_damaged_record_is_refused_or_skipped() {
    for (number, (index, damage, text, lost)) in DAMAGED.into_iter().enumerate() {
        let (_folder, mini) = made(index);
        damage(&mini);
        let error = failure(&mini.path, &LogOptions::default());
        assert!(
            error.contains(text) && error.contains("(--skip-bad goes on without it)"),
            "{number}: {error}"
        );
        assert!(!error.contains('\n'), "{error}");
        let log = DrivingLog::open(&mini.path, &SKIP()).unwrap().unwrap();
        let made = capture(&log, true).unwrap();
        let pictures = if index == 1 { FRAME_COUNT } else { 2 * FRAME_COUNT };
        assert_eq!(
            [pictures - made.pictures, FRAME_COUNT - made.sweeps],
            lost,
            "{number}: {:?}",
            made.warnings
        );
        assert!(says(&made.warnings, text), "{number}: {:?}", made.warnings);
    }
}

#[test]
fn points_that_are_not_finite_are_counted() {
    let (_folder, mini) = made(2);
    let file = mini.path.join(first_file(&mini, "sweeps/LIDAR_TOP"));
    let mut bytes = fs::read(&file).unwrap();
    for (point, value) in [(1, f32::NAN), (4, f32::INFINITY), (7, 1e20)] {
        bytes[20 * point..20 * point + 4].copy_from_slice(&value.to_le_bytes());
    }
    fs::write(&file, bytes).unwrap();
    fs::write(mini.path.join(first_file(&mini, "samples/LIDAR_TOP")), "").unwrap();
    let made = capture(&open(&mini), false).unwrap();
    assert_eq!(made.sweeps, FRAME_COUNT - 1);
    assert!(says(&made.warnings, "1 sweeps have no points"), "{:?}", made.warnings);
    assert!(
        says(&made.warnings, "3 points of sweeps are not finite or over a kilometre away"),
        "{:?}",
        made.warnings
    );
}

#[test]
fn calibrations_of_no_lens_are_refused() {
    for (value, text) in
        [("1e-317", "focal lengths of"), ("1e300", "focal lengths of"), ("0", "focal lengths of")]
    {
        let (_folder, mini) = made(4);
        put(&mini, "intrinsics/0.txt", &format!("{value} 50 40 30"));
        let error = failure(&mini.path, &SKIP());
        assert!(error.contains(text) && error.ends_with("its calibration is damaged"), "{error}");
    }
    let (_folder, mini) = made(4);
    put(&mini, "intrinsics/0.txt", "50 50 1e30 30");
    assert!(failure(&mini.path, &SKIP()).contains("a principal point at 1e30, 3.05e1 px"));
}

#[test]
fn the_first_whole_log_of_a_folder_is_read() {
    // A second log beside the first, before it by name, whose pictures are not there.
    for (index, twin, gone) in [
        (0, "2011_09_26_drive_0000_sync", &["image_02", "image_03"][..]),
        (1, "06", &["image_2"]),
        (3, "0000", &["sensors/cameras"]),
        (4, "022", &["images"]),
    ] {
        let (_folder, mini) = made(index);
        let folder = mini.path.parent().unwrap();
        copy(&mini.path, &folder.join(twin));
        for gone in gone {
            let gone = folder.join(twin).join(gone);
            fs::remove_dir_all(&gone).unwrap();
            fs::create_dir_all(gone.join("data")).unwrap();
        }
        // Sequences are given by their root, too; days by the folder that holds them.
        for root in [folder, folder.parent().unwrap()] {
            let ask = |scene: Option<String>| {
                DrivingLog::open(root, &LogOptions { scene, ..LogOptions::default() })
            };
            let Some(log) = ask(None).unwrap() else {
                assert!(index >= 3 && root != folder);
                continue;
            };
            let name = mini.path.file_name().unwrap().to_string_lossy();
            assert_eq!(log.name, name);
            let note = &log.warnings[0];
            assert!(note.starts_with(&format!("{name} is read, the first of 2 ")), "{note}");
            assert!(note.contains(twin) && note.ends_with("; --log-scene names another"), "{note}");
            assert_eq!(ask(Some(name.into_owned())).unwrap().unwrap().pictures, log.pictures);
            let error = ask(Some(twin.to_owned())).unwrap_err().to_string();
            assert!(error.contains("no pictures; unpack what is missing; of its"), "{error}");
        }
        fs::remove_dir_all(&mini.path).unwrap();
        fs::create_dir_all(&mini.path).unwrap();
        let error = DrivingLog::open(folder, &LogOptions::default()).map(|log| log.is_some()).unwrap_err();
        assert!(error.to_string().contains("is whole: ") && error.to_string().contains(twin), "{error}");
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let own = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &own);
        } else {
            fs::copy(&path, own).unwrap();
        }
    }
}

#[test]
fn a_scene_of_nuscenes_whose_files_are_not_there_is_passed_over() {
    let (_folder, mini) = made(2);
    let table = |name: &str| mini.path.join(format!("v1.0-mini/{name}.json"));
    let add = |name: &str, record: serde_json::Value| {
        let mut records: Vec<serde_json::Value> =
            serde_json::from_slice(&fs::read(table(name)).unwrap()).unwrap();
        records.insert(0, record);
        fs::write(table(name), serde_json::to_vec(&records).unwrap()).unwrap();
    };
    add("scene", serde_json::json!({"token": "scene-a", "name": "scene-0001", "log_token": "log"}));
    add("sample", serde_json::json!({"token": "gone", "scene_token": "scene-a", "timestamp": 1}));
    let data = serde_json::json!({"sample_token": "gone", "ego_pose_token": "lidar-0", "calibrated_sensor_token": "c-CAM_FRONT",
        "timestamp": 1, "is_key_frame": true, "width": 80, "height": 60, "filename": "samples/CAM_FRONT/gone.jpg"});
    add("sample_data", data);
    let ask = |scene: Option<&str>| {
        DrivingLog::open(&mini.path, &LogOptions { scene: scene.map(str::to_owned), ..LogOptions::default() })
    };
    let log = ask(None).unwrap().unwrap();
    assert_eq!((log.name.as_str(), log.pictures.len()), ("scene-0002", 2 * FRAME_COUNT));
    assert_eq!(
        log.warnings,
        [
            "scene-0002 is read, the first of 3 scenes whose files are there; passed over: scene-0001 (0 of 1 pictures of key \
          frames are there); --log-scene names another"
        ]
    );
    assert_eq!(ask(Some("scene-b")).unwrap().unwrap().warnings, Vec::<String>::new());
    for asked in ["scene-0001", "scene-a"] {
        let error = ask(Some(asked)).unwrap_err().to_string();
        let end = "scene-0001: 0 of 1 pictures of key frames are there; unpack what is missing; of its scenes these are \
                   whole: scene-0002";
        assert!(error.ends_with(end), "{error}");
    }
    // Nothing is unpacked at all.
    fs::remove_dir_all(mini.path.join("samples")).unwrap();
    let error = ask(None).unwrap_err().to_string();
    assert!(error.contains("none of its scenes is whole: scene-0001 (0 of 1 "), "{error}");
}

/// Sets of Lyft: times are floating-point numbers, and pictures are in a folder of another name
/// than their records say.
#[test]
fn files_of_nuscenes_are_found_where_they_were_moved() {
    let (_folder, mini) = made(2);
    let table = mini.path.join("v1.0-mini/sample_data.json");
    let mut records: Vec<serde_json::Value> = serde_json::from_slice(&fs::read(&table).unwrap()).unwrap();
    for record in &mut records {
        let name = record["filename"].as_str().unwrap().rsplit('/').next().unwrap().to_owned();
        let name = if name.contains("LIDAR") { name.to_uppercase() } else { name };
        record["filename"] = format!("images\\{name}").into();
        record["timestamp"] = record["timestamp"].as_f64().unwrap().into();
    }
    fs::write(&table, serde_json::to_vec(&records).unwrap()).unwrap();
    let log = open(&mini);
    assert_eq!((log.pictures.len(), log.sweeps.len()), (2 * FRAME_COUNT, FRAME_COUNT));
    let note = format!("{} files are not at their paths; they were found by their names", 3 * FRAME_COUNT);
    assert!(log.warnings.contains(&note), "{:?}", log.warnings);
    check_places("nuScenes", &mini, &log);
    // A name that two files have is nobody's.
    let twin = log.pictures[0].file.file_name().unwrap().to_owned();
    fs::create_dir_all(mini.path.join("copies/CAM_BACK")).unwrap();
    fs::copy(&log.pictures[0].file, mini.path.join("copies/CAM_BACK").join(twin)).unwrap();
    let error = failure(&mini.path, &LogOptions::default());
    assert!(error.contains("could both be") && error.contains("(--skip-bad goes on without it)"), "{error}");
    let log = DrivingLog::open(&mini.path, &SKIP()).unwrap().unwrap();
    assert_eq!(log.pictures.len(), 2 * FRAME_COUNT - 1);
    assert!(says(&log.warnings, "1 damaged names of files are left out"), "{:?}", log.warnings);
}
