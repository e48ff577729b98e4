//! Boxes of KITTI raw: `tracklet_labels.xml` of a drive.
//!
//! `<tracklets>` has an `<item>` for each track with `objectType`, `h`, `w`, `l` (m), `first_frame`
//! and `<poses>`, of which each `<item>` has `tx`, `ty`, `tz` (m) and `rz` (radians) in the lidar's
//! axes of one frame after the other; the place is the middle of the box's floor.

use super::files::{excerpt, fault_in_line, read_text};
use super::track::{LogBox, LogTrack};
use crate::RigidPose;
use glam::{DQuat, DVec3};
use std::path::Path;
use wm_base::FormatError;

/// Deepest nesting, and most tracks and boxes.
const MAX_NESTING: usize = 16;
const MAX_BOXES: usize = 1_000_000;

/// A track while it is read.
#[derive(Default)]
struct Tracklet {
    kind: String,
    /// Length, width, height, m.
    size: DVec3,
    first: usize,
    /// Place and angle of each frame.
    poses: Vec<(DVec3, f64)>,
}

/// Reads the tracks; none if there is no file. `at` gives the time, ns, and `world_from_lidar` of a
/// frame.
pub(super) fn read_tracklets(
    path: &Path,
    at: impl Fn(usize) -> Option<(i64, RigidPose)>,
) -> Result<Vec<LogTrack>, FormatError> {
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let text = read_text(path)?;
    let (mut line, mut count) = (1, 0);
    let mut open: Vec<&str> = Vec::new();
    let (mut tracks, mut track, mut pose) = (Vec::new(), Tracklet::default(), (DVec3::ZERO, 0.0));
    for part in text.split('<').skip(1) {
        let fault = |what: String| fault_in_line(path, line, what);
        let Some((tag, value)) = part.split_once('>') else {
            return Err(fault("a tag without its end".into()));
        };
        let number = || {
            let number = value.trim().parse::<f64>().ok().filter(|value| value.abs() < 1e6);
            number.ok_or_else(|| fault(format!("\"{}\" is not a number", excerpt(value.trim()))))
        };
        let name = tag.split_whitespace().next().unwrap_or_default();
        if let Some(name) = name.strip_prefix('/') {
            if open.pop() != Some(name) {
                return Err(fault(format!("</{}> closes nothing that is open", excerpt(name))));
            }
            match (open.as_slice(), name) {
                ([.., "tracklets", "item", "poses"], "item") => track.poses.push(std::mem::take(&mut pose)),
                ([.., "tracklets"], "item") => {
                    let id = format!("{:06}", tracks.len());
                    tracks.push(finished(id, std::mem::take(&mut track), &at));
                }
                _ => {}
            }
        } else if !name.starts_with(['?', '!']) && !tag.ends_with('/') {
            match (open.as_slice(), name) {
                ([.., "tracklets", "item", "poses", "item"], "tx") => pose.0.x = number()?,
                ([.., "tracklets", "item", "poses", "item"], "ty") => pose.0.y = number()?,
                ([.., "tracklets", "item", "poses", "item"], "tz") => pose.0.z = number()?,
                ([.., "tracklets", "item", "poses", "item"], "rz") => pose.1 = number()?,
                ([.., "tracklets", "item"], "objectType") => track.kind = excerpt(value.trim()),
                ([.., "tracklets", "item"], "l") => track.size.x = number()?.abs(),
                ([.., "tracklets", "item"], "w") => track.size.y = number()?.abs(),
                ([.., "tracklets", "item"], "h") => track.size.z = number()?.abs(),
                ([.., "tracklets", "item"], "first_frame") => track.first = number()?.max(0.0) as usize,
                _ => {}
            }
            open.push(name);
            count += 1;
            if open.len() > MAX_NESTING || count > 32 * MAX_BOXES || tracks.len() > MAX_BOXES {
                return Err(fault("it is nested too deeply, or too long".into()));
            }
        }
        line += part.matches('\n').count();
    }
    Ok(tracks)
}

fn finished(id: String, track: Tracklet, at: &impl Fn(usize) -> Option<(i64, RigidPose)>) -> LogTrack {
    let own = |index: usize, floor: &DVec3, angle: &f64| {
        let (timestamp, world_from_lidar) = at(track.first.saturating_add(index))?;
        let middle = *floor + DVec3::Z * 0.5 * track.size.z;
        let lidar_from_box = RigidPose { rotation: DQuat::from_rotation_z(*angle), translation: middle };
        Some(LogBox { timestamp, world_from_box: world_from_lidar.then(&lidar_from_box), size: track.size })
    };
    let poses = track.poses.iter().enumerate();
    let boxes = poses.filter_map(|(index, (floor, angle))| own(index, floor, angle)).collect();
    LogTrack::new(id, track.kind, boxes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_name_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.xml");
        let say = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let read = read_tracklets(&path, |_| Some((0, RigidPose::IDENTITY)));
            read.map(|tracks| tracks.len())
                .map_err(|e| e.to_string().replace(&path.display().to_string(), "F"))
        };
        assert_eq!(say("<?xml version=\"1.0\"?>\n<tracklets><count>0</count></tracklets>"), Ok(0));
        assert_eq!(say("<tracklets>\n<item><h>x</h>"), Err("F, line 2: \"x\" is not a number".into()));
        assert_eq!(
            say("<tracklets>\n\n</item>"),
            Err("F, line 3: </item> closes nothing that is open".into())
        );
        assert_eq!(say("<tracklets"), Err("F, line 1: a tag without its end".into()));
        assert!(say(&"<a>".repeat(20)).is_err());
    }
}
