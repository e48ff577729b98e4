//! The synthetic set, read back by code that knows the files alone.

use crate::testing::{self, MemorySink, SPOT};
use crate::{ClipRecord, SensorInfoKind, SetInfo};
use glam::{DVec3, DVec4};
use std::collections::BTreeMap;

fn written(layout: &str, frames: u32) -> BTreeMap<String, Vec<u8>> {
    testing::written(testing::layout(layout), frames)
}

fn text<'a>(files: &'a BTreeMap<String, Vec<u8>>, path: &str) -> &'a str {
    let bytes = files.get(path).unwrap_or_else(|| panic!("{path} is missing"));
    std::str::from_utf8(bytes).unwrap()
}

/// The numbers of a key of a file.
fn numbers(text: &str, key: &str) -> Vec<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(&format!("{key}: "))).unwrap();
    line.split(' ').map(|number| number.parse().unwrap()).collect()
}

/// Multiplies 3x4 rows by a point.
fn apply(rows: &[f64], point: DVec3) -> DVec3 {
    let row = |k: usize| DVec4::from_slice(&rows[4 * k..]).dot(point.extend(1.0));
    DVec3::new(row(0), row(1), row(2))
}

/// The first point of a file, which is the spot.
fn spot(bytes: &[u8]) -> DVec3 {
    let value = |k: usize| f64::from(f32::from_le_bytes(bytes[4 * k..4 * k + 4].try_into().unwrap()));
    DVec3::new(value(0), value(1), value(2))
}

/// Checks that the spot has the pixels that the cameras of the set give it, where it is before
/// them; returns the cameras' numbers.
fn check_pixels(frame: u32, of: &dyn Fn(usize) -> DVec3) -> Vec<usize> {
    let set = testing::set();
    let readings = testing::readings(&set);
    let is_before = |(sensor, slot): &(usize, usize)| {
        let info = readings.iter().find(|info| info.sensor == *sensor && info.frame == frame).unwrap();
        let point = testing::spot_in(&set, info);
        let camera = set.sensors[*sensor].camera().unwrap();
        if point.z < 1.0 {
            return false;
        }
        let (expected, found) = (testing::project(camera, point), of(*slot));
        for k in 0..2 {
            assert!((found[k] / found.z + 0.5 - expected[k]).abs() < 1e-3, "camera {slot}, frame {frame}");
        }
        true
    };
    [(0, 2), (1, 3), (2, 1)].into_iter().filter(is_before).map(|(_, slot)| slot).collect()
}

#[test]
fn raw_points_are_seen_where_pictures_show_them() {
    let files = written("kitti-raw", 8);
    let day = "2023_11_14";
    let rigid = text(&files, &format!("{day}/calib_velo_to_cam.txt"));
    let (r, t) = (numbers(rigid, "R"), numbers(rigid, "T"));
    let tr = [&r[0..3], &t[0..1], &r[3..6], &t[1..2], &r[6..9], &t[2..3]].concat();
    let cameras = text(&files, &format!("{day}/calib_cam_to_cam.txt"));
    let mut seen = Vec::new();
    for frame in 0..testing::FRAMES_PER_CLIP {
        let point =
            spot(&files[&format!("{day}/{day}_drive_0001_sync/velodyne_points/data/{frame:010}.bin")]);
        let project = |slot: usize| apply(&numbers(cameras, &format!("P_rect_{slot:02}")), apply(&tr, point));
        seen.extend(check_pixels(frame, &project));
        // K (R x + T) is the same camera.
        let by_parts = |slot: usize| {
            let [k, r, t] = ["K", "R", "T"].map(|key| numbers(cameras, &format!("{key}_{slot:02}")));
            let times = |m: &[f64], v: DVec3| {
                DVec3::from_array([0, 1, 2].map(|row| DVec3::from_slice(&m[3 * row..]).dot(v)))
            };
            times(&k, times(&r, apply(&tr, point)) + DVec3::from_slice(&t))
        };
        check_pixels(frame, &by_parts);
    }
    assert!([1, 2, 3].iter().all(|slot| seen.contains(slot)), "{seen:?}");
    assert_eq!(text(&files, &format!("{day}/{day}_drive_0000_sync/oxts/timestamps.txt")).lines().count(), 20);
    let times = text(&files, &format!("{day}/{day}_drive_0001_sync/image_03/timestamps.txt"));
    assert!(times.starts_with("2023-11-14 22:14:20.000000000\n2023-11-14 22:14:20.100000000\n"), "{times}");
    assert_eq!(files.len(), 3 + 2 * (20 * 5 + 3 + 3 + 1));
}

#[test]
fn sequences_hold_points_poses_and_classes() {
    let files = written("kitti-odometry", 8);
    let set = testing::set();
    let calibration = text(&files, "sequences/01/calib.txt");
    let tr = numbers(calibration, "Tr");
    let poses: Vec<Vec<f64>> = text(&files, "poses/01.txt")
        .lines()
        .map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect())
        .collect();
    assert_eq!((poses.len(), poses[0].len()), (20, 12));
    let readings = testing::readings(&set);
    let first = readings[0].world_from_sensor(&set);
    for frame in 0..testing::FRAMES_PER_CLIP {
        let point = spot(&files[&format!("sequences/01/velodyne/{frame:06}.bin")]);
        let in_camera = apply(&tr, point);
        check_pixels(frame, &|slot| apply(&numbers(calibration, &format!("P{slot}")), in_camera));
        // The spot is where it is.
        let world = first.point(apply(&poses[frame as usize], in_camera));
        assert!(world.distance(SPOT) < 1e-5, "{world}");
    }
    assert_eq!(text(&files, "sequences/00/times.txt").lines().nth(3), Some("3.000000000e-1"));
    let semantic = written("semantic-kitti", 8);
    let of = |files: &BTreeMap<String, Vec<u8>>| {
        let bytes = &files["sequences/01/labels/000019.label"];
        bytes.chunks(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect::<Vec<u32>>()
    };
    let labels = of(&semantic);
    // Labels go round nothing, road and building; point 20 is a drop and point 40 a flake.
    assert_eq!((labels.len(), &labels[..4], labels[20], labels[40]), (60, &[0, 40, 50, 0][..], 1, 1));
    let wads = of(&written("wads", 8));
    assert_eq!((wads[40], &wads[..40], &wads[41..]), (110, &labels[..40], &labels[41..]));
    for path in ["sequences/01/velodyne/000007.bin", "sequences/01/calib.txt", "splits.json"] {
        assert_eq!(semantic[path], files[path], "{path}");
    }
    assert_eq!(semantic["sequences/01/poses.txt"], files["poses/01.txt"]);
}

#[test]
fn frames_of_objects_are_numbered_over_all_clips() {
    let files = written("kitti-object", 8);
    assert_eq!(text(&files, "ImageSets/val.txt").lines().next(), Some("000020"));
    assert_eq!(text(&files, "ImageSets/trainval.txt").lines().count(), 40);
    for frame in 0..testing::FRAMES_PER_CLIP {
        let calibration = text(&files, &format!("training/calib/{:06}.txt", 20 + frame));
        let tr = numbers(calibration, "Tr_velo_to_cam");
        let point = spot(&files[&format!("training/velodyne/{:06}.bin", 20 + frame)]);
        check_pixels(frame, &|slot| apply(&numbers(calibration, &format!("P{slot}")), apply(&tr, point)));
        assert!(files[&format!("training/label_2/{:06}.txt", 20 + frame)].is_empty());
    }
    assert_eq!(files.len(), 40 * 6 + 4);
}

#[test]
fn clips_of_objects_that_are_not_equally_long_are_refused() {
    let (set, clips) = (testing::set(), testing::clips());
    let readings = testing::readings(&set);
    let mut records = clips.into_iter().map(|mut clip| {
        clip.seconds += clip.number as f64;
        Ok(ClipRecord { clip, readings: readings.clone() })
    });
    let mut files = MemorySink::default();
    let error = (testing::layout("kitti-object").tables)(&set, &mut records, &mut files).unwrap_err();
    let line = error.to_string();
    assert!(
        line.contains("\"000001-bend-snow\" has 30 frames") && line.ends_with("make all clips equally long"),
        "{line}"
    );
}

#[test]
fn files_do_not_depend_on_blocks() {
    for layout in ["kitti-raw", "kitti-object"] {
        assert!(written(layout, 1) == written(layout, 20), "{layout}");
    }
}

#[test]
fn sets_that_do_not_fit_are_refused_with_a_remedy() {
    let refusal = |layout: &str, change: fn(&mut SetInfo)| {
        let mut set = testing::set();
        change(&mut set);
        (testing::layout(layout).check)(&set).map_err(|error| error.to_string()).unwrap_err()
    };
    type Change = fn(&mut SetInfo);
    let changes: [(&str, Change, &str); 10] = [
        ("kitti-raw", |set| add_two_sensors(set, 0), "has 5: leave cameras out"),
        ("kitti-object", |set| add_two_sensors(set, 3), "has 3: leave lidars out"),
        ("kitti-object", |set| drop(set.sensors.drain(..3)), "needs a camera"),
        ("wads", |set| drop(set.sensors.remove(3)), "needs a lidar"),
        ("kitti-odometry", |set| set.sensors[1].rate = 12.0, "\"left\" has 12 Hz and frames 10 Hz"),
        ("kitti-odometry", |set| set.sensors[3].rate = 5.0, "\"top\" has 5 Hz"),
        ("semantic-kitti", lens, "camera \"front\" has a lens"),
        ("nuscenes", lens, "camera \"front\" has a lens"),
        ("nuscenes", |set| set.sensors[4].rate = 1.0, "\"bumper\" has 1 Hz and samples 2 Hz"),
        ("nuscenes", |set| add_two_sensors(set, 0), "two sensors would be channel CAM_FRONT"),
    ];
    for (layout, change, words) in changes {
        let line = refusal(layout, change);
        assert!(line.starts_with(&format!("layout {layout}: ")) && line.contains(words), "{line}");
        assert!(!line.contains('\n'));
    }
}

/// Adds two more of a sensor.
fn add_two_sensors(set: &mut SetInfo, index: usize) {
    let sensor = set.sensors[index].clone();
    set.sensors.extend([sensor.clone(), sensor]);
}

fn lens(set: &mut SetInfo) {
    if let SensorInfoKind::Camera(camera) = &mut set.sensors[0].kind {
        camera.lens = Some(wm_scene::LensModel::Equirectangular);
    }
}
