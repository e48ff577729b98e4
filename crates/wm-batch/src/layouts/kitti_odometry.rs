//! KITTI's odometry benchmark, as pykitti's `odometry` reads it.
//!
//! Each clip is a sequence SS, the clip's number, with the files
//! `sequences/SS/{image_K,velodyne}/%06d.{png,bin}`, `calib.txt` (`P0` to `P3`, `Tr`), `times.txt`
//! (seconds since the first frame), and `poses/SS.txt`: `T_w_cam0`, 3x4, in the axes of camera 0 at
//! the first frame. The names of the sequences of a split are in `splits.json`. Axes and
//! calibration: [`super::kitti`].
//!
//! Source: KITTI's development kit for odometry, checked with pykitti 0.3.1
//! (`tests/peers/sets.py`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed};
use super::{BlockWriter, LayerNeeds, Layout};
use crate::BlockInfo;

pub(super) const LAYOUT: Layout = Layout {
    name: "kitti-odometry",
    about: "KITTI odometry benchmark: sequences of up to four pinhole cameras as PNG and one lidar, with poses; no radars",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| kitti::check("kitti-odometry", KittiNeed::Any, set),
    block,
    tables: |set, clips, files| {
        kitti::sequence_tables(set, clips, files, |sequence| format!("poses/{sequence}.txt"))
    },
};

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let folder = kitti::sequence_folder(block.clip);
    let path = move |file: KittiFile, frame: u32| match file {
        KittiFile::Picture(slot) => Some(format!("{folder}/image_{slot}/{frame:06}.png")),
        KittiFile::Points => Some(format!("{folder}/velodyne/{frame:06}.bin")),
        KittiFile::Labels => None,
    };
    Box::new(KittiFiles::new(block, path))
}
