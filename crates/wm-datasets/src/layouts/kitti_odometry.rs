//! KITTI's odometry benchmark, as pykitti's `odometry` reads it.
//!
//! Of each clip, as sequence SS with the clip's number,
//! `sequences/SS/{image_K,velodyne}/%06d.{png,bin}`, `calib.txt` (`P0` to `P3`, `Tr`), `times.txt`
//! (seconds since the first frame), and `poses/SS.txt`: `T_w_cam0`, 3x4, in the axes of camera 0 at
//! the first frame. The names of the sequences of a split are in `splits.json`. Axes and
//! calibration: [`super::kitti`].
//!
//! Source: KITTI's development kit for odometry, checked with pykitti 0.3.1
//! (`tests/peers/sets.py`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed, KittiRig};
use super::{BlockWriter, ClipStream, FileSink, Layout};
use crate::{BlockInfo, SetError, SetInfo};

pub(super) const LAYOUT: KittiOdometry = KittiOdometry;

pub(super) struct KittiOdometry;

impl Layout for KittiOdometry {
    fn name(&self) -> &'static str {
        "kitti-odometry"
    }

    fn about(&self) -> &'static str {
        "KITTI odometry benchmark: sequences of up to four pinhole cameras as PNG and one lidar, with poses; no radars"
    }

    fn check(&self, set: &SetInfo) -> Result<(), SetError> {
        kitti::check(self.name(), KittiNeed::Any, set)
    }

    fn block<'a>(&'a self, block: BlockInfo<'a>) -> Box<dyn BlockWriter + 'a> {
        let folder = kitti::sequence_folder(block.clip);
        let path = move |file: KittiFile, frame: u32| match file {
            KittiFile::Picture(slot) => Some(format!("{folder}/image_{slot}/{frame:06}.png")),
            KittiFile::Points => Some(format!("{folder}/velodyne/{frame:06}.bin")),
            KittiFile::Labels => None,
        };
        Box::new(KittiFiles::new(block, path))
    }

    fn tables(&self, set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
        let rig = KittiRig::new(set);
        kitti::sequence_tables(&rig, clips, files, |record, trajectory, files| {
            let path = format!("poses/{}.txt", kitti::sequence_name(&record.clip));
            files.write(&path, trajectory.pose_lines(&rig).as_bytes())
        })
    }
}
