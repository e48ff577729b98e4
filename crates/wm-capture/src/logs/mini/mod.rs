//! Small logs of every format, for tests and for damage: a vehicle that drives past landmarks and
//! behind another one.
//!
//! The files are written from the formats' definitions, by matrices, and not by what the readers
//! are made of; but for Feather, whose writer and reader are each held against other programs'
//! files.

use crate::feather::{FeatherColumn, feather, feather_packed};
use glam::{DMat3, DMat4, DQuat, DVec3, DVec4, dvec3};
use half::f16;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use wm_image::jpeg::{SamplingFactor, encode};

/// Width and height of the photos, px.
pub(crate) const SIZE: (u32, u32) = (80, 60);
/// Frames, a tenth of a second apart.
pub(crate) const FRAME_COUNT: usize = 6;
/// The time of the first frame.
const START_NS: i64 = 1_317_042_145_000_000_000;
/// The world's place in the log's coordinates, m.
const WORLD_ORIGIN: DVec3 = dvec3(5172.0, 2419.0, 66.0);
const FOCAL_PX: f64 = 50.0;
/// The principal point, as logs count it: the middle of the first pixel is 0.
const PRINCIPAL_POINT_PX: [f64; 2] = [39.0, 28.0];

/// The places of landmarks in a photo, px from the corner of the first pixel; `None` behind the
/// camera.
pub type MiniPixels = Vec<Option<(f64, f64)>>;

/// A log, and what is true of it.
pub struct MiniLog {
    /// The folder to open.
    pub path: PathBuf,
    /// The landmarks, in the log's coordinates, m.
    pub landmarks: Vec<DVec3>,
    /// By the end of a photo's path, where the landmarks are in it.
    pub photos: Vec<(String, MiniPixels)>,
    /// The middle of the other vehicle at a time, ns, in the log's coordinates.
    pub mover: fn(i64) -> DVec3,
}

/// A writer of a small log.
pub type MiniWriter = fn(&Path) -> io::Result<MiniLog>;

/// A writer for each format, in the order of [`super::LOG_FORMATS`], and one more for each form of
/// drivestudio.
pub const MINI_LOGS: [(&str, MiniWriter); 6] = [
    ("KITTI raw", kitti_raw),
    ("KITTI odometry", kitti_odometry),
    ("nuScenes", nuscenes),
    ("Argoverse 2", argoverse),
    ("drivestudio", |folder| drivestudio(folder, true)),
    ("drivestudio", |folder| drivestudio(folder, false)),
];

fn seconds(time: i64) -> f64 {
    (time - START_NS) as f64 * 1e-9
}

/// `world_from_rig` in the mini world.
fn rig(time: i64) -> DMat4 {
    let t = seconds(time);
    DMat4::from_rotation_translation(DQuat::from_rotation_z(0.1 + 0.15 * t), dvec3(5.0 * t, 1.0 * t, 0.1 * t))
}

fn rig_from_lidar() -> DMat4 {
    DMat4::from_rotation_translation(DQuat::from_rotation_z(0.05), dvec3(0.9, 0.05, 1.7))
}

/// OpenCV's axes, turned to the left by an angle.
fn rig_from_camera(angle: f64) -> DMat4 {
    let axes = DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X);
    DMat4::from_rotation_translation(
        DQuat::from_rotation_z(angle) * DQuat::from_mat3(&axes),
        dvec3(1.5, 0.1, 1.4),
    )
}

/// Landmarks in the mini world: none hides another.
fn landmarks() -> Vec<DVec3> {
    (0..80)
        .map(|k| {
            let angle = f64::from(k) * 0.6;
            let ring = 14.0 + 0.1 * f64::from(k % 7);
            dvec3(2.0 + ring * angle.cos(), ring * angle.sin(), 0.4 + 0.5 * f64::from(k % 6))
        })
        .collect()
}

/// The other vehicle in the mini world: it drives ahead.
fn mover(time: i64) -> DVec3 {
    dvec3(9.0 + 8.0 * seconds(time), 1.5, 0.9)
}

const MOVER_SIZE: DVec3 = dvec3(4.0, 1.8, 1.6);

fn mover_points(time: i64) -> Vec<DVec3> {
    (0..24)
        .map(|k| {
            mover(time)
                + (dvec3(f64::from(k % 4), f64::from(k / 4 % 3), f64::from(k / 12)) / 4.0 - 0.4) * MOVER_SIZE
        })
        .collect()
}

/// Landmarks and the other vehicle in the coordinates of a sensor.
fn swept(world_from_sensor: &DMat4, time: i64) -> impl Iterator<Item = DVec3> + use<> {
    let own = world_from_sensor.inverse();
    landmarks().into_iter().chain(mover_points(time)).map(move |p| own.transform_point3(p))
}

fn frame_time(frame: usize) -> i64 {
    START_NS + frame as i64 * 100_000_000
}

/// The projection of a camera with a shift in its last column.
fn projection(shift: DVec3) -> DMat4 {
    DMat4::from_cols_array_2d(&[
        [FOCAL_PX, 0.0, 0.0, 0.0],
        [0.0, FOCAL_PX, 0.0, 0.0],
        [PRINCIPAL_POINT_PX[0], PRINCIPAL_POINT_PX[1], 1.0, 0.0],
        [shift.x, shift.y, shift.z, 1.0],
    ])
}

/// The picture that a camera has of the landmarks.
fn landmark_pixels(camera_from_world: &DMat4, landmarks: &[DVec3]) -> MiniPixels {
    let k = projection(DVec3::ZERO);
    landmarks.iter().map(|point| pixel(*camera_from_world * point.extend(1.0), &k)).collect()
}

fn pixel(camera: DVec4, projection: &DMat4) -> Option<(f64, f64)> {
    let p = *projection * camera;
    // Half a pixel: counted from the corner.
    (p.z > 0.1).then(|| (p.x / p.z + 0.5, p.y / p.z + 0.5))
}

/// A photo whose colours are its pixels' places.
#[must_use]
pub(crate) fn color_at(x: u32, y: u32) -> [u8; 3] {
    [(3 * x) as u8, (4 * y) as u8, 90]
}

fn photo_bytes() -> Vec<u8> {
    (0..SIZE.1).flat_map(|y| (0..SIZE.0).flat_map(move |x| color_at(x, y))).collect()
}

fn write(path: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    fs::create_dir_all(path.parent().unwrap_or(path))?;
    fs::write(path, bytes)
}

fn write_photo(path: &Path) -> io::Result<()> {
    let bytes = if path.extension().is_some_and(|extension| extension == "png") {
        png_bytes(png::ColorType::Rgb, &photo_bytes())?
    } else {
        encode(&photo_bytes(), SIZE, 100, SamplingFactor::R_4_4_4).map_err(io::Error::other)?
    };
    write(path, bytes)
}

fn png_bytes(color: png::ColorType, bytes: &[u8]) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, SIZE.0, SIZE.1);
    encoder.set_color(color);
    encoder.write_header()?.write_image_data(bytes)?;
    Ok(out)
}

fn floats(values: impl IntoIterator<Item = f64>) -> Vec<u8> {
    values.into_iter().flat_map(|value| (value as f32).to_le_bytes()).collect()
}

/// Numbers of a matrix, row by row.
fn rows(matrix: &DMat4, count: usize) -> Vec<f64> {
    (0..count).flat_map(|row| matrix.row(row).to_array()).collect()
}

fn words(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn kitti_raw(folder: &Path) -> io::Result<MiniLog> {
    let day = folder.join("2011_09_26");
    let drive = day.join("2011_09_26_drive_0001_sync");
    let lidar_from_rig = rig_from_lidar().inverse();
    let cam0_from_lidar = rig_from_camera(0.0).inverse() * rig_from_lidar();
    let rectification = DMat4::from_rotation_x(0.01) * DMat4::from_rotation_y(-0.02);
    let r = |pose: &DMat4| words(&DMat3::from_mat4(*pose).transpose().to_cols_array());
    let rt = |pose: &DMat4| {
        let t = words(&pose.col(3).truncate().to_array());
        format!("calib_time: 15-Mar-2012 11:37:16\nR: {}\nT: {t}\n", r(pose))
    };
    write(&day.join("calib_imu_to_velo.txt"), rt(&lidar_from_rig))?;
    write(&day.join("calib_velo_to_cam.txt"), rt(&cam0_from_lidar))?;
    let projection = |camera: usize| {
        let number = camera as f64;
        projection(dvec3(-FOCAL_PX * 0.27 * number, 0.2 * number, 0.003 * number))
    };
    let mut calibration = format!(
        "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\nR_rect_00: {}\n",
        r(&rectification)
    );
    for camera in 0..4 {
        calibration += &format!("P_rect_0{camera}: {}\n", words(&rows(&projection(camera), 3)));
    }
    write(&day.join("calib_cam_to_cam.txt"), calibration)?;

    let stamp = |time: i64| format!("2011-09-26 13:02:{:012.9}\n", 25.0 + seconds(time));
    let lines =
        |shift: i64| (0..FRAME_COUNT).map(|frame| stamp(frame_time(frame) + shift)).collect::<String>();
    let (lat0, lon0) = (49.0f64.to_radians(), 8.4f64.to_radians());
    let scale = lat0.cos();
    let mercator = |latitude: f64| (0.25 * PI + 0.5 * latitude).tan().ln();
    let mut photos = Vec::new();
    let mut tracklets = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n<!DOCTYPE boost_serialization>\n\
         <boost_serialization version=\"9\">\n<tracklets class_id=\"0\">\n<count>1</count>\n<item>\n\
         <objectType>Car</objectType><h>{}</h><w>{}</w><l>{}</l><first_frame>0</first_frame>\n<poses>\n<count>{FRAME_COUNT}</count>\n",
        MOVER_SIZE.z, MOVER_SIZE.y, MOVER_SIZE.x
    );
    let first = rig(frame_time(0)).col(3).truncate();
    let origin = dvec3(scale * 6_378_137.0 * lon0, scale * 6_378_137.0 * mercator(lat0), 112.0) - first;
    for frame in 0..FRAME_COUNT {
        let pose = rig(frame_time(frame));
        let position = pose.col(3).truncate() - first;
        let longitude = lon0 + position.x / (scale * 6_378_137.0);
        let latitude = 2.0 * (mercator(lat0) + position.y / (scale * 6_378_137.0)).exp().atan() - 0.5 * PI;
        let yaw = 0.1 + 0.15 * seconds(frame_time(frame));
        let numbers = [latitude.to_degrees(), longitude.to_degrees(), 112.0 + position.z, 0.0, 0.0, yaw];
        let rest = "0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 4 11 6 6 6";
        write(&drive.join(format!("oxts/data/{frame:010}.txt")), format!("{} {rest}\n", words(&numbers)))?;
        for camera in [2, 3] {
            // The cameras are triggered a little later.
            let time = frame_time(frame) + 3_000_000 * i64::from(frame + 1 < FRAME_COUNT);
            let camera_from_world = rectification * cam0_from_lidar * lidar_from_rig * rig(time).inverse();
            let name = format!("image_0{camera}/data/{frame:010}.png");
            write_photo(&drive.join(&name))?;
            let pixels = landmarks()
                .iter()
                .map(|p| pixel(camera_from_world * p.extend(1.0), &projection(camera)))
                .collect();
            photos.push((name, pixels));
        }
        let mut points = Vec::new();
        for landmark in landmarks() {
            // A point is in the lidar's axes of its own time, which depends on its azimuth.
            let mut time = frame_time(frame);
            let mut own = DVec3::ZERO;
            for _ in 0..30 {
                own = (rig(time) * rig_from_lidar()).inverse().transform_point3(landmark);
                time = frame_time(frame) - 50_000_000 + ((own.y.atan2(own.x) + PI) / TAU * 1e8) as i64;
            }
            points.extend([own.x, own.y, own.z, 0.25]);
        }
        let lidar_from_world = (rig(frame_time(frame)) * rig_from_lidar()).inverse();
        for own in mover_points(frame_time(frame)).iter().map(|p| lidar_from_world.transform_point3(*p)) {
            points.extend([own.x, own.y, own.z, 0.25]);
        }
        let floor =
            lidar_from_world.transform_point3(mover(frame_time(frame)) - DVec3::Z * 0.5 * MOVER_SIZE.z);
        let angle = -(0.1 + 0.15 * seconds(frame_time(frame))) - 0.05;
        tracklets += &format!(
            "<item><tx>{}</tx><ty>{}</ty><tz>{}</tz><rx>0</rx><ry>0</ry><rz>{angle}</rz><state>2</state></item>\n",
            floor.x, floor.y, floor.z
        );
        write(&drive.join(format!("velodyne_points/data/{frame:010}.bin")), floats(points))?;
    }
    tracklets += "</poses>\n<finished>1</finished>\n</item>\n</tracklets>\n</boost_serialization>\n";
    write(&drive.join("tracklet_labels.xml"), tracklets)?;
    write(&drive.join("oxts/timestamps.txt"), lines(0))?;
    for camera in [2, 3] {
        let times = (0..FRAME_COUNT)
            .map(|frame| stamp(frame_time(frame) + 3_000_000 * i64::from(frame + 1 < FRAME_COUNT)))
            .collect::<String>();
        write(&drive.join(format!("image_0{camera}/timestamps.txt")), times)?;
    }
    for (name, shift) in [("", 0), ("_start", -50_000_000), ("_end", 50_000_000)] {
        write(&drive.join(format!("velodyne_points/timestamps{name}.txt")), lines(shift))?;
    }
    let landmarks = landmarks().into_iter().map(|p| p + origin).collect();
    Ok(MiniLog { path: drive, landmarks, photos, mover: |_| DVec3::ZERO })
}

fn kitti_odometry(folder: &Path) -> io::Result<MiniLog> {
    let sequence = folder.join("sequences/07");
    let cam0_from_lidar = rig_from_camera(0.0).inverse() * rig_from_lidar();
    let projection = |camera: usize| projection(dvec3(-FOCAL_PX * 0.27 * camera as f64, 0.0, 0.0));
    let mut calibration = String::new();
    for camera in 0..4 {
        calibration += &format!("P{camera}: {}\n", words(&rows(&projection(camera), 3)));
    }
    calibration += &format!("Tr: {}\n", words(&rows(&cam0_from_lidar, 3)));
    write(&sequence.join("calib.txt"), calibration)?;
    let world_from_cam0 =
        |frame: usize| rig(frame_time(frame)) * rig_from_lidar() * cam0_from_lidar.inverse();
    let (mut poses, mut times, mut photos) = (String::new(), String::new(), Vec::new());
    for frame in 0..FRAME_COUNT {
        poses += &format!("{}\n", words(&rows(&(world_from_cam0(0).inverse() * world_from_cam0(frame)), 3)));
        times += &format!("{:e}\n", seconds(frame_time(frame)));
        let name = format!("image_2/{frame:06}.png");
        write_photo(&sequence.join(&name))?;
        let camera_from_world = world_from_cam0(frame).inverse();
        let pixels =
            landmarks().iter().map(|p| pixel(camera_from_world * p.extend(1.0), &projection(2))).collect();
        photos.push((name, pixels));
        let points = swept(&(rig(frame_time(frame)) * rig_from_lidar()), frame_time(frame))
            .flat_map(|p| [p.x, p.y, p.z, 0.25]);
        write(&sequence.join(format!("velodyne/{frame:06}.bin")), floats(points))?;
        // Vegetation, and moving cars with a number of their own.
        let (fixed, moving) = (landmarks().len(), mover_points(frame_time(frame)).len());
        let labels = [vec![70u32; fixed], vec![7 << 16 | 252; moving]].concat();
        let labels: Vec<u8> = labels.into_iter().flat_map(u32::to_le_bytes).collect();
        write(&sequence.join(format!("labels/{frame:06}.label")), labels)?;
    }
    write(&sequence.join("times.txt"), times)?;
    write(&folder.join("poses/07.txt"), poses)?;
    // The world is the lidar of the first frame.
    let world = (rig(frame_time(0)) * rig_from_lidar()).inverse();
    let landmarks = landmarks().into_iter().map(|p| world.transform_point3(p)).collect();
    Ok(MiniLog { path: sequence, landmarks, photos, mover: |_| DVec3::ZERO })
}

/// A pose as nuScenes' tables and Argoverse's have it: w x y z and translation.
fn quaternion(pose: &DMat4) -> ([f64; 4], [f64; 3]) {
    let (_, q, t) = pose.to_scale_rotation_translation();
    ([q.w, q.x, q.y, q.z], t.to_array())
}

fn nuscenes(folder: &Path) -> io::Result<MiniLog> {
    use serde_json::{Value, json};
    let version = folder.join("v1.0-mini");
    let micro = |time: i64| time / 1000;
    let posed = |pose: &DMat4, mut record: Value| {
        let (rotation, translation) = quaternion(pose);
        record["rotation"] = json!(rotation);
        record["translation"] = json!(translation);
        record
    };
    let world = DMat4::from_translation(WORLD_ORIGIN);
    // The lidar's x is to the right.
    let lidar = rig_from_lidar() * DMat4::from_rotation_z(-0.5 * PI);
    let intrinsic =
        [[FOCAL_PX, 0.0, PRINCIPAL_POINT_PX[0]], [0.0, FOCAL_PX, PRINCIPAL_POINT_PX[1]], [0.0, 0.0, 1.0]];
    let cameras = [("CAM_FRONT", 0.0), ("CAM_BACK", PI)];
    let mut calibrated =
        vec![posed(&lidar, json!({"token": "c-lidar", "sensor_token": "s-lidar", "camera_intrinsic": []}))];
    let mut sensors = vec![
        json!({"token": "s-lidar", "channel": "LIDAR_TOP", "modality": "lidar"}),
        json!({"token": "s-radar", "channel": "RADAR_FRONT", "modality": "radar"}),
    ];
    for (name, angle) in cameras {
        sensors.push(json!({"token": format!("s-{name}"), "channel": name, "modality": "camera"}));
        let record = json!({"token": format!("c-{name}"), "sensor_token": format!("s-{name}"), "camera_intrinsic": intrinsic});
        calibrated.push(posed(&rig_from_camera(angle), record));
    }
    let (mut samples, mut data, mut poses, mut boxes, mut photos) = (vec![], vec![], vec![], vec![], vec![]);
    for frame in 0..FRAME_COUNT {
        let sample = format!("sample-{}", frame / 5);
        if frame % 5 == 0 {
            samples.push(json!({"token": sample, "scene_token": "scene-b", "timestamp": micro(frame_time(frame)), "prev": "", "next": ""}));
            for (instance, position, attribute) in [
                ("i-car", mover(frame_time(frame)), "a-moving"),
                ("i-parked", dvec3(3.0, -30.0, 0.9), "a-parked"),
            ] {
                let box_ = world * DMat4::from_translation(position);
                let size = [MOVER_SIZE.y, MOVER_SIZE.x, MOVER_SIZE.z];
                boxes.push(posed(
                    &box_,
                    json!({"token": format!("{instance}-{frame}"), "sample_token": sample, "instance_token": instance,
                           "attribute_tokens": [attribute], "size": size, "visibility_token": "4"}),
                ));
            }
        }
        let mut add = |sensor: &str, time: i64, file: &str, size: Value| {
            let token = format!("{sensor}-{frame}");
            poses.push(posed(&(world * rig(time)), json!({"token": token, "timestamp": micro(time)})));
            data.push(json!({"token": token, "sample_token": sample, "ego_pose_token": token,
                "calibrated_sensor_token": format!("c-{sensor}"), "timestamp": micro(time), "fileformat": "jpg",
                "is_key_frame": frame % 5 == 0, "height": size[1], "width": size[0], "filename": file, "prev": "", "next": ""}));
        };
        let kind = if frame % 5 == 0 { "samples" } else { "sweeps" };
        for (index, (name, angle)) in cameras.into_iter().enumerate() {
            let time = frame_time(frame) - 12_000_000 * (index as i64 + 1);
            let file = format!("{kind}/{name}/log__{name}__{}.jpg", micro(time));
            add(name, time, &file, json!([SIZE.0, SIZE.1]));
            write_photo(&folder.join(&file))?;
            let camera_from_world = (rig(time) * rig_from_camera(angle)).inverse();
            photos.push((file, landmark_pixels(&camera_from_world, &landmarks())));
        }
        let file = format!("{kind}/LIDAR_TOP/log__LIDAR_TOP__{}.pcd.bin", micro(frame_time(frame)));
        add("lidar", frame_time(frame), &file, json!([null, null]));
        let points = swept(&(rig(frame_time(frame)) * lidar), frame_time(frame))
            .flat_map(|p| [p.x, p.y, p.z, 64.0, 3.0]);
        write(&folder.join(file), floats(points))?;
    }
    data.push(json!({"token": "other", "sample_token": "of another scene", "ego_pose_token": "", "calibrated_sensor_token": "c-lidar",
        "timestamp": 0, "height": null, "width": null, "filename": "x"}));
    let scene = |(token, name)| json!({"token": token, "name": name, "log_token": "log", "description": ""});
    let instance = |token| json!({"token": token, "category_token": "k-car"});
    let attribute = |(token, name)| json!({"token": token, "name": name});
    let tables: [(&str, Vec<Value>); 11] = [
        ("scene", [("scene-b", "scene-0002"), ("scene-c", "scene-0003")].map(scene).to_vec()),
        ("log", vec![json!({"token": "log", "location": "boston-seaport", "vehicle": "n015"})]),
        ("sample", samples),
        ("sample_data", data),
        ("ego_pose", poses),
        ("sensor", sensors),
        ("calibrated_sensor", calibrated),
        ("sample_annotation", boxes),
        ("instance", ["i-car", "i-parked"].map(instance).to_vec()),
        ("category", vec![json!({"token": "k-car", "name": "vehicle.car", "description": ""})]),
        (
            "attribute",
            [("a-moving", "vehicle.moving"), ("a-parked", "vehicle.parked")].map(attribute).to_vec(),
        ),
    ];
    for (name, records) in tables {
        write(&version.join(format!("{name}.json")), serde_json::to_vec_pretty(&records)?)?;
    }
    let landmarks = landmarks().into_iter().map(|p| p + WORLD_ORIGIN).collect();
    Ok(MiniLog { path: folder.into(), landmarks, photos, mover: |time| mover(time) + WORLD_ORIGIN })
}

fn argoverse(folder: &Path) -> io::Result<MiniLog> {
    let log = folder.join("adcf7d18-0510-35b0-a2fa-b4cea13a6d76");
    let world = DMat4::from_translation(WORLD_ORIGIN);
    let posed = |poses: &[DMat4]| -> Vec<FeatherColumn> {
        let split: Vec<([f64; 4], [f64; 3])> = poses.iter().map(quaternion).collect();
        let names = ["qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"];
        let value =
            |(q, t): &([f64; 4], [f64; 3]), column: usize| if column < 4 { q[column] } else { t[column - 4] };
        let column = |(column, name): (usize, &'static str)| {
            FeatherColumn::new(name, split.iter().map(|row| value(row, column)))
        };
        names.into_iter().enumerate().map(column).collect()
    };
    let texts = |name, values: &[&str]| FeatherColumn::new(name, values.iter().copied());
    let cameras = [("ring_front_center", 0.0), ("ring_side_left", 1.2)];
    let names = ["ring_front_center", "ring_side_left", "up_lidar"];
    let mut table = vec![texts("sensor_name", &names)];
    table.extend(posed(&[rig_from_camera(0.0), rig_from_camera(1.2), rig_from_lidar()]));
    write(&log.join("calibration/egovehicle_SE3_sensor.feather"), feather_packed(&table)?)?;
    let same = |name, value: f64| FeatherColumn::new(name, [value; 2]);
    let intrinsics = [
        texts("sensor_name", &names[..2]),
        same("fx_px", FOCAL_PX),
        same("fy_px", FOCAL_PX),
        same("cx_px", PRINCIPAL_POINT_PX[0]),
        same("cy_px", PRINCIPAL_POINT_PX[1]),
        same("k1", -0.24),
        FeatherColumn::new("height_px", vec![SIZE.1 as u16; 2]),
        FeatherColumn::new("width_px", vec![SIZE.0 as u16; 2]),
    ];
    write(&log.join("calibration/intrinsics.feather"), feather(&intrinsics)?)?;
    let times: Vec<i64> = (-2..32).map(|step| START_NS + step * 20_000_000).collect();
    let mut table = vec![FeatherColumn::new("timestamp_ns", times.clone())];
    table.extend(posed(&times.iter().map(|time| world * rig(*time)).collect::<Vec<_>>()));
    write(&log.join("city_SE3_egovehicle.feather"), feather_packed(&table)?)?;

    let frames: Vec<i64> = (0..FRAME_COUNT).map(frame_time).collect();
    let both: Vec<i64> = frames.iter().flat_map(|time| [*time; 2]).collect();
    let of =
        |index: usize, time: i64| if index.is_multiple_of(2) { mover(time) } else { dvec3(3.0, -30.0, 0.9) };
    let boxes: Vec<DMat4> = both
        .iter()
        .enumerate()
        .map(|(index, time)| rig(*time).inverse() * DMat4::from_translation(of(index, *time)))
        .collect();
    let mut table = vec![
        FeatherColumn::new("timestamp_ns", both.clone()),
        texts("track_uuid", &["car", "parked"].repeat(FRAME_COUNT)),
        texts("category", &["REGULAR_VEHICLE"].repeat(2 * FRAME_COUNT)),
        FeatherColumn::new("length_m", vec![MOVER_SIZE.x; both.len()]),
        FeatherColumn::new("width_m", vec![MOVER_SIZE.y; both.len()]),
        FeatherColumn::new("height_m", vec![MOVER_SIZE.z; both.len()]),
    ];
    table.extend(posed(&boxes));
    write(&log.join("annotations.feather"), feather_packed(&table)?)?;
    let mut photos = Vec::new();
    for time in frames {
        for (name, angle) in cameras {
            let time = time + 7_000_000;
            let file = format!("sensors/cameras/{name}/{time}.jpg");
            write_photo(&log.join(&file))?;
            photos
                .push((file, landmark_pixels(&(rig(time) * rig_from_camera(angle)).inverse(), &landmarks())));
        }
        let points: Vec<DVec3> = swept(&rig(time), time).collect();
        let axis =
            |name, axis: usize| FeatherColumn::new(name, points.iter().map(|p| f16::from_f64(p[axis])));
        let table = [
            axis("x", 0),
            axis("y", 1),
            axis("z", 2),
            FeatherColumn::new("intensity", vec![64u8; points.len()]),
            FeatherColumn::new("laser_number", vec![3u8; points.len()]),
        ];
        write(&log.join(format!("sensors/lidar/{time}.feather")), feather_packed(&table)?)?;
    }
    write(&log.join("map/log_map_archive_adcf____PIT_city_31785.json"), "{}")?;
    let landmarks = landmarks().into_iter().map(|p| p + WORLD_ORIGIN).collect();
    Ok(MiniLog { path: log, landmarks, photos, mover: |time| mover(time) + WORLD_ORIGIN })
}

fn drivestudio(folder: &Path, is_waymo: bool) -> io::Result<MiniLog> {
    let scene = folder.join("023");
    let world = DMat4::from_translation(WORLD_ORIGIN);
    let text = |pose: &DMat4| (0..4).map(|row| words(&pose.row(row).to_array()) + "\n").collect::<String>();
    // Waymo's cameras have x ahead, y left and z up.
    let forward = DMat4::from_mat3(DMat3::from_cols(DVec3::Z, -DVec3::X, -DVec3::Y));
    let mut photos = Vec::new();
    let mut matrices = Vec::new();
    for frame in 0..FRAME_COUNT {
        let pose = world * rig(frame_time(frame));
        for (camera, angle) in [("0", 0.0), ("1", 0.9)] {
            let own = rig_from_camera(angle);
            if is_waymo {
                write(&scene.join(format!("extrinsics/{camera}.txt")), text(&(own * forward)))?;
            } else {
                write(&scene.join(format!("extrinsics/{frame:03}_{camera}.txt")), text(&(pose * own)))?;
            }
            let numbers =
                [FOCAL_PX, FOCAL_PX, PRINCIPAL_POINT_PX[0], PRINCIPAL_POINT_PX[1], 0.0, 0.0, 0.0, 0.0, 0.0];
            let numbers = numbers.map(|v| format!("{v}\n")).concat();
            write(&scene.join(format!("intrinsics/{camera}.txt")), numbers)?;
            let name = format!("images/{frame:03}_{camera}.jpg");
            write_photo(&scene.join(&name))?;
            photos.push((name, landmark_pixels(&(rig(frame_time(frame)) * own).inverse(), &landmarks())));
            let mask = |kind: &str, is_set: fn(u32) -> bool| {
                let bytes: Vec<u8> =
                    (0..SIZE.0 * SIZE.1).map(|pixel| if is_set(pixel) { 255 } else { 0 }).collect();
                let path = scene.join(format!("{kind}/{frame:03}_{camera}.png"));
                write(&path, png_bytes(png::ColorType::Grayscale, &bytes)?)
            };
            mask("sky_masks", |pixel| pixel < 10 * SIZE.0)?;
            mask("dynamic_masks/all", |pixel| pixel % SIZE.0 < 4)?;
        }
        let points: Vec<f64> = if is_waymo {
            write(&scene.join(format!("ego_pose/{frame:03}.txt")), text(&pose))?;
            let own = |p: DVec3| [0.9, 0.0, 1.7, p.x, p.y, p.z, 0.0, 0.0, 0.0, -1.0, 0.0, 0.25, 0.0, 0.0];
            swept(&rig(frame_time(frame)), frame_time(frame)).flat_map(own).collect()
        } else {
            let lidar = rig(frame_time(frame)) * rig_from_lidar();
            write(&scene.join(format!("lidar_pose/{frame:03}.txt")), text(&(world * lidar)))?;
            swept(&lidar, frame_time(frame)).flat_map(|p| [p.x, p.y, p.z, 0.25]).collect()
        };
        write(&scene.join(format!("lidar/{frame:03}.bin")), floats(points))?;
        let box_ = world * DMat4::from_translation(mover(frame_time(frame)));
        matrices.push([0, 1, 2, 3].map(|row| box_.row(row).to_array()));
    }
    let instances = serde_json::json!({"0": {"id": "car", "class_name": "Vehicle", "frame_annotations": {
        "frame_idx": (0..FRAME_COUNT).collect::<Vec<_>>(), "obj_to_world": matrices, "box_size": vec![MOVER_SIZE.to_array(); FRAME_COUNT]}}});
    write(&scene.join("instances/instances_info.json"), instances.to_string())?;
    let landmarks = landmarks().into_iter().map(|p| p + WORLD_ORIGIN).collect();
    Ok(MiniLog { path: scene, landmarks, photos, mover: |time| mover(time + START_NS) + WORLD_ORIGIN })
}
