//! SemanticKITTI (Behley et al. 2019): a class for each point of a lidar.
//!
//! Of each clip, as sequence SS with the clip's number,
//! `sequences/SS/{velodyne,labels}/%06d.{bin,label}`, `calib.txt`, `times.txt` and `poses.txt` as
//! in [`super::kitti_odometry`]; the pictures are there. A label is u32: an instance, always 0, in
//! the upper half and the class in the lower. Drops, flakes, fog and mirrored surfaces are
//! `outlier` (1). Surfaces have the class whose name their label has (`road` is 40), `unlabeled`
//! (0) without one. The sequences of a split are in `splits.json`, for `split` in the configuration
//! of a training.
//!
//! Source: semantic-kitti-api, `config/semantic-kitti.yaml` and `auxiliary/laserscan.py`, checked
//! with them (`tests/peers/semantic_kitti.py`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed, KittiRig};
use super::surface_classes::semantic_kitti_classes;
use super::{BlockWriter, ClipStream, FileSink, Layout};
use crate::{BlockInfo, DatasetPoint, PointSource, SetError, SetInfo};

pub(super) const LAYOUT: SemanticKitti = SemanticKitti {
    name: "semantic-kitti",
    about: "SemanticKITTI: points of one lidar with a class each, weather as outliers (1); no cameras, no radars",
    snowflake: OUTLIER,
};

/// Points that are no surfaces.
const OUTLIER: u16 = 1;

/// SemanticKITTI, or a data set with the same files and further classes.
pub(super) struct SemanticKitti {
    pub(super) name: &'static str,
    pub(super) about: &'static str,
    /// The class of flakes in the air.
    pub(super) snowflake: u16,
}

impl Layout for SemanticKitti {
    fn name(&self) -> &'static str {
        self.name
    }

    fn about(&self) -> &'static str {
        self.about
    }

    fn check(&self, set: &SetInfo) -> Result<(), SetError> {
        kitti::check(self.name(), KittiNeed::Lidar, set)
    }

    fn block<'a>(&'a self, block: BlockInfo<'a>) -> Box<dyn BlockWriter + 'a> {
        let folder = kitti::sequence_folder(block.clip);
        let path = move |file: KittiFile, frame: u32| match file {
            KittiFile::Picture(_) => None,
            KittiFile::Points => Some(format!("{folder}/velodyne/{frame:06}.bin")),
            KittiFile::Labels => Some(format!("{folder}/labels/{frame:06}.label")),
        };
        let classes = semantic_kitti_classes(&block.set.labels);
        let class = move |point: &DatasetPoint| match point.source {
            PointSource::Surface => classes.get(usize::from(point.label)).copied().unwrap_or(0),
            PointSource::Snow => self.snowflake,
            PointSource::Rain | PointSource::Air | PointSource::Ghost => OUTLIER,
        };
        Box::new(KittiFiles::new(block, path).with_labels(class))
    }

    fn tables(&self, set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
        let rig = KittiRig::new(set);
        kitti::sequence_tables(&rig, clips, files, |record, trajectory, files| {
            let path = format!("{}/poses.txt", kitti::sequence_folder(&record.clip));
            files.write(&path, trajectory.pose_lines(&rig).as_bytes())
        })
    }
}
