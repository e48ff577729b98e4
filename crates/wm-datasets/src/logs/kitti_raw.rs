//! KITTI raw drives, synchronised and rectified (Geiger et al. 2013).
//!
//! `DATE/calib_{imu_to_velo,velo_to_cam,cam_to_cam}.txt` and `DATE/DATE_drive_NNNN_sync/{image_0C,oxts,velodyne_points,tracklet_labels.xml}`. The rig is the
//! GPS/IMU unit: x ahead, y left, z up. Latitude and longitude become metres by the Mercator projection at the first latitude. The lidar
//! turns counterclockwise and looks ahead when the cameras are triggered; its points are moved to where they were at their own time. Times have no time zone, so
//! that the time of day is not taken from them.

use super::files::{fault, fault_in_line, files_in, folders_in, name_of, numbers, read_text};
use super::kitti::KittiCalibration;
use super::kitti_tracklets::read_tracklets;
use super::sweep::{SweepMotion, SweepRecords};
use super::track::EgoTrack;
use super::{
    DrivingLog, LogFormat, LogOptions, LogPicture, LogPictureMasks, LogSweep, check_cameras, empty_log, is_asked, moved,
    size_of,
};
use crate::RigidPose;
use glam::{DQuat, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wm_scene::FormatError;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat {
    name: "KITTI raw",
    about: "a drive of the KITTI raw data, DATE/DATE_drive_NNNN_sync, with the calibration in DATE; or DATE itself",
    has_scenes: true,
    read,
};

const CAMERAS: [&str; 4] = ["image_00", "image_01", "image_02", "image_03"];
/// The equatorial radius, m, as the devkit has it.
const RADIUS: f64 = 6_378_137.0;
/// Time between two frames where no times are stated, ns.
const FRAME: i64 = 100_000_000;

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let is_drive = |folder: &Path| folder.join("oxts").is_dir() && CAMERAS.iter().any(|c| folder.join(c).is_dir());
    let (drive, mut warnings) = if is_drive(path) {
        (path.to_owned(), Vec::new())
    } else if path.join("calib_cam_to_cam.txt").is_file() {
        choose(path, options, is_drive)?
    } else {
        return Ok(None);
    };
    // A relative path may be the drive's folder itself.
    let whole = std::path::absolute(&drive).map_err(|e| FormatError::reading(&drive, e))?;
    let day = whole.parent().unwrap_or(&whole).to_owned();
    let read = |name: &str| KittiCalibration::read(&day.join(name));
    let (imu, velo, cams) = (read("calib_imu_to_velo.txt")?, read("calib_velo_to_cam.txt")?, read("calib_cam_to_cam.txt")?);
    let lidar_from_rig = imu.pose("R", Some("T"))?;
    let rig_from_lidar = lidar_from_rig.inverse();
    let cam0_from_lidar = velo.pose("R", Some("T"))?;
    let rectified = RigidPose { translation: DVec3::ZERO, ..rotation(&cams, "R_rect_00")? };
    let rig_from_rectified = rectified.then(&cam0_from_lidar).then(&lidar_from_rig).inverse();

    let mut log = empty_log(&drive, name_of(&whole));
    let (track, times) = poses(&drive, &mut log)?;
    let track = Arc::new(track);
    check_cameras(&drive, options, &CAMERAS)?;
    for name in CAMERAS {
        let folder = drive.join(name).join("data");
        let is_colour = matches!(name, "image_02" | "image_03");
        let is_wanted = if options.cameras.is_empty() { is_colour } else { is_asked(options, name) };
        if !(is_wanted && folder.is_dir()) {
            continue;
        }
        let files = files_in(&folder, &["png", "jpg"])?;
        let Some((_, first)) = files.first() else { continue };
        let key = format!("P_rect_{}", &name[6..]);
        let (camera, rectified_from_camera) = cams.camera(&key, name, size_of(first)?)?;
        let rig_from_camera = rig_from_rectified.then(&rectified_from_camera);
        let own = times_of(&drive.join(name).join("timestamps.txt"))?;
        let mut lost = 0;
        for (stem, file) in files {
            let index = stem.parse::<usize>().ok();
            let time = index.and_then(|index| own.get(index).or_else(|| times.get(index)).copied());
            let Some((timestamp, world_from_rig)) = time.and_then(|time| Some((time, track.at(time)?))) else {
                lost += 1;
                continue;
            };
            let world_from_camera = world_from_rig.then(&rig_from_camera);
            let camera = log.cameras.len();
            log.pictures.push(LogPicture { camera, file, timestamp, world_from_camera, masks: LogPictureMasks::default() });
        }
        if lost > 0 {
            warnings.push(format!("{lost} pictures of {name} have no pose in oxts; they are left out"));
        }
        log.cameras.push(camera);
    }
    log.sweeps = sweeps(&drive, &times, &track, rig_from_lidar)?;
    log.tracks = read_tracklets(&drive.join("tracklet_labels.xml"), |frame| {
        let time = *times.get(frame)?;
        Some((time, track.at(time)?.then(&rig_from_lidar)))
    })?;
    log.warnings = warnings;
    Ok(Some(log))
}

/// A rotation of nine numbers.
fn rotation(cams: &KittiCalibration, key: &str) -> Result<RigidPose, FormatError> {
    let [a, b, c, d, e, f, g, h, i] = cams.get::<9>(key)?;
    let numbers = [a, b, c, 0.0, d, e, f, 0.0, g, h, i, 0.0];
    super::files::pose_of_rows(&numbers).map_err(|what| fault(cams.path(), format!("{key}: {what}")))
}

/// The drive of a day that is asked for, or the first.
fn choose(
    day: &Path,
    options: &LogOptions,
    is_drive: impl Fn(&Path) -> bool,
) -> Result<(PathBuf, Vec<String>), FormatError> {
    let drives: Vec<PathBuf> = folders_in(day).into_iter().filter(|folder| is_drive(folder)).collect();
    let names: Vec<String> = drives.iter().map(|drive| name_of(drive)).collect();
    let known = names.join(", ");
    match (&options.scene, drives.first()) {
        (_, None) => Err(fault(day, "there is no drive in it, a folder with oxts and image_02")),
        (None, Some(first)) => {
            let note = (drives.len() > 1).then(|| format!("the first of the drives is read: {known}"));
            Ok((first.clone(), note.into_iter().collect()))
        }
        (Some(asked), _) => {
            let is_meant = |name: &str| name == asked || name.contains(&format!("_drive_{asked}_"));
            let found = names.iter().position(|name| is_meant(name));
            let found = found.ok_or_else(|| fault(day, format!("there is no drive {asked:?}; there are {known}")))?;
            Ok((drives[found].clone(), Vec::new()))
        }
    }
}

/// The poses of the vehicle, and the times of the frames by number, ns.
fn poses(drive: &Path, log: &mut DrivingLog) -> Result<(EgoTrack, Vec<i64>), FormatError> {
    let folder = drive.join("oxts");
    let stated = times_of(&folder.join("timestamps.txt"))?;
    let files = files_in(&folder.join("data"), &["txt"])?;
    if stated.is_empty() {
        log.warnings.push("oxts has no timestamps.txt: ten frames a second are assumed".into());
    }
    let mut times = stated;
    let mut poses = Vec::with_capacity(files.len());
    let mut start: Option<(f64, DVec3)> = None;
    for (stem, file) in &files {
        let Ok(index) = stem.parse::<usize>() else { continue };
        let text = read_text(file)?;
        let values = numbers(file, 1, text.lines().next().unwrap_or_default())?;
        let [latitude, longitude, altitude, roll, pitch, yaw, ..] = values[..] else {
            return Err(fault_in_line(file, 1, format!("{} numbers, at least 6 are needed", values.len())));
        };
        if latitude.abs() > 89.0 || longitude.abs() > 360.0 || altitude.abs() > 1e5 || yaw.abs() > 1e3 {
            return Err(fault_in_line(file, 1, format!("{latitude}, {longitude}, {altitude} is no place on the Earth")));
        }
        let scale = start.map_or(latitude.to_radians().cos(), |(scale, _)| scale);
        let position = DVec3::new(
            scale * RADIUS * longitude.to_radians(),
            scale * RADIUS * (0.25 * std::f64::consts::PI + 0.5 * latitude.to_radians()).tan().ln(),
            altitude,
        );
        let (_, origin) = *start.get_or_insert((scale, position));
        log.location = log.location.or(Some([latitude, longitude]));
        let rotation = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
        let time = times.get(index).copied().or_else(|| i64::try_from(index).ok()?.checked_mul(FRAME));
        if let Some(time) = time {
            poses.push((time, moved(RigidPose { rotation: rotation.normalize(), translation: position }, origin)));
        }
        log.origin = origin;
    }
    if poses.is_empty() {
        return Err(fault(&folder.join("data"), "there are no poses in it; unpack the drive again"));
    }
    log.is_north_known = true;
    if times.is_empty() {
        let last = files.iter().filter_map(|(stem, _)| stem.parse::<usize>().ok()).max().unwrap_or(0);
        // As many as there are files, whatever their names say.
        times = (0..=last.min(10 * files.len())).map(|index| index as i64 * FRAME).collect();
    }
    Ok((EgoTrack::new(poses), times))
}

fn sweeps(
    drive: &Path,
    times: &[i64],
    track: &Arc<EgoTrack>,
    rig_from_lidar: RigidPose,
) -> Result<Vec<LogSweep>, FormatError> {
    let folder = drive.join("velodyne_points");
    let data = folder.join("data");
    if !data.is_dir() {
        return Ok(Vec::new());
    }
    let read = |name: &str| times_of(&folder.join(name));
    let (own, starts, ends) = (read("timestamps.txt")?, read("timestamps_start.txt")?, read("timestamps_end.txt")?);
    let mut sweeps = Vec::new();
    for (stem, file) in files_in(&data, &["bin"])? {
        let Ok(index) = stem.parse::<usize>() else { continue };
        let Some(timestamp) = own.get(index).or_else(|| times.get(index)).copied() else { continue };
        let Some(world_from_rig) = track.at(timestamp) else { continue };
        let world_from_lidar = world_from_rig.then(&rig_from_lidar);
        let span = starts.get(index).copied().zip(ends.get(index).copied());
        // A turn takes a tenth of a second; other times are faults of the file.
        let span = span.filter(|(start, end)| start < end && start.abs_diff(*end) < 500_000_000);
        let motion = match span {
            Some(span) => SweepMotion::Turning { track: Arc::clone(track), rig_from_lidar, span },
            None => SweepMotion::Still(world_from_lidar),
        };
        let records = SweepRecords::Floats { columns: 4, position: 0, intensity: Some(3), white: 1.0 };
        sweeps.push(LogSweep { file, labels: None, timestamp, center: world_from_lidar.translation, records, motion });
    }
    Ok(sweeps)
}

/// Nanoseconds since 1970 of a file of lines `2011-09-26 13:02:25.594360375`; none if there is no file.
fn times_of(path: &Path) -> Result<Vec<i64>, FormatError> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let text = read_text(path)?;
    let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let time = |(index, line): (usize, &str)| {
        nanoseconds(line.trim()).ok_or_else(|| {
            let line = super::files::excerpt(line);
            fault_in_line(path, index + 1, format!("\"{line}\" is no time such as 2011-09-26 13:02:25.594360375"))
        })
    };
    lines.map(time).collect()
}

/// Nanoseconds since 1970 of a date and a time of day, both UTC.
fn nanoseconds(text: &str) -> Option<i64> {
    let (date, time) = text.split_once(' ')?;
    let mut date = date.splitn(3, '-').map(str::parse::<i64>);
    let (year, month, day) = (date.next()?.ok()?, date.next()?.ok()?, date.next()?.ok()?);
    let mut time = time.splitn(3, ':');
    let (hours, minutes, seconds) = (time.next()?, time.next()?, time.next()?);
    let (hours, minutes) = (hours.parse::<i64>().ok()?, minutes.parse::<i64>().ok()?);
    let (whole, part) = seconds.split_once('.').unwrap_or((seconds, ""));
    let whole = whole.parse::<i64>().ok()?;
    let digits: String = part.chars().chain("000000000".chars()).take(9).collect();
    let part = digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse::<i64>().ok())??;
    let is_time = (1970..2200).contains(&year)
        && (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && (0..24).contains(&hours)
        && (0..60).contains(&minutes)
        && (0..=60).contains(&whole);
    is_time.then(|| ((days(year, month, day) * 24 + hours) * 60 + minutes) * 60 + whole)?.checked_mul(1_000_000_000)?.checked_add(part)
}

/// Days from 1970-01-01, Gregorian: years are counted from March, so that leap days come last.
fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let of_year = (153 * month + 2) / 5 + day - 1;
    365 * year + year / 4 - year / 100 + year / 400 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_to_the_nanosecond() {
        assert_eq!(nanoseconds("2011-09-26 13:02:25.594360375"), Some(1_317_042_145_594_360_375));
        assert_eq!(nanoseconds("1970-01-01 00:00:00"), Some(0));
        assert_eq!(nanoseconds("2024-02-29 00:00:00.5"), Some(1_709_164_800_500_000_000));
        for bad in ["", "2011-09-26", "2011-13-26 13:02:25", "2011-09-26 13:02", "2011-09-26 13:02:25.x", "99999999999-1-1 1:1:1"] {
            assert_eq!(nanoseconds(bad), None, "{bad}");
        }
    }
}
