//! SemanticKITTI (Behley et al. 2019): a class for each point of a lidar.
//!
//! Each clip is a sequence SS, the clip's number, with the files
//! `sequences/SS/{velodyne,labels}/%06d.{bin,label}`, `calib.txt`, `times.txt` and `poses.txt` as
//! in [`super::kitti_odometry`]; the pictures are there. A label is u32: an instance, always 0, in
//! the upper half and the class in the lower. Drops, flakes, fog and mirrored surfaces are
//! `outlier` (1). Surfaces have the class whose name their label has (`road` is 40), `unlabeled`
//! (0) without one. The sequences of a split are in `splits.json`, for `split` in the configuration
//! of a training.
//!
//! Source: semantic-kitti-api, `config/semantic-kitti.yaml` and `auxiliary/laserscan.py`, checked
//! with them (`tests/peers/semantic_kitti.py`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed};
use super::surface_classes::semantic_kitti_classes;
use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::{BlockInfo, DatasetPoint, PointSource, SetError, SetInfo};

pub(super) const LAYOUT: Layout = Layout {
    name: "semantic-kitti",
    about: "SemanticKITTI: points of one lidar with a class each, weather as outliers (1); no cameras, no radars",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| kitti::check("semantic-kitti", KittiNeed::Lidar, set),
    block: |block| with_classes(block, OUTLIER_CLASS),
    tables,
};

/// Class of points that are no surfaces.
const OUTLIER_CLASS: u16 = 1;

/// The files of a block, with the class that flakes in the air have.
pub(super) fn with_classes(block: BlockInfo<'_>, snowflake: u16) -> Box<dyn BlockWriter + '_> {
    let folder = kitti::sequence_folder(block.clip);
    let path = move |file: KittiFile, frame: u32| match file {
        KittiFile::Picture(_) => None,
        KittiFile::Points => Some(format!("{folder}/velodyne/{frame:06}.bin")),
        KittiFile::Labels => Some(format!("{folder}/labels/{frame:06}.label")),
    };
    let classes = semantic_kitti_classes(&block.set.labels);
    let class = move |point: &DatasetPoint| match point.source {
        PointSource::Surface => classes.get(usize::from(point.label)).copied().unwrap_or(0),
        PointSource::Snow => snowflake,
        PointSource::Rain | PointSource::Air | PointSource::Ghost => OUTLIER_CLASS,
    };
    let mut files = KittiFiles::new(block, path);
    files.class = Some(Box::new(class));
    Box::new(files)
}

pub(super) fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    kitti::sequence_tables(set, clips, files, |sequence| format!("sequences/{sequence}/poses.txt"))
}
