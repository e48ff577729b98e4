//! KITTI raw drives, synchronised and rectified (Geiger et al. 2013).
//!
//! `DATE/calib_{imu_to_velo,velo_to_cam,cam_to_cam}.txt` and
//! `DATE/DATE_drive_NNNN_sync/{image_0C,oxts,velodyne_points,tracklet_labels.xml}`. The rig is the
//! GPS/IMU unit: x ahead, y left, z up. Latitude and longitude become metres by the Mercator
//! projection at the first latitude. The lidar turns counterclockwise and looks ahead when the
//! cameras are triggered; its points are moved to where they were at their own time. Times have no
//! time zone, so that the time of day is not taken from them.

use super::files::{
    excerpt, fault, fault_in_line, files_in, folders_in, has_files, line_records, numbers, pose_of, read_text,
};
use super::kitti::KittiCalibration;
use super::kitti_tracklets::read_tracklets;
use super::log::{
    DrivingLog, EARTH_RADIUS_M, FRAME_NS, LogFormat, check_cameras, is_asked, moved, size_of_first,
};
use super::records::{ChosenLog, LogOptions, Records, choose_folder, logs_in};
use super::sweep::{SweepMotion, SweepRecords};
use super::track::EgoTrack;
use crate::RigidPose;
use glam::{DMat3, DQuat, DVec3};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use wm_base::FormatError;
use wm_base::calendar::days;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat { name: "KITTI raw", read };

const CAMERAS: [&str; 4] = ["image_00", "image_01", "image_02", "image_03"];

/// Times by the number of the record, ns; `None` where it is missing.
type Times = Vec<Option<i64>>;

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let Some((drive, note)) = find(path, options)? else { return Ok(None) };
    let mut records = Records::new(options.skip_bad);
    // A relative path may be the drive's folder itself.
    let whole = std::path::absolute(&drive).map_err(|e| FormatError::reading(&drive, e))?;
    let day = whole.parent().unwrap_or(&whole).to_owned();
    let read = |name: &str| KittiCalibration::read(&day.join(name));
    let (imu, velo, cams) =
        (read("calib_imu_to_velo.txt")?, read("calib_velo_to_cam.txt")?, read("calib_cam_to_cam.txt")?);
    let lidar_from_rig = imu.pose("R", Some("T"))?;
    let rig_from_lidar = lidar_from_rig.inverse();
    let cam0_from_lidar = velo.pose("R", Some("T"))?;
    let axes = DMat3::from_cols_array(&cams.get::<9>("R_rect_00")?).transpose();
    let rectified =
        pose_of(&axes, DVec3::ZERO).map_err(|what| fault(&cams.path, format!("R_rect_00: {what}")))?;
    let rig_from_rectified = rectified.then(&cam0_from_lidar).then(&lidar_from_rig).inverse();

    let mut log = DrivingLog::begun(&drive, note);
    let (track, times) = poses(&drive, &mut log, &mut records)?;
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
        let Some(size) = size_of_first(&files, &mut records)? else { continue };
        let key = format!("P_rect_{}", &name[6..]);
        let (camera, rectified_from_camera) = cams.camera(&key, name, size)?;
        let rig_from_camera = rig_from_rectified.then(&rectified_from_camera);
        let own = times_of(&drive, &format!("{name}/timestamps.txt"), &mut records)?;
        let world_from_camera = |stem: &str| {
            let time = time_at(stem, &own, &times)?;
            Some((time, track.at(time)?.then(&rig_from_camera)))
        };
        let lost = format!("pictures of {name} have no time or no pose in oxts");
        log.add_camera(camera, files, world_from_camera, &lost, &mut records);
    }
    add_sweeps(&mut log, &times, &track, rig_from_lidar, &mut records)?;
    let tracks = read_tracklets(&drive.join("tracklet_labels.xml"), |frame| {
        let time = (*times.get(frame)?)?;
        Some((time, track.at(time)?.then(&rig_from_lidar)))
    });
    log.tracks = records.sound("files of boxes", tracks)?.unwrap_or_default();
    log.warnings.extend(records.warnings());
    Ok(Some(log))
}

/// The drive in a folder: itself, one of a day's, or one of the days in it. `None` if there is
/// none.
fn find(path: &Path, options: &LogOptions) -> Result<Option<ChosenLog<PathBuf>>, FormatError> {
    let is_drive =
        |folder: &Path| folder.join("oxts").is_dir() && CAMERAS.iter().any(|c| folder.join(c).is_dir());
    let is_day = |folder: &Path| folder.join("calib_cam_to_cam.txt").is_file();
    let drives: Vec<PathBuf> = if is_drive(path) {
        vec![path.to_owned()]
    } else {
        let days = logs_in(path, is_day).into_iter();
        days.flat_map(|day| folders_in(&day)).filter(|folder| is_drive(folder)).collect()
    };
    if drives.is_empty() && is_day(path) {
        return Err(fault(path, "there are no drives in it"));
    }
    let lacks = |drive: &Path| {
        let has_photos = |camera: &&str| has_files(&drive.join(camera).join("data"), &["png", "jpg"]);
        if !has_files(&drive.join("oxts/data"), &["txt"]) {
            Some("no poses in oxts/data".into())
        } else if !CAMERAS.iter().any(has_photos) {
            Some("no pictures".into())
        } else {
            None
        }
    };
    choose_folder(path, "drives", options, drives, lacks)
}

/// The time of a record by its number: its own where its sensor has times, else that of the frame.
fn time_at(stem: &str, own: &Times, frames: &Times) -> Option<i64> {
    let index = stem.parse::<usize>().ok()?;
    own.get(index).or_else(|| frames.get(index)).copied().flatten()
}

/// Place and attitude of the vehicle in a file of `oxts`.
struct Oxts {
    latitude: f64,
    longitude: f64,
    altitude: f64,
    rotation: DQuat,
}

impl Oxts {
    fn read(path: &Path, text: &str) -> Result<Self, FormatError> {
        let values = numbers(path, 1, text.lines().next().unwrap_or_default())?;
        let [latitude, longitude, altitude, roll, pitch, yaw, ..] = values[..] else {
            return Err(fault_in_line(path, 1, format!("{} numbers, at least 6 are needed", values.len())));
        };
        if latitude.abs() > 89.0 || longitude.abs() > 360.0 || altitude.abs() > 1e5 || yaw.abs() > 1e3 {
            let what = format!("{latitude}, {longitude}, {altitude} is no place on the Earth");
            return Err(fault_in_line(path, 1, what));
        }
        let rotation =
            DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
        Ok(Self { latitude, longitude, altitude, rotation: rotation.normalize() })
    }

    /// East, north and up by the Mercator projection of a scale, m.
    fn position(&self, scale: f64) -> DVec3 {
        let north = (0.25 * std::f64::consts::PI + 0.5 * self.latitude.to_radians()).tan().ln();
        let east = scale * EARTH_RADIUS_M * self.longitude.to_radians();
        DVec3::new(east, scale * EARTH_RADIUS_M * north, self.altitude)
    }

    fn scale(&self) -> f64 {
        self.latitude.to_radians().cos()
    }
}

/// The poses of the vehicle, and the times of the frames by number.
fn poses(
    drive: &Path,
    log: &mut DrivingLog,
    records: &mut Records,
) -> Result<(EgoTrack, Times), FormatError> {
    let folder = drive.join("oxts/data");
    let mut times = times_of(drive, "oxts/timestamps.txt", records)?;
    let files = files_in(&folder, &["txt"])?;
    if times.is_empty() {
        log.warnings.push("oxts has no timestamps.txt: ten frames a second are assumed".into());
        let last = files.iter().filter_map(|(stem, _)| stem.parse::<usize>().ok()).max().unwrap_or(0);
        // One per file, whatever the names say.
        times = (0..=last.min(10 * files.len())).map(|index| Some(index as i64 * FRAME_NS)).collect();
    }
    let mut found: Vec<(i64, Oxts)> = Vec::with_capacity(files.len());
    for (stem, file) in &files {
        let text = read_text(file)?;
        if text.trim().is_empty() {
            records.lost("files of oxts/data are empty", 1);
            continue;
        }
        let Some(oxts) = records.sound("poses", Oxts::read(file, &text))? else { continue };
        match time_at(stem, &Vec::new(), &times) {
            Some(time) => found.push((time, oxts)),
            None => records.lost("poses of oxts have no time", 1),
        }
    }
    let found = records.without_jumps(&folder, found, |(time, oxts)| (*time, oxts.position(oxts.scale())))?;
    let Some((_, first)) = found.first() else {
        return Err(fault(&folder, "there are no poses in it; unpack the drive again"));
    };
    let scale = first.scale();
    log.origin = first.position(scale);
    log.location = Some([first.latitude, first.longitude]);
    log.is_north_known = true;
    let pose = |oxts: &Oxts| RigidPose { rotation: oxts.rotation, translation: oxts.position(scale) };
    let poses = found.iter().map(|(time, oxts)| (*time, moved(pose(oxts), log.origin)));
    Ok((EgoTrack::new(poses.collect()), times))
}

fn add_sweeps(
    log: &mut DrivingLog,
    times: &Times,
    track: &Arc<EgoTrack>,
    rig_from_lidar: RigidPose,
    records: &mut Records,
) -> Result<(), FormatError> {
    let drive = log.source.clone();
    let data = drive.join("velodyne_points/data");
    if !data.is_dir() {
        return Ok(());
    }
    let mut read = |name: &str| times_of(&drive, &format!("velodyne_points/{name}.txt"), records);
    let (own, starts, ends) = (read("timestamps")?, read("timestamps_start")?, read("timestamps_end")?);
    let at = |stem: &str| {
        let time = time_at(stem, &own, times)?;
        Some((time, track.at(time)?.then(&rig_from_lidar)))
    };
    let files = files_in(&data, &["bin"])?;
    log.add_sweeps(files, SweepRecords::KITTI, at, "sweeps have no time or no pose in oxts", records);
    for sweep in &mut log.sweeps {
        let stem = sweep.file.file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
        let none = Vec::new();
        let span = time_at(stem, &starts, &none).zip(time_at(stem, &ends, &none));
        // A turn takes a tenth of a second; other times are faults of the file, and the sweep is
        // taken as still.
        let span = span.filter(|(start, end)| start < end && start.abs_diff(*end) < 500_000_000);
        if let Some(span) = span {
            sweep.motion = SweepMotion::Turning { track: Arc::clone(track), rig_from_lidar, span };
        }
    }
    Ok(())
}

/// Nanoseconds since 1970 of a file of lines `2011-09-26 13:02:25.594360375`, by the number of the
/// record; none if there is no file.
fn times_of(drive: &Path, name: &str, records: &mut Records) -> Result<Times, FormatError> {
    let path = drive.join(name);
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let lines = line_records(&path, |line, text| {
        nanoseconds(text).ok_or_else(|| {
            let text = excerpt(text);
            fault_in_line(&path, line, format!("\"{text}\" is no time such as 2011-09-26 13:02:25.594360375"))
        })
    })?;
    if name.ends_with("/timestamps.txt") {
        let empty = lines.iter().filter(|line| line.is_none()).count();
        records.lost(format!("lines of {name} are empty, whose records are missing"), empty);
    }
    records.sound_lines("times", lines)
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
    is_time
        .then(|| ((days(year, month, day) * 24 + hours) * 60 + minutes) * 60 + whole)?
        .checked_mul(1_000_000_000)?
        .checked_add(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_to_the_nanosecond() {
        assert_eq!(nanoseconds("2011-09-26 13:02:25.594360375"), Some(1_317_042_145_594_360_375));
        assert_eq!(nanoseconds("1970-01-01 00:00:00"), Some(0));
        assert_eq!(nanoseconds("2024-02-29 00:00:00.5"), Some(1_709_164_800_500_000_000));
        let bad = ["", "2011-09-26", "2011-13-26 13:02:25", "2011-09-26 13:02", "2011-09-26 13:02:25.x"];
        for bad in bad.into_iter().chain(["99999999999-1-1 1:1:1"]) {
            assert_eq!(nanoseconds(bad), None, "{bad}");
        }
    }
}
