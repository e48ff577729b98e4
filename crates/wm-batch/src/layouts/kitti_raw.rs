//! KITTI raw data, synchronised and rectified, as pykitti's `raw` reads it.
//!
//! `DATE/calib_{cam_to_cam,velo_to_cam,imu_to_velo}.txt`, and of each clip, as drive NNNN with the
//! clip's number,
//! `DATE/DATE_drive_NNNN_sync/{image_0K,velodyne_points,oxts}/data/%010d.{png,bin,txt}` with
//! `timestamps.txt` beside each `data`. DATE is the day of the clip's start. Axes and calibration:
//! [`super::kitti`]; pykitti reads `image_00` and `image_01` as grey. A packet of `oxts` is made
//! from the pose of the rig at the frame's sweep; a picture may be later than that if its camera
//! has a phase, see its time stamps.
//!
//! Source: KITTI's development kit (`readme.txt`, `dataformat.txt`), checked with pykitti 0.3.1
//! (`tests/peers/sets.py`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed, KittiRig, KittiTrajectory};
use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::utc;
use crate::{BlockInfo, ClipInfo, SetError, SetInfo};
use std::collections::BTreeSet;

pub(super) const LAYOUT: Layout = Layout {
    name: "kitti-raw",
    about: "KITTI raw data: up to four pinhole cameras as PNG, one lidar, GPS/IMU packets and calibration; no radars, no boxes",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| kitti::check("kitti-raw", KittiNeed::Any, set),
    block,
    tables,
};

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let drive = drive_folder(block.clip);
    let path = move |file: KittiFile, frame: u32| match file {
        KittiFile::Picture(slot) => Some(format!("{drive}/image_{slot:02}/data/{frame:010}.png")),
        KittiFile::Points => Some(format!("{drive}/velodyne_points/data/{frame:010}.bin")),
        KittiFile::Labels => None,
    };
    Box::new(KittiFiles::new(block, path))
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    let rig = KittiRig::new(set);
    let mut days = BTreeSet::new();
    for record in clips {
        let record = record?;
        let (clip, drive) = (&record.clip, drive_folder(&record.clip));
        let (day, calibrated) = (utc::date(clip.start, '_'), utc::text(clip.start));
        if days.insert(day.clone()) {
            for (name, text) in [
                ("cam_to_cam", rig.cam_to_cam_file(&calibrated)),
                ("velo_to_cam", rig.velo_to_cam_file(&calibrated)),
                ("imu_to_velo", rig.imu_to_velo_file(&calibrated)),
            ] {
                files.write(&format!("{day}/calib_{name}.txt"), text.as_bytes())?;
            }
        }
        for (sensor, slot) in rig.slots() {
            let times = lines(kitti::times(&record, Some(sensor)));
            files.write(&format!("{drive}/image_{slot:02}/timestamps.txt"), times.as_bytes())?;
        }
        if let Some(lidar) = rig.lidar {
            let starts = kitti::times(&record, Some(lidar));
            let sweep = (1e9 / set.sensors[lidar].rate).round() as i64;
            let ends = lines(starts.clone().map(|time| time + sweep));
            let starts = lines(starts);
            // Points are in the axes of the start of the sweep, thus the time of the whole.
            for (name, text) in [("", &starts), ("_start", &starts), ("_end", &ends)] {
                files.write(&format!("{drive}/velodyne_points/timestamps{name}.txt"), text.as_bytes())?;
            }
        }
        let trajectory = KittiTrajectory::new(&rig, &record);
        files.write(&format!("{drive}/oxts/timestamps.txt"), lines(trajectory.times(clip)).as_bytes())?;
        for (frame, line) in kitti::oxts_lines(&record, &trajectory).iter().enumerate() {
            files.write(&format!("{drive}/oxts/data/{frame:010}.txt"), line.as_bytes())?;
        }
    }
    Ok(())
}

fn drive_folder(clip: &ClipInfo) -> String {
    let day = utc::date(clip.start, '_');
    format!("{day}/{day}_drive_{:04}_sync", clip.number)
}

/// Times with nine decimals, each with a newline: pykitti cuts four characters and reads
/// microseconds.
fn lines(times: impl Iterator<Item = i64>) -> String {
    times.map(|time| utc::text(time) + "\n").collect()
}
