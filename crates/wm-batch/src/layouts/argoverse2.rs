//! Argoverse 2's sensor data set: one folder a log, tables as Feather (Arrow's file format), photos
//! as JPEG.
//!
//! `SPLIT/CLIP/` has `sensors/lidar/NS.feather`, `sensors/cameras/NAME/NS.jpg`,
//! `city_SE3_egovehicle.feather`, `calibration/{egovehicle_SE3_sensor,intrinsics}.feather` and an
//! `annotations.feather` without rows, since nothing in a scene has a box.
//!
//! - Times are nanoseconds since 1970. There is a pose for each of them: `city_SE3_egovehicle` is
//!   `world_from_rig`.
//! - Points are in the rig's axes at the start of the sweep, m, rounded to 16-bit floats as in the
//!   real logs: to 0.03 m beyond 32 m and to 0.06 m beyond 64 m. `intensity` is 0 to 255,
//!   `laser_number` the ring, `offset_ns` counts from the start.
//! - Cameras have OpenCV's axes. The first pixel's centre is at (0, 0), as the readers of `av2`
//!   0.3.6 index pictures (they round a projected point to its pixel), so `cx_px` and `cy_px` are
//!   0.5 less than ours. Lenses have k1, k2 and k3.
//! - A camera has the name of the ring camera that looks the same way within 25 degrees if no other
//!   camera does, else its own.
//! - The lidar is `up_lidar`; readers ask for a `down_lidar` too, which gets the same pose and no
//!   points.
//! - Radars have no place and are left out. So are maps, so `SensorDataloader` cannot read these
//!   logs; `AV2SensorDataLoader` and `av2.torch`'s `DetectionDataLoader` can, the latter with
//!   pictures only if the rig has all seven ring cameras.
//!
//! Source: the public API (github.com/argoverse/av2-api, MIT) and a real log.

use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, distortion, picture, refuse, wxyz_and_translation};
use crate::{
    BlockInfo, ClipRecord, DatasetPoint, ReadingData, SensorInfo, SensorInfoKind, SensorReading, SetError,
    SetInfo, picture_files,
};
use glam::{DVec3, Vec3};
use half::f16;
use std::path::PathBuf;
use wm_capture::feather::{FeatherColumn, feather};

const NAME: &str = "argoverse2";

/// The ring cameras and the way they look, degrees from x forward towards y left.
const RING_CAMERAS_DEG: [(&str, f64); 7] = [
    ("ring_front_center", 0.0),
    ("ring_front_left", 45.0),
    ("ring_side_left", 99.0),
    ("ring_rear_left", 153.0),
    ("ring_rear_right", -153.0),
    ("ring_side_right", -99.0),
    ("ring_front_right", -45.0),
];

/// Largest angle between a camera and the ring camera that names it, degrees.
const RING_TOLERANCE_DEG: f64 = 25.0;

/// The names of the two lidars.
const LIDARS: [&str; 2] = ["up_lidar", "down_lidar"];

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "Argoverse 2 sensor logs: Feather tables and JPEG; without radars, boxes and maps",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| check(set).map_err(|problem| refuse(NAME, problem)),
    block,
    tables,
};

fn check(set: &SetInfo) -> Result<(), String> {
    let lidars: Vec<_> = lidars(set).collect();
    if lidars.len() > 1 {
        let names = lidars.iter().map(|(sensor, _)| sensor.name.as_str()).collect::<Vec<_>>().join(", ");
        return Err(format!("it holds one lidar and the rig has {names}; keep one of them"));
    }
    if let Some((sensor, rings)) = lidars.iter().find(|(_, rings)| *rings > 256) {
        let name = &sensor.name;
        return Err(format!("lidar \"{name}\" has {rings} rings; choose a model with at most 256"));
    }
    if lidars.is_empty() && cameras(set).next().is_none() {
        return Err("the rig has neither a camera nor a lidar; add one".into());
    }
    for (_, sensor, camera) in cameras(set) {
        let name = &sensor.name;
        let Some([_, _, p1, p2, _]) = distortion(camera) else {
            return Err(format!("camera \"{name}\" is no pinhole with distortion; change its lens"));
        };
        if p1 != 0.0 || p2 != 0.0 {
            return Err(format!("it has no place for p1 and p2 of camera \"{name}\"; set them to 0"));
        }
        if camera.size.0.max(camera.size.1) > u32::from(u16::MAX) {
            return Err(format!("camera \"{name}\" has a side of more than 65535 px; make it smaller"));
        }
    }
    Ok(())
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    let (poses, intrinsics) = (calibration(set), intrinsics(set));
    for record in clips {
        let ClipRecord { clip, readings } = record?;
        let folder = clip.folder();
        let mut times: Vec<_> =
            readings.iter().map(|info| (info.timestamp(&clip), info.world_from_rig)).collect();
        times.sort_by_key(|(time, _)| *time);
        times.dedup_by_key(|(time, _)| *time);
        let stamps = FeatherColumn::new("timestamp_ns", times.iter().map(|(time, _)| *time));
        let rows: Vec<_> = times.iter().map(|(_, pose)| wxyz_and_translation(pose)).collect();
        let columns: Vec<_> = [stamps].into_iter().chain(pose_columns(&rows)).collect();
        write(files, format!("{folder}/city_SE3_egovehicle.feather"), &columns)?;
        write(files, format!("{folder}/calibration/egovehicle_SE3_sensor.feather"), &poses)?;
        write(files, format!("{folder}/calibration/intrinsics.feather"), &intrinsics)?;
        write(files, format!("{folder}/annotations.feather"), &annotations())?;
    }
    Ok(())
}

/// Lidars with their rings.
fn lidars(set: &SetInfo) -> impl Iterator<Item = (&SensorInfo, u16)> {
    set.sensors.iter().filter_map(|sensor| match sensor.kind {
        SensorInfoKind::Lidar { rings, .. } => Some((sensor, rings)),
        _ => None,
    })
}

/// The names of the cameras in files, by sensor; empty for other sensors.
fn camera_names(set: &SetInfo) -> Vec<String> {
    let mut names = vec![String::new(); set.sensors.len()];
    let has_own = cameras(set).any(|(_, s, _)| s.name.starts_with("ring_") || s.name.starts_with("stereo_"));
    let places: Vec<_> = cameras(set)
        .map(|(index, sensor, _)| {
            let ahead = sensor.rig_from_sensor.rotation * DVec3::Z;
            let yaw = ahead.y.atan2(ahead.x).to_degrees();
            let near = |(_, other): &&(&str, f64)| (yaw - other + 540.0).rem_euclid(360.0) - 180.0;
            let place = RING_CAMERAS_DEG
                .iter()
                .find(|ring| near(ring).abs() <= RING_TOLERANCE_DEG)
                .map(|(name, _)| *name);
            (index, sensor, place)
        })
        .collect();
    for (index, sensor, place) in &places {
        let is_alone = places.iter().filter(|(_, _, other)| other == place).count() == 1;
        names[*index] = match place {
            Some(place) if is_alone && !has_own => (*place).into(),
            _ => sensor.name.clone(),
        };
    }
    names
}

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    let names = camera_names(set);
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let (folder, time) = (clip.folder(), reading.info.timestamp(clip));
        if let Some((sensor, camera, picture)) = picture(set, reading) {
            let bytes = picture_files::jpeg(sensor, camera, picture.rgb)?;
            let name = &names[reading.info.sensor];
            files.write(&format!("{folder}/sensors/cameras/{name}/{time}.jpg"), &bytes)?;
        }
        if let ReadingData::Points(points) = reading.data {
            let columns = sweep(&set.sensors[reading.info.sensor], points);
            write(files, format!("{folder}/sensors/lidar/{time}.feather"), &columns)?;
        }
        Ok(())
    })
}

/// The columns of a sweep.
fn sweep(sensor: &SensorInfo, points: &[DatasetPoint]) -> Vec<FeatherColumn> {
    let positions: Vec<DVec3> = points
        .iter()
        .map(|point| sensor.rig_from_sensor.point(Vec3::from_array(point.position).as_dvec3()))
        .collect();
    let axis = |name, k: usize| {
        FeatherColumn::new(name, positions.iter().map(|position| f16::from_f64(position[k])))
    };
    let intensity = points.iter().map(|point| point.intensity.round() as u8);
    let offset = points.iter().map(|point| (f64::from(point.time) * 1e9).round() as i32);
    vec![
        axis("x", 0),
        axis("y", 1),
        axis("z", 2),
        FeatherColumn::new("intensity", intensity),
        FeatherColumn::new("laser_number", points.iter().map(|point| point.ring as u8)),
        FeatherColumn::new("offset_ns", offset),
    ]
}

/// Columns of poses: rotation and translation.
fn pose_columns(rows: &[[f64; 7]]) -> impl Iterator<Item = FeatherColumn> {
    let names = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];
    names.into_iter().enumerate().map(|(k, name)| FeatherColumn::new(name, rows.iter().map(|row| row[k])))
}

/// The table of the sensors' poses.
fn calibration(set: &SetInfo) -> Vec<FeatherColumn> {
    let names = camera_names(set);
    let mut rows: Vec<(String, [f64; 7])> = cameras(set)
        .map(|(index, sensor, _)| (names[index].clone(), wxyz_and_translation(&sensor.rig_from_sensor)))
        .collect();
    for (sensor, _) in lidars(set) {
        rows.extend(LIDARS.map(|name| (name.to_owned(), wxyz_and_translation(&sensor.rig_from_sensor))));
    }
    let (names, poses): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
    let names = FeatherColumn::new("sensor_name", names.iter().map(String::as_str));
    [names].into_iter().chain(pose_columns(&poses)).collect()
}

/// The table of the cameras' intrinsics.
fn intrinsics(set: &SetInfo) -> Vec<FeatherColumn> {
    let names = camera_names(set);
    let numbers = |name, of: &dyn Fn(&crate::CameraInfo) -> f64| {
        FeatherColumn::new(name, cameras(set).map(|(_, _, camera)| of(camera)))
    };
    let lens = |name, k: usize| numbers(name, &|camera| distortion(camera).map_or(0.0, |lens| lens[k]));
    let side = |name, of: &dyn Fn(&crate::CameraInfo) -> u32| {
        FeatherColumn::new(name, cameras(set).map(|(_, _, camera)| of(camera) as u16))
    };
    vec![
        FeatherColumn::new("sensor_name", cameras(set).map(|(index, _, _)| names[index].as_str())),
        numbers("fx_px", &|camera| camera.focal[0]),
        numbers("fy_px", &|camera| camera.focal[1]),
        numbers("cx_px", &|camera| camera.center[0] - 0.5),
        numbers("cy_px", &|camera| camera.center[1] - 0.5),
        lens("k1", 0),
        lens("k2", 1),
        lens("k3", 4),
        side("height_px", &|camera| camera.size.1),
        side("width_px", &|camera| camera.size.0),
    ]
}

/// The table of boxes, without rows.
fn annotations() -> Vec<FeatherColumn> {
    let numbers = |name| FeatherColumn::new(name, [0i64; 0]);
    let words = |name| FeatherColumn::new(name, [""; 0]);
    let mut columns = vec![numbers("timestamp_ns"), words("track_uuid"), words("category")];
    for name in ["length_m", "width_m", "height_m", "qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"] {
        columns.push(FeatherColumn::new(name, [0.0f64; 0]));
    }
    columns.push(numbers("num_interior_pts"));
    columns
}

/// Writes a table.
fn write(files: &mut dyn FileSink, path: String, columns: &[FeatherColumn]) -> Result<(), SetError> {
    let bytes = feather(columns)
        .map_err(|error| SetError::Write { path: PathBuf::from(&path), problem: error.to_string() })?;
    files.write(&path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, SPOT};
    use glam::DQuat;
    use std::collections::BTreeMap;
    use wm_capture::feather::FeatherTable;

    const POSE: [&str; 7] = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];

    fn table(files: &BTreeMap<String, Vec<u8>>, path: &str, names: &[&str]) -> FeatherTable {
        FeatherTable::read(&files[path], names).unwrap()
    }

    /// The rows of columns of numbers.
    fn rows<const N: usize>(table: &mut FeatherTable, names: [&str; N]) -> Vec<[f64; N]> {
        let columns = names.map(|name| table.floats(name).unwrap());
        (0..columns[0].len()).map(|row| columns.each_ref().map(|column| column[row])).collect()
    }

    fn poses(table: &mut FeatherTable) -> Vec<crate::RigidPose> {
        let pose = |[w, x, y, z, tx, ty, tz]: [f64; 7]| crate::RigidPose {
            rotation: DQuat::from_xyzw(x, y, z, w),
            translation: DVec3::new(tx, ty, tz),
        };
        rows(table, POSE).into_iter().map(pose).collect()
    }

    #[test]
    fn the_spot_is_where_tables_say() {
        let files = testing::written(&LAYOUT, 8);
        let (set, clip) = (testing::set(), &testing::clips()[0]);
        let log = clip.folder();
        let named = |name| [&[name], &POSE[..]].concat();
        let mut track = table(&files, &format!("{log}/city_SE3_egovehicle.feather"), &named("timestamp_ns"));
        let (stamps, world_from_rig) = (track.ints("timestamp_ns").unwrap(), poses(&mut track));
        assert_eq!(stamps.len(), testing::FRAMES_PER_CLIP as usize);
        let path = format!("{log}/calibration/egovehicle_SE3_sensor.feather");
        let mut sensors = table(&files, &path, &named("sensor_name"));
        let (names, rig_from_sensor) = (sensors.texts("sensor_name").unwrap(), poses(&mut sensors));
        let k = ["fx_px", "fy_px", "cx_px", "cy_px"];
        let intrinsics = rows(&mut table(&files, &format!("{log}/calibration/intrinsics.feather"), &k), k);
        assert_eq!(
            names,
            ["ring_front_center", "ring_front_left", "ring_front_right", "up_lidar", "down_lidar"]
        );
        let mut seen = testing::SpotCount::default();
        for info in testing::readings(&set) {
            let row = info.frame as usize;
            let stamp = stamps[row];
            assert_eq!(stamp, info.timestamp(clip));
            let spot = world_from_rig[row].inverse().point(SPOT);
            if set.sensors[info.sensor].camera().is_some() {
                let local = rig_from_sensor[info.sensor].inverse().point(spot);
                let [fx, fy, cx, cy] = intrinsics[info.sensor];
                let pixel = [fx * local.x / local.z + cx + 0.5, fy * local.y / local.z + cy + 0.5];
                seen.add(&set, &info, pixel);
                let name = &names[info.sensor];
                let picture = &files[&format!("{log}/sensors/cameras/{name}/{stamp}.jpg")];
                assert!(picture.starts_with(&[0xff, 0xd8]));
            } else if set.sensors[info.sensor].is_lidar() {
                let axes = ["x", "y", "z"];
                let path = format!("{log}/sensors/lidar/{stamp}.feather");
                let points = rows(&mut table(&files, &path, &axes), axes);
                assert_eq!(points.len(), 60);
                for k in 0..3 {
                    let value = points[0][k];
                    // Half a step of 16-bit floats below 32.
                    assert!((value - spot[k]).abs() < 0.5 / 64.0 + 1e-4, "{value} is not {}", spot[k]);
                }
            }
        }
    }

    #[test]
    fn cameras_that_look_the_same_way_keep_their_names() {
        let mut set = testing::set();
        set.sensors[1].rig_from_sensor = set.sensors[0].rig_from_sensor;
        assert_eq!(camera_names(&set)[..3], ["front", "left", "ring_front_right"]);
    }

    #[test]
    fn what_it_cannot_hold_is_refused() {
        let mut set = testing::set();
        set.sensors.push(set.sensors[3].clone());
        let says = |set: &SetInfo| check(set).unwrap_err();
        assert!(says(&set).contains("keep one"), "{}", says(&set));
        let mut set = testing::set();
        let SensorInfoKind::Camera(camera) = &mut set.sensors[0].kind else { unreachable!() };
        camera.lens = Some(wm_scene::LensModel::Equirectangular);
        assert!(says(&set).contains("change its lens"), "{}", says(&set));
    }
}
