//! Sequences of the odometry benchmark and of SemanticKITTI.

use super::{KittiRig, KittiTrajectory};
use crate::{ClipInfo, ClipStream, FileSink, SetError, SetInfo};
use std::collections::BTreeMap;

/// The name of a sequence: two digits, or more from the hundredth.
fn sequence_name(clip: &ClipInfo) -> String {
    format!("{:02}", clip.number)
}

/// The folder of a sequence.
pub(in super::super) fn sequence_folder(clip: &ClipInfo) -> String {
    format!("sequences/{}", sequence_name(clip))
}

/// Writes `calib.txt`, `times.txt` and the poses of each sequence, and `splits.json`. `poses` gives
/// the path of the poses of a sequence.
pub(in super::super) fn sequence_tables(
    set: &SetInfo,
    clips: ClipStream<'_>,
    files: &mut dyn FileSink,
    poses: fn(&str) -> String,
) -> Result<(), SetError> {
    let mut splits: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let rig = KittiRig::new(set);
    let calibration = rig.sequence_file();
    for record in clips {
        let record = record?;
        let folder = sequence_folder(&record.clip);
        let name = sequence_name(&record.clip);
        let trajectory = KittiTrajectory::new(&rig, &record);
        files.write(&format!("{folder}/calib.txt"), calibration.as_bytes())?;
        files.write(&format!("{folder}/times.txt"), trajectory.time_lines().as_bytes())?;
        files.write(&poses(&name), trajectory.pose_lines(&rig).as_bytes())?;
        splits.entry(record.clip.split).or_default().push(name);
    }
    let text = serde_json::to_string_pretty(&splits).unwrap_or_default();
    files.write("splits.json", text.as_bytes())
}
