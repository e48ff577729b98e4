//! Sequences of KITTI's odometry benchmark, and of SemanticKITTI, which has the same folders.
//!
//! `sequences/SS/{calib.txt,times.txt,image_2,velodyne}` and `poses/SS.txt`: in each line the first
//! camera's pose in the axes that it had in the first frame, 3 rows of 4. The rig is the lidar: x
//! ahead, y left, z up; the world is the rig of the first frame, so that up is the vehicle's there.
//! SemanticKITTI's `labels` say which points move. Sweeps are in the axes of their frame: their own
//! motion has been taken out already.

use super::files::{
    fault_in_line, files_if_there, files_in, folders_in, has_files, line_records, numbers, pose_of_rows,
};
use super::kitti::KittiCalibration;
use super::log::{DrivingLog, FRAME_NS, LogFormat, check_cameras, is_asked, size_of_first};
use super::records::{ChosenLog, LogOptions, Records, choose_folder, whole_name};
use super::sweep::SweepRecords;
use std::path::{Path, PathBuf};
use wm_base::FormatError;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat { name: "KITTI odometry", read };

const CAMERAS: [&str; 4] = ["image_0", "image_1", "image_2", "image_3"];

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let Some((path, note)) = find(path, options)? else { return Ok(None) };
    let path = path.as_path();
    let mut records = Records::new(options.skip_bad);
    let poses = poses_of(path);
    let calibration = KittiCalibration::read(&path.join("calib.txt"))?;
    let camera_from_rig = calibration.pose("Tr", None)?;
    let rig_from_camera = camera_from_rig.inverse();

    let mut log = DrivingLog::begun(path, note);
    let lines = line_records(&poses, |line, text| {
        let pose =
            pose_of_rows(&numbers(&poses, line, text)?).map_err(|what| fault_in_line(&poses, line, what))?;
        Ok(rig_from_camera.then(&pose).then(&camera_from_rig))
    })?;
    let empty = lines.iter().filter(|line| line.is_none()).count();
    records.lost("lines of the poses are empty, whose frames are missing", empty);
    let lines = records.sound_lines("poses", lines)?;
    let frames = lines.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
    let times = times(&path.join("times.txt"), frames, &mut log, &mut records)?;
    let timed = lines.into_iter().zip(&times).enumerate();
    let timed = timed.filter_map(|(index, (pose, time))| Some((index, (*time)?, pose?))).collect();
    let mut frames = vec![None; times.len()];
    for (index, time, pose) in
        records.without_jumps(&poses, timed, |(_, time, pose)| (*time, pose.translation))?
    {
        frames[index] = Some((time, pose));
    }
    let at = |stem: &str| *frames.get(stem.parse::<usize>().ok()?)?;
    check_cameras(path, options, &CAMERAS)?;
    let has_colour = CAMERAS[2..].iter().any(|name| path.join(name).is_dir());
    for (number, name) in CAMERAS.into_iter().enumerate() {
        let folder = path.join(name);
        let is_usual = !has_colour || number >= 2;
        let is_wanted = if options.cameras.is_empty() { is_usual } else { is_asked(options, name) };
        if !(is_wanted && folder.is_dir()) {
            continue;
        }
        let files = files_in(&folder, &["png", "jpg"])?;
        let Some(size) = size_of_first(&files, &mut records)? else { continue };
        let (camera, first_from_camera) = calibration.camera(&format!("P{number}"), name, size)?;
        let rig_from_camera = rig_from_camera.then(&first_from_camera);
        let world_from_camera =
            |stem: &str| at(stem).map(|(time, world_from_rig)| (time, world_from_rig.then(&rig_from_camera)));
        let lost = format!("pictures of {name} have no pose or time");
        log.add_camera(camera, files, world_from_camera, &lost, &mut records);
    }
    let lost = "sweeps have no pose or time";
    let sweeps = files_if_there(&path.join("velodyne"), &["bin"])?;
    log.add_sweeps(sweeps, SweepRecords::KITTI, at, lost, &mut records);
    let folder = path.join("labels");
    for sweep in &mut log.sweeps {
        let labels = folder.join(sweep.file.file_name().unwrap_or_default()).with_extension("label");
        sweep.labels = labels.is_file().then_some(labels);
    }
    let unlabelled = log.sweeps.iter().filter(|sweep| sweep.labels.is_none()).count();
    if folder.is_dir() && unlabelled > 0 {
        log.warnings.push(format!("{unlabelled} sweeps have no labels: what moves stays in their points"));
    }
    log.warnings.extend(records.warnings());
    Ok(Some(log))
}

/// The sequence in a folder: itself, or one of those in it or in its `sequences`. `None` if there
/// is none.
fn find(path: &Path, options: &LogOptions) -> Result<Option<ChosenLog<PathBuf>>, FormatError> {
    let has_camera = |folder: &Path| CAMERAS.iter().any(|camera| folder.join(camera).is_dir());
    let is_sequence = |folder: &Path| folder.join("calib.txt").is_file() && has_camera(folder);
    let sequences: Vec<PathBuf> = if is_sequence(path) {
        vec![path.to_owned()]
    } else {
        let below =
            [path.to_owned(), path.join("sequences")].into_iter().flat_map(|folder| folders_in(&folder));
        // Sequences whose pictures or calibration are not there are passed over, where others are.
        below.filter(|folder| folder.join("calib.txt").is_file() || has_camera(folder)).collect()
    };
    if !sequences.iter().any(|sequence| is_sequence(sequence)) {
        return Ok(None);
    }
    let lacks = |sequence: &Path| {
        let has_photos = |camera: &&str| has_files(&sequence.join(camera), &["png", "jpg"]);
        if !CAMERAS.iter().any(has_photos) {
            Some("no pictures".into())
        } else if !sequence.join("calib.txt").is_file() {
            Some("no calib.txt".into())
        } else if !poses_of(sequence).is_file() {
            let name = whole_name(sequence);
            Some(format!("no poses: poses/{name}.txt beside the sequences, or poses.txt in it, is needed"))
        } else {
            None
        }
    };
    choose_folder(path, "sequences", options, sequences, lacks)
}

/// The file of the poses of a sequence: beside the sequences, or with the sequence, as
/// SemanticKITTI has them.
fn poses_of(sequence: &Path) -> PathBuf {
    let whole = std::path::absolute(sequence).unwrap_or_else(|_| sequence.to_owned());
    let name = format!("{}.txt", whole_name(sequence));
    let beside = whole.ancestors().nth(2).map(|root| root.join("poses").join(name));
    beside.filter(|file| file.is_file()).unwrap_or_else(|| sequence.join("poses.txt"))
}

/// The times of the frames, ns; `None` where a line is empty.
fn times(
    path: &Path,
    frames: usize,
    log: &mut DrivingLog,
    records: &mut Records,
) -> Result<Vec<Option<i64>>, FormatError> {
    if !path.is_file() {
        log.warnings.push("there is no times.txt: ten frames a second are assumed".into());
        return Ok((0..frames as i64).map(|index| Some(index * FRAME_NS)).collect());
    }
    let lines = line_records(path, |line, text| match numbers(path, line, text)?[..] {
        [seconds] if seconds.abs() < 4e9 => Ok((seconds * 1e9).round() as i64),
        _ => Err(fault_in_line(path, line, "a line must be one time, seconds")),
    })?;
    records.sound_lines("times", lines)
}
