//! Scenes as drivestudio's preprocessing writes them: Waymo, nuScenes, KITTI, PandaSet, nuPlan and
//! Argoverse with one reader.
//!
//! `images/%03d_C.jpg`, `lidar/%03d.bin`, `ego_pose/%03d.txt` (or `lidar_pose`), `extrinsics/C.txt`
//! (`rig_from_camera`) or `extrinsics/%03d_C.txt` (`world_from_camera`), `intrinsics/C.txt` (fx fy
//! cx cy k1 k2 p1 p2 k3). Cameras of Waymo have x ahead and z up, all others OpenCV's axes; which
//! it is shows in the matrices. Points are in the axes of the ego pose, or of the lidar pose where
//! there is one. Frames are a tenth of a second apart.

use super::files::{
    COPY_ADVICE, all_numbers, excerpt, fault, files_if_there, files_in, pose_of_rows, read_json,
};
use super::log::{
    DrivingLog, FRAME_NS, LogCamera, LogFormat, LogPictureMasks, check_cameras, is_asked, moved,
    size_of_first,
};
use super::records::{LogOptions, Records, choose_folder, logs_in};
use super::sweep::SweepRecords;
use super::track::{LogBox, LogTrack};
use crate::RigidPose;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use wm_base::FormatError;
use wm_scene::camera::Distortion;

/// The entry of [`super::LOG_FORMATS`].
pub(super) const FORMAT: LogFormat = LogFormat { name: "drivestudio", read };

const PHOTO_EXTENSIONS: &[&str] = &["jpg", "jpeg", "png"];
/// Largest frame number.
const MAX_FRAMES: u64 = 1_000_000;
/// Most boxes.
const MAX_BOXES: usize = 2_000_000;

fn read(path: &Path, options: &LogOptions) -> Result<Option<DrivingLog>, FormatError> {
    let is_scene =
        |folder: &Path| ["images", "extrinsics", "intrinsics"].iter().all(|name| folder.join(name).is_dir());
    let lacks = |scene: &Path| {
        let is_empty = files_in(&scene.join("images"), PHOTO_EXTENSIONS).is_ok_and(|files| files.is_empty());
        is_empty.then(|| "no pictures".to_owned())
    };
    let Some((path, note)) = choose_folder(path, "scenes", options, logs_in(path, is_scene), lacks)? else {
        return Ok(None);
    };
    let path = path.as_path();
    let mut records = Records::new(options.skip_bad);
    let mut log = DrivingLog::begun(path, note);
    let rigs = poses(&path.join("ego_pose"), &mut records)?;
    let lidars = poses(&path.join("lidar_pose"), &mut records)?;
    let extrinsics = Extrinsics::read(&path.join("extrinsics"), &rigs, &mut records)?;
    let first = rigs.values().next().or(lidars.values().next()).copied().or_else(|| extrinsics.first());
    log.origin = first.map_or(DVec3::ZERO, |pose| pose.translation);

    let mut by_camera = BTreeMap::<String, Vec<(String, PathBuf)>>::new();
    for (stem, file) in files_in(&path.join("images"), PHOTO_EXTENSIONS)? {
        if let Some((_, camera)) = frame_and_camera(&stem) {
            by_camera.entry(camera.to_owned()).or_default().push((stem, file));
        }
    }
    let names: Vec<&str> = by_camera.keys().map(String::as_str).collect();
    check_cameras(path, options, &names)?;
    let fine = path.join("fine_dynamic_masks/all");
    let movers = if fine.is_dir() { fine } else { path.join("dynamic_masks/all") };
    for (name, files) in by_camera {
        if !is_asked(options, &name) {
            continue;
        }
        let Some(size) = size_of_first(&files, &mut records)? else { continue };
        let camera = camera(&path.join("intrinsics").join(format!("{name}.txt")), &name, size)?;
        let (first, origin) = (log.pictures.len(), log.origin);
        let at = |stem: &str| {
            let (frame, _) = frame_and_camera(stem)?;
            Some((time_of(frame), moved(extrinsics.at(&rigs, &name, frame)?, origin)))
        };
        log.add_camera(camera, files, at, "pictures have no pose", &mut records);
        for picture in &mut log.pictures[first..] {
            let file = format!("{:03}_{name}.png", picture.timestamp / FRAME_NS);
            let mask = |folder: &Path| Some(folder.join(&file)).filter(|file| file.is_file());
            picture.masks = LogPictureMasks { movers: mask(&movers), sky: mask(&path.join("sky_masks")) };
        }
    }
    let is_waymo = extrinsics.is_forward;
    let is_own = !lidars.is_empty();
    let candidates: &[u64] = match (is_waymo, extrinsics.is_by_frame && !is_own) {
        (true, _) => &[14],
        (_, true) => &[5],
        _ => &[4, 6],
    };
    sweeps(&mut log, path, if is_own { &lidars } else { &rigs }, candidates, &mut records)?;
    log.tracks = tracks(&path.join("instances/instances_info.json"), log.origin, &mut records)?;
    log.warnings.extend(records.warnings());
    Ok(Some(log))
}

fn time_of(frame: u64) -> i64 {
    frame.min(MAX_FRAMES) as i64 * FRAME_NS
}

/// `012_3`: frame 12 of camera 3.
fn frame_and_camera(stem: &str) -> Option<(u64, &str)> {
    let (frame, camera) = stem.split_once('_')?;
    let frame = frame.parse().ok().filter(|frame| *frame <= MAX_FRAMES)?;
    Some((frame, camera))
}

fn pose(path: &Path) -> Result<RigidPose, FormatError> {
    pose_of_rows(&all_numbers(path)?).map_err(|what| fault(path, what))
}

/// The poses of a folder by frame; none if there is none.
fn poses(folder: &Path, records: &mut Records) -> Result<BTreeMap<u64, RigidPose>, FormatError> {
    let mut poses: Vec<(u64, RigidPose)> = Vec::new();
    for (stem, file) in files_if_there(folder, &["txt"])? {
        if let Some(frame) = stem.parse().ok().filter(|frame| *frame <= MAX_FRAMES) {
            poses.extend(records.sound("poses", pose(&file))?.map(|pose| (frame, pose)));
        }
    }
    let sound = records.without_jumps(folder, poses, |(frame, pose)| (time_of(*frame), pose.translation))?;
    Ok(sound.into_iter().collect())
}

/// The poses of the cameras.
struct Extrinsics {
    /// `rig_from_camera` by camera.
    fixed: BTreeMap<String, RigidPose>,
    /// `world_from_camera` by camera and frame.
    by_frame: BTreeMap<(String, u64), RigidPose>,
    is_by_frame: bool,
    /// True if cameras have x ahead and z up in the files.
    is_forward: bool,
}

impl Extrinsics {
    fn read(
        folder: &Path,
        rigs: &BTreeMap<u64, RigidPose>,
        records: &mut Records,
    ) -> Result<Self, FormatError> {
        let (mut fixed, mut by_frame) = (BTreeMap::new(), BTreeMap::new());
        for (stem, file) in files_in(folder, &["txt"])? {
            match frame_and_camera(&stem) {
                Some((frame, camera)) => {
                    let pose = records.sound("poses", pose(&file))?;
                    by_frame.extend(pose.map(|pose| ((camera.to_owned(), frame), pose)));
                }
                None => drop(fixed.insert(stem, pose(&file)?)),
            }
        }
        let is_by_frame = !by_frame.is_empty();
        if !is_by_frame && (fixed.is_empty() || rigs.is_empty()) {
            return Err(fault(
                folder,
                "there are no camera poses: C.txt and ego_pose/FRAME.txt, or FRAME_C.txt, are needed",
            ));
        }
        // A camera's up is its z in one convention and its -y in the other, and near the vehicle's
        // up in both.
        let up = |pose: &RigidPose, axis: DVec3| (pose.rotation * axis).z.abs();
        let all = || fixed.values().chain(by_frame.values());
        let is_forward = all().map(|pose| up(pose, DVec3::Z) - up(pose, DVec3::Y)).sum::<f64>() > 0.0;
        Ok(Self { fixed, by_frame, is_by_frame, is_forward })
    }

    fn first(&self) -> Option<RigidPose> {
        self.by_frame.values().next().copied()
    }

    /// `world_from_camera` with OpenCV's axes.
    fn at(&self, rigs: &BTreeMap<u64, RigidPose>, camera: &str, frame: u64) -> Option<RigidPose> {
        let pose = match self.by_frame.get(&(camera.to_owned(), frame)) {
            Some(pose) => *pose,
            None => rigs.get(&frame)?.then(self.fixed.get(camera)?),
        };
        let turn = match self.is_forward {
            true => DQuat::from_mat3(&DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X)),
            false => DQuat::IDENTITY,
        };
        Some(RigidPose { rotation: (pose.rotation * turn).normalize(), ..pose })
    }
}

fn camera(path: &Path, name: &str, size: (u32, u32)) -> Result<LogCamera, FormatError> {
    let numbers = all_numbers(path)?;
    let mut coefficients = [0.0; 5];
    let ([fx, fy, cx, cy, lens @ ..], 4..=9) = (numbers.as_slice(), numbers.len()) else {
        let what = format!("{} numbers: fx fy cx cy and k1 k2 p1 p2 k3 are needed", numbers.len());
        return Err(fault(path, what));
    };
    coefficients[..lens.len()].copy_from_slice(lens);
    let distortion = Distortion::of(coefficients);
    Ok(LogCamera { name: name.into(), size, focal: [*fx, *fy], center: [cx + 0.5, cy + 0.5], distortion })
}

/// The sweeps. Files do not say how many floats a point has: 14 for Waymo, 5 for PandaSet, 6 for
/// nuPlan, else 4. The first number that fits most files is taken; the others are damaged.
fn sweeps(
    log: &mut DrivingLog,
    path: &Path,
    poses: &BTreeMap<u64, RigidPose>,
    candidates: &[u64],
    records: &mut Records,
) -> Result<(), FormatError> {
    let folder = path.join("lidar");
    if !folder.is_dir() {
        return Ok(());
    }
    let files = files_in(&folder, &["bin"])?;
    let lengths: Vec<u64> =
        files.iter().map(|(_, file)| fs::metadata(file).map_or(0, |about| about.len())).collect();
    let fitting = |columns: u64| lengths.iter().filter(|length| length.is_multiple_of(4 * columns)).count();
    let columns = candidates
        .iter()
        .copied()
        .reduce(|best, next| if fitting(next) > fitting(best) { next } else { best });
    let Some(columns) = columns.filter(|columns| 2 * fitting(*columns) >= files.len()) else {
        let what =
            format!("its files hold no whole number of points of {candidates:?} floats; make them again");
        return Err(fault(&folder, what));
    };
    let (position, intensity, white) = match columns {
        14 => (3, Some(11), 1.0),
        4 | 5 => (0, Some(3), 1.0),
        _ => (0, Some(3), 255.0),
    };
    let layout = SweepRecords::Floats { columns: columns as usize, position, intensity, white };
    let origin = log.origin;
    let at = |stem: &str| {
        let frame = stem.parse().ok()?;
        Some((time_of(frame), moved(*poses.get(&frame)?, origin)))
    };
    log.add_sweeps(files, layout, at, "sweeps have no pose", records);
    Ok(())
}

#[derive(Deserialize)]
struct Instance {
    #[serde(default)]
    class_name: String,
    frame_annotations: Annotations,
}

#[derive(Deserialize)]
struct Annotations {
    frame_idx: Vec<u64>,
    obj_to_world: Vec<[[f64; 4]; 4]>,
    box_size: Vec<[f64; 3]>,
}

/// The boxes; none if there is no file.
fn tracks(path: &Path, origin: DVec3, records: &mut Records) -> Result<Vec<LogTrack>, FormatError> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let instances: BTreeMap<String, Instance> = read_json(path, COPY_ADVICE)?;
    let (mut tracks, mut count) = (Vec::new(), 0);
    for (id, instance) in instances {
        let of = instance.frame_annotations;
        let mut boxes = Vec::with_capacity(of.frame_idx.len());
        for ((frame, matrix), size) in of.frame_idx.iter().zip(&of.obj_to_world).zip(&of.box_size) {
            let wrong =
                |what: String| fault(path, format!("instance {}, frame {frame}: {what}", excerpt(&id)));
            let pose = if size.iter().all(|side| (0.0..1000.0).contains(side)) {
                pose_of_rows(matrix.as_flattened()).map_err(wrong)
            } else {
                Err(wrong(format!("a box of {size:?} m")))
            };
            let Some(world_from_box) = records.sound("boxes", pose)? else { continue };
            let (timestamp, size) = (time_of(*frame), DVec3::from(*size));
            boxes.push(LogBox { timestamp, world_from_box: moved(world_from_box, origin), size });
        }
        count += boxes.len();
        if count > MAX_BOXES {
            return Err(fault(path, format!("there are more than {MAX_BOXES} boxes in it")));
        }
        tracks.push(LogTrack::new(id, instance.class_name, boxes));
    }
    Ok(tracks)
}
