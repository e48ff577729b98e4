//! Tests over whole logs.

use super::mini::{FRAME_COUNT, MINI_LOGS, MiniLog, SIZE, color_at};
use super::*;
use crate::{self as capture, CaptureOptions};
use glam::DVec3;
use proptest::prelude::*;
use std::ops::ControlFlow;
use std::path::PathBuf;
use tempfile::{TempDir, tempdir};

pub(super) fn made(index: usize) -> (TempDir, MiniLog) {
    let folder = tempdir().unwrap();
    let mini = MINI_LOGS[index].1(folder.path()).unwrap();
    (folder, mini)
}

pub(super) fn open(mini: &MiniLog) -> DrivingLog {
    DrivingLog::open(&mini.path, &LogOptions::default()).unwrap().unwrap()
}

fn write(log: &DrivingLog, folder: &Path) -> LogCaptureSummary {
    let options = LogCaptureOptions { depth_pixels: 4800, ..LogCaptureOptions::default() };
    log.write_capture(folder, &options, &mut |_| ControlFlow::Continue(())).unwrap().unwrap()
}

/// The pixels of the landmarks in a picture.
fn expected<'a>(mini: &'a MiniLog, file: &Path) -> &'a [Option<(f64, f64)>] {
    let name = file.to_string_lossy().replace('\\', "/");
    &mini.photos.iter().find(|(end, _)| name.ends_with(end)).unwrap().1
}

#[test]
fn points_of_the_lidar_fall_on_their_pixels() {
    for (index, (name, _)) in MINI_LOGS.iter().enumerate() {
        let (_folder, mini) = made(index);
        let log = open(&mini);
        assert_eq!(log.format, *name);
        assert_eq!(log.pictures.len(), mini.photos.len(), "{name} {:?}", log.warnings);
        assert_eq!(log.sweeps.len(), FRAME_COUNT, "{name}");
        check_places(name, &mini, &log);
    }
}

/// Landmarks are at their pixels in all pictures, and at their places in all sweeps.
pub(super) fn check_places(name: &str, mini: &MiniLog, log: &DrivingLog) {
    let mut checked = 0;
    for picture in &log.pictures {
        let camera = log.cameras[picture.camera].camera(&picture.world_from_camera);
        for (landmark, pixel) in mini.landmarks.iter().zip(expected(mini, &picture.file)) {
            let Some((x, y)) = pixel.filter(|(x, y)| x.hypot(*y) < 300.0) else { continue };
            let (u, v, _) = camera.project(*landmark - log.origin).unwrap();
            // The times of some are rounded to microseconds.
            assert!((u - x).hypot(v - y) < 1e-3, "{name}: {u}, {v} and not {x}, {y}");
            checked += 1;
        }
    }
    assert!(checked > 20 * log.pictures.len(), "{name}: {checked}");
    for sweep in &log.sweeps {
        let points = sweep.points().unwrap();
        assert!(points.len() >= mini.landmarks.len());
        for (point, landmark) in points.iter().zip(&mini.landmarks) {
            let off = point.position.distance(*landmark - log.origin);
            // Argoverse has 16-bit floats.
            assert!(off < if name == "Argoverse 2" { 0.02 } else { 1e-4 }, "{name}: {off}");
            assert!((point.intensity - 0.25).abs() < 2e-3, "{name}");
        }
    }
}

#[test]
fn captures_are_read_by_the_readers_of_captures() {
    for (index, (name, _)) in MINI_LOGS.iter().enumerate() {
        let (folder, mini) = made(index);
        let log = open(&mini);
        let out = folder.path().join("capture");
        let summary = write(&log, &out);
        let has_boxes = *name != "KITTI odometry";
        let read = capture::read(&out, &CaptureOptions::default()).unwrap();
        read.check_trainable().unwrap();
        assert_eq!(read.views.len(), log.pictures.len());
        for picture in &log.pictures {
            let view =
                read.views.iter().position(|view| read.images.join(&view.file) == picture.file).unwrap();
            let camera = log.cameras[picture.camera].camera(&picture.world_from_camera);
            let own = read.views[view].camera;
            assert!(own.viewmat.abs_diff_eq(camera.viewmat, 1e-9), "{name}");
            assert_eq!((own.fx, own.cx, own.width), (camera.fx, camera.cx, camera.width));
            assert_eq!(read.photo(view).as_ref(), Some(&picture.file));
        }
        // Landmarks are where they are, and the other vehicle is not there.
        assert_eq!(summary.depth_maps, log.pictures.len(), "{name}");
        assert_eq!(summary.movers, usize::from(has_boxes), "{name}");
        assert!(summary.points > 20 && summary.points == read.points.len(), "{name} {summary:?}");
        for position in &read.points.positions {
            let position = DVec3::from(*position) + log.origin;
            let off = mini.landmarks.iter().map(|p| p.distance(position)).fold(f64::INFINITY, f64::min);
            let slack = if *name == "KITTI raw" { 0.6 } else { 0.03 };
            assert!(off < slack, "{name}: a point {off} m from every landmark");
        }
        let has_mask = read.views.iter().filter(|view| view.mask.is_some()).count();
        assert_eq!(has_mask, summary.masks);
        assert_eq!(summary.masks > 0, has_boxes, "{name}");
        let facts = std::fs::read_to_string(out.join("facts.toml")).unwrap();
        assert!(facts.contains("metres_per_unit = 1.0") && facts.contains("up = [0.0, 0.0, 1.0]"), "{facts}");
        assert_eq!(
            facts.contains("north = "),
            matches!(*name, "KITTI raw" | "nuScenes" | "Argoverse 2"),
            "{name}"
        );
    }
}

#[test]
fn points_have_the_colour_of_their_pixel_and_depth_their_distance() {
    let (folder, mini) = made(1);
    let log = open(&mini);
    let out = folder.path().join("capture");
    write(&log, &out);
    let read = capture::read(&out, &CaptureOptions::default()).unwrap();
    for (position, color) in read.points.positions.iter().zip(&read.points.colors) {
        let is_of = |picture: &&LogPicture| {
            let camera = log.cameras[picture.camera].camera(&picture.world_from_camera);
            let Some((x, y, _)) = camera.project(DVec3::from(*position)) else { return false };
            let is_within = (0.0..f64::from(SIZE.0)).contains(&x) && (0.0..f64::from(SIZE.1)).contains(&y);
            is_within && color_at(x as u32, y as u32) == *color
        };
        assert!(log.pictures.iter().find(is_of).is_some(), "{color:?}");
    }
    let picture = &log.pictures[2];
    let camera = log.cameras[0].camera(&picture.world_from_camera);
    let name = picture.file.strip_prefix("/").unwrap_or(&picture.file);
    let (map, shape) = wm_base::npy::read(&out.join("depth").join(name).with_extension("npy")).unwrap();
    assert_eq!(shape, [SIZE.1 as usize, SIZE.0 as usize]);
    let mut found = 0;
    for (landmark, pixel) in mini.landmarks.iter().zip(expected(&mini, &picture.file)) {
        let Some((x, y)) = pixel.filter(|(x, y)| (1.0..79.0).contains(x) && (1.0..59.0).contains(y)) else {
            continue;
        };
        let z = f64::from(map[y as usize * 80 + x as usize]);
        let (_, _, own) = camera.project(*landmark).unwrap();
        found += usize::from((z - own).abs() < 1e-3);
    }
    assert!(found >= 10, "{found}");
    let known = map.iter().filter(|z| **z > 0.0).count();
    assert!((found..=12 * found).contains(&known), "{known} {found}");
}

#[test]
fn masks_cover_the_other_vehicle() {
    let (folder, mini) = made(2);
    let log = open(&mini);
    let out = folder.path().join("capture");
    let summary = write(&log, &out);
    assert!(summary.masks >= FRAME_COUNT, "{}", summary.masks);
    let read = capture::read(&out, &CaptureOptions::default()).unwrap();
    let mut checked = 0;
    for picture in &log.pictures {
        let view = read.views.iter().position(|view| read.images.join(&view.file) == picture.file).unwrap();
        let middle = (mini.mover)(picture.timestamp) - log.origin;
        let Some((x, y)) = read.views[view]
            .project(middle)
            .filter(|(x, y)| (2.0..78.0).contains(x) && (2.0..58.0).contains(y))
        else {
            continue;
        };
        let mask = read.views[view].mask.clone().unwrap();
        let bytes = std::fs::read(mask).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut grey = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut grey).unwrap();
        assert_eq!(grey[y as usize * 80 + x as usize], 0);
        assert_eq!(grey[80 * 59 + 79], 255);
        checked += 1;
    }
    assert!(checked >= FRAME_COUNT, "{checked}");
}

#[test]
fn the_logs_own_masks_are_taken() {
    let (folder, mini) = made(4);
    let log = open(&mini);
    let out = folder.path().join("capture");
    let summary = write(&log, &out);
    assert_eq!((summary.masks, summary.sky_masks), (2 * FRAME_COUNT, 2 * FRAME_COUNT));
    assert!(summary.sky().is_some() && summary.depth().is_some());
}

#[test]
fn parts_of_a_log_are_asked_for() {
    let (_folder, mini) = made(2);
    let ask = |options: LogOptions| {
        let log = DrivingLog::open(&mini.path, &options);
        log.map(Option::unwrap).map_err(|e| e.to_string().replace(&mini.path.display().to_string(), "DIR"))
    };
    let usual = LogOptions::default();
    let log = ask(usual.clone()).unwrap();
    assert_eq!((log.name.as_str(), log.cameras.len()), ("scene-0002", 2));
    assert_eq!(
        log.warnings,
        ["scene-0002 is read, the first of 2 scenes: scene-0002, scene-0003; --log-scene names another"]
    );
    let log = ask(LogOptions { cameras: vec!["CAM_BACK".into()], stride: 2, ..usual.clone() }).unwrap();
    assert_eq!((log.cameras.len(), log.pictures.len()), (1, FRAME_COUNT.div_ceil(2)));
    let log = ask(LogOptions { most_pictures: 4, ..usual.clone() }).unwrap();
    assert_eq!(log.pictures.len(), 4);
    assert!(
        log.warnings.iter().any(|w| w == "4 of 12 pictures are taken, one in 3 of each camera"),
        "{:?}",
        log.warnings
    );
    assert_eq!(
        ask(LogOptions { scene: Some("scene-9".into()), ..usual.clone() }).unwrap_err(),
        "DIR/v1.0-mini/scene.json: there is no \"scene-9\" among its scenes; there are scene-0002, scene-0003"
    );
    assert_eq!(
        ask(LogOptions { cameras: vec!["CAM".into()], ..usual }).unwrap_err(),
        "DIR/v1.0-mini/sample_data.json: there is no camera \"CAM\"; its cameras are CAM_BACK, CAM_FRONT"
    );
}

#[test]
fn a_day_of_kitti_has_drives() {
    let (_folder, mini) = made(0);
    let day = mini.path.parent().unwrap();
    for scene in [None, Some("0001".to_owned()), Some("2011_09_26_drive_0001_sync".to_owned())] {
        let log = DrivingLog::open(day, &LogOptions { scene, ..LogOptions::default() }).unwrap().unwrap();
        assert_eq!(log.name, "2011_09_26_drive_0001_sync");
        assert!((log.location.unwrap()[0] - 49.0).abs() < 1e-9);
        // Its times have no zone.
        assert_eq!(log.captured, None);
    }
    let error =
        DrivingLog::open(day, &LogOptions { scene: Some("7".into()), ..LogOptions::default() }).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("there is no \"7\" among its drives; there are 2011_09_26_drive_0001_sync"),
        "{error}"
    );
}

#[test]
fn other_folders_are_no_logs() {
    let folder = tempdir().unwrap();
    assert!(DrivingLog::open(folder.path(), &LogOptions::default()).unwrap().is_none());
    assert!(DrivingLog::open(&folder.path().join("no"), &LogOptions::default()).unwrap().is_none());
}

#[test]
fn damaged_logs_are_errors_or_logs() {
    let logs: Vec<(TempDir, MiniLog, Vec<PathBuf>)> = (0..MINI_LOGS.len())
        .map(|index| {
            let (folder, mini) = made(index);
            let mut files = Vec::new();
            let mut folders = vec![folder.path().to_owned()];
            while let Some(folder) = folders.pop() {
                for entry in std::fs::read_dir(folder).unwrap() {
                    let path = entry.unwrap().path();
                    let is_photo = path.extension().is_some_and(|extension| extension == "jpg");
                    match path.is_dir() {
                        true => folders.push(path),
                        false if is_photo => {}
                        false => files.push(path),
                    }
                }
            }
            files.sort();
            (folder, mini, files)
        })
        .collect();
    let edits = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4);
    proptest!(|(log in 0..MINI_LOGS.len(), file: prop::sample::Index, edits in edits, cut: Option<prop::sample::Index>)| {
        let (_, mini, files) = &logs[log];
        let file = &files[file.index(files.len())];
        let whole = std::fs::read(file).unwrap();
        let mut bytes = whole.clone();
        for (at, byte) in edits {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(cut.map_or(bytes.len(), |cut| cut.index(bytes.len())));
        std::fs::write(file, bytes).unwrap();
        let opened = DrivingLog::open(&mini.path, &LogOptions::default()).map_err(|e| e.to_string());
        let read = opened.and_then(|log| {
            let mut sweeps = log.into_iter().flat_map(|log| log.sweeps);
            sweeps.try_for_each(|sweep| sweep.points().map(drop)).map_err(|e| e.to_string())
        });
        std::fs::write(file, whole).unwrap();
        if let Err(message) = read {
            prop_assert!(!message.contains('\n'), "{}", message);
        }
    });
}

#[test]
fn faults_are_told_in_one_line() {
    for (index, file, text, says) in [
        (0, "../calib_velo_to_cam.txt", None, "no such file"),
        (
            0,
            "oxts/data/0000000002.txt",
            Some("49 x 1 0 0 0"),
            "0000000002.txt, line 1: \"x\" is not a finite number",
        ),
        (1, "times.txt", Some("0\n0.1 2\n"), "times.txt, line 2: a line must be one time, seconds"),
        (2, "v1.0-mini/ego_pose.json", Some("[{]"), "ego_pose.json, line 1, column 3: key must be a string"),
        (3, "annotations.feather", Some("ARROW1"), "annotations.feather, byte 0: no Feather file"),
        (4, "extrinsics/0.txt", Some("1 2 3"), "0.txt: a pose has 12 or 16 numbers, not 3"),
    ] {
        let (_folder, mini) = made(index);
        let file = mini.path.join(file);
        text.map_or_else(|| std::fs::remove_file(&file), |text| std::fs::write(&file, text)).unwrap();
        let error = DrivingLog::open(&mini.path, &LogOptions::default()).unwrap_err().to_string();
        assert!(error.contains(says) && !error.contains('\n'), "{error}");
    }
}
