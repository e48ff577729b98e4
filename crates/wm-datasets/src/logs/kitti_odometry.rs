//! Sequences of KITTI's odometry benchmark, and of SemanticKITTI, which has the same folders.
//!
//! `sequences/SS/{calib.txt,times.txt,image_2,velodyne}` and `poses/SS.txt`: in each line the first camera's pose in the axes that it had
//! in the first frame, 3 rows of 4. The rig is the lidar: x ahead, y left, z up; the world is the rig of the first frame, so that up is the
//! vehicle's there. SemanticKITTI's `labels` say which points move. Sweeps are in the axes of their frame: their own motion has been taken out already.

use super::files::{fault, fault_in_line, files_in, name_of, numbers, pose_of_rows, read_text};
use super::kitti::KittiCalibration;
use super::sweep::{SweepMotion, SweepRecords};
use super::{
    DrivingLog, LogFormat, LogOptions, LogPicture, LogPictureMasks, LogSweep, check_cameras, empty_log, is_asked, size_of,
};
use crate::RigidPose;
use std::path::Path;
use wm_scene::FormatError;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat {
    name: "KITTI odometry",
    about: "a sequence of KITTI odometry or SemanticKITTI, sequences/SS, with its poses in poses/SS.txt",
    has_scenes: false,
    read,
};

const CAMERAS: [&str; 4] = ["image_0", "image_1", "image_2", "image_3"];
/// Time between two frames where no times are stated, ns.
const FRAME: i64 = 100_000_000;

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    if !path.join("calib.txt").is_file() || !CAMERAS.iter().any(|camera| path.join(camera).is_dir()) {
        return Ok(None);
    }
    let whole = std::path::absolute(path).map_err(|e| FormatError::reading(path, e))?;
    let name = name_of(&whole);
    let calibration = KittiCalibration::read(&path.join("calib.txt"))?;
    let camera_from_rig = calibration.pose("Tr", None)?;
    let rig_from_camera = camera_from_rig.inverse();

    let mut log = empty_log(path, name.clone());
    // Beside the sequences, or with the sequence, as SemanticKITTI has them.
    let beside = whole.ancestors().nth(2).map(|root| root.join("poses").join(format!("{name}.txt")));
    let own = path.join("poses.txt");
    let poses = beside.filter(|file| file.is_file()).unwrap_or_else(|| own.clone());
    if !poses.is_file() {
        let what = format!("there are no poses: poses/{name}.txt beside the folder of the sequences, or {}, is needed", own.display());
        return Err(fault(path, what));
    }
    let mut frames = Vec::new();
    for (index, line) in read_text(&poses)?.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let pose = pose_of_rows(&numbers(&poses, index + 1, line)?);
        let first_from_camera = pose.map_err(|what| fault_in_line(&poses, index + 1, what))?;
        frames.push(rig_from_camera.then(&first_from_camera).then(&camera_from_rig));
    }
    let times = times(&path.join("times.txt"), frames.len(), &mut log)?;
    let at = |stem: &str| {
        let index = stem.parse::<usize>().ok()?;
        Some((*times.get(index)?, *frames.get(index)?))
    };
    check_cameras(path, options, &CAMERAS)?;
    let has_colour = CAMERAS[2..].iter().any(|name| path.join(name).is_dir());
    for (number, name) in CAMERAS.into_iter().enumerate() {
        let folder = path.join(name);
        let is_usual = if has_colour { number >= 2 } else { true };
        let is_wanted = if options.cameras.is_empty() { is_usual } else { is_asked(options, name) };
        if !(is_wanted && folder.is_dir()) {
            continue;
        }
        let files = files_in(&folder, &["png", "jpg"])?;
        let Some((_, first)) = files.first() else { continue };
        let (camera, first_from_camera) = calibration.camera(&format!("P{number}"), name, size_of(first)?)?;
        let rig_from_camera = rig_from_camera.then(&first_from_camera);
        let mut lost = 0;
        for (stem, file) in files {
            let Some((timestamp, world_from_rig)) = at(&stem) else {
                lost += 1;
                continue;
            };
            let world_from_camera = world_from_rig.then(&rig_from_camera);
            let camera = log.cameras.len();
            log.pictures.push(LogPicture { camera, file, timestamp, world_from_camera, masks: LogPictureMasks::default() });
        }
        if lost > 0 {
            log.warnings.push(format!("{lost} pictures of {name} have no pose or time; they are left out"));
        }
        log.cameras.push(camera);
    }
    let sweeps = path.join("velodyne");
    if sweeps.is_dir() {
        for (stem, file) in files_in(&sweeps, &["bin"])? {
            let Some((timestamp, world_from_rig)) = at(&stem) else { continue };
            let labels = path.join("labels").join(format!("{stem}.label"));
            let labels = Some(labels).filter(|labels| labels.is_file());
            log.sweeps.push(LogSweep { labels, ..sweep(file, timestamp, world_from_rig) });
        }
    }
    Ok(Some(log))
}

fn sweep(file: std::path::PathBuf, timestamp: i64, world_from_lidar: RigidPose) -> LogSweep {
    LogSweep {
        file,
        timestamp,
        center: world_from_lidar.translation,
        labels: None,
        records: SweepRecords::Floats { columns: 4, position: 0, intensity: Some(3), white: 1.0 },
        motion: SweepMotion::Still(world_from_lidar),
    }
}

/// The times of the frames, ns.
fn times(path: &Path, frames: usize, log: &mut DrivingLog) -> Result<Vec<i64>, FormatError> {
    if !path.is_file() {
        log.warnings.push("there is no times.txt: ten frames a second are assumed".into());
        return Ok((0..frames as i64).map(|index| index * FRAME).collect());
    }
    let mut times = Vec::new();
    for (index, line) in read_text(path)?.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let values = numbers(path, index + 1, line)?;
        match values[..] {
            [seconds] if seconds.abs() < 4e9 => times.push((seconds * 1e9).round() as i64),
            _ => return Err(fault_in_line(path, index + 1, "a line must be one time, seconds")),
        }
    }
    Ok(times)
}
