//! KITTI's object benchmark, as OpenPCDet, MMDetection3D and others read it.
//!
//! `training/{image_2,image_3,velodyne,calib,label_2}/%06d.{png,bin,txt}`, and the numbers of the
//! frames of each split in `ImageSets/SPLIT.txt`; clips of the split `test` are in `testing`
//! without labels. Frames are numbered over the whole set: number of the clip times frames of a
//! clip plus frame of the clip, so clips must be equally long. The files of labels are empty:
//! nothing moves in the scenes, so that there are no boxes; such a set is for training without
//! labels or for putting boxes of others in. Axes and calibration: [`super::kitti`].
//!
//! Source: KITTI's development kit for objects (`readme.txt`).

use super::kitti::{self, KittiFile, KittiFiles, KittiNeed, KittiRig};
use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::{BlockInfo, ClipInfo, ClipRecord, SensorReading, SetError, SetInfo};
use std::collections::BTreeMap;
use std::fmt::Write;

const NAME: &str = "kitti-object";

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "KITTI object benchmark: pictures of up to four pinhole cameras, points and calibration by frame; label files are empty, nothing moves",
    needs: LayerNeeds::NONE,
    needs_every_sensor: true,
    check: |set| kitti::check(NAME, KittiNeed::Camera, set),
    block,
    tables,
};

/// The files of a block: those of its readings, and the calibration and the labels of each frame
/// with its first picture.
fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let (folder, first) = (folder(block.clip), first_number(block.set, block.clip));
    let path = move |file: KittiFile, frame: u32| {
        let number = first + u64::from(frame);
        match file {
            KittiFile::Picture(slot) => Some(format!("{folder}/image_{slot}/{number:06}.png")),
            KittiFile::Points => Some(format!("{folder}/velodyne/{number:06}.bin")),
            KittiFile::Labels => None,
        }
    };
    let mut readings = KittiFiles::new(block, path);
    let rig = KittiRig::new(block.set);
    let (calibration, camera) = (rig.object_file(), rig.slots().next().map(|(sensor, _)| sensor));
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        readings.write(reading, files)?;
        if reading.info.is_key && camera == Some(reading.info.sensor) {
            let number = first + u64::from(reading.info.frame);
            files.write(&format!("{folder}/calib/{number:06}.txt"), calibration.as_bytes())?;
            if folder == "training" {
                files.write(&format!("{folder}/label_2/{number:06}.txt"), b"")?;
            }
        }
        Ok(())
    })
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    // Readers open these three even if no frame is in them.
    let mut lists: BTreeMap<String, String> =
        ["train", "val", "test"].into_iter().map(|split| (split.into(), String::new())).collect();
    let mut length = None;
    for record in clips {
        let ClipRecord { clip, .. } = record?;
        let frames = frames(set, &clip);
        if *length.get_or_insert(frames) != frames {
            let problem = format!(
                "clip \"{}\" has {frames} frames and others do not, but their numbers run on: make all clips equally long",
                clip.name
            );
            return Err(SetError::Layout { layout: NAME, problem });
        }
        let first = first_number(set, &clip);
        let list = lists.entry(clip.split).or_default();
        for number in first..first + frames {
            let _ = writeln!(list, "{number:06}");
        }
    }
    let both = format!("{}{}", lists["train"], lists["val"]);
    lists.insert("trainval".into(), both);
    lists.iter().try_for_each(|(split, list)| {
        files.write(&format!("ImageSets/{split}.txt"), list.as_bytes())
    })
}

/// Frames of a clip.
fn frames(set: &SetInfo, clip: &ClipInfo) -> u64 {
    (clip.seconds * set.frame_rate).round() as u64
}

/// The number of a clip's first frame.
fn first_number(set: &SetInfo, clip: &ClipInfo) -> u64 {
    clip.number * frames(set, clip)
}

fn folder(clip: &ClipInfo) -> &'static str {
    if clip.split == "test" { "testing" } else { "training" }
}
