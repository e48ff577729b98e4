//! Sequences of the odometry benchmark and of SemanticKITTI.

use super::{KittiRig, KittiTrajectory};
use crate::{ClipInfo, ClipRecord, ClipStream, FileSink, SetError};
use std::collections::BTreeMap;

/// The name of a sequence: two digits, or more from the hundredth.
pub(in super::super) fn sequence_name(clip: &ClipInfo) -> String {
    format!("{:02}", clip.number)
}

/// The folder of a sequence.
pub(in super::super) fn sequence_folder(clip: &ClipInfo) -> String {
    format!("sequences/{}", sequence_name(clip))
}

/// Writes `calib.txt` and `times.txt` of each sequence, what `poses` writes of it, and
/// `splits.json`.
pub(in super::super) fn sequence_tables(
    rig: &KittiRig<'_>,
    clips: ClipStream<'_>,
    files: &mut dyn FileSink,
    poses: impl Fn(&ClipRecord, &KittiTrajectory, &mut dyn FileSink) -> Result<(), SetError>,
) -> Result<(), SetError> {
    let mut splits: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let calibration = rig.sequence_file();
    for record in clips {
        let record = record?;
        let folder = sequence_folder(&record.clip);
        let trajectory = KittiTrajectory::new(rig, &record);
        files.write(&format!("{folder}/calib.txt"), calibration.as_bytes())?;
        files.write(&format!("{folder}/times.txt"), trajectory.time_lines().as_bytes())?;
        poses(&record, &trajectory, files)?;
        splits.entry(record.clip.split.clone()).or_default().push(sequence_name(&record.clip));
    }
    let text = serde_json::to_string_pretty(&splits).unwrap_or_default();
    files.write("splits.json", text.as_bytes())
}
