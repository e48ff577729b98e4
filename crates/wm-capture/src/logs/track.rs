//! Poses over time: of the vehicle and of the boxes around others.

use crate::RigidPose;
use glam::DVec3;

/// Longest time beyond the first and last pose of a vehicle for which it is believed to go on
/// evenly, ns.
const MAX_POSE_EXTRAPOLATION_NS: u64 = 150_000_000;
/// Longest time between two boxes of a track between which it is interpolated, ns.
const MAX_BOX_GAP_NS: u64 = 1_050_000_000;
/// Longest time beyond the first and last box of a track, ns.
const MAX_BOX_EXTRAPOLATION_NS: u64 = 260_000_000;
/// Time over which the speed of a box is measured, at least, ns: boxes of single sweeps jitter.
const MIN_SPEED_BASELINE_NS: u64 = 450_000_000;
/// Least speed of a moving box, m/s.
const MIN_MOVING_SPEED_M_S: f64 = 0.5;

/// The poses of a vehicle: `world_from_rig` over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct EgoTrack {
    /// Nanoseconds and poses, in the order of time, each time once.
    poses: Vec<(i64, RigidPose)>,
}

impl EgoTrack {
    /// A track of poses in any order.
    #[must_use]
    pub fn new(mut poses: Vec<(i64, RigidPose)>) -> Self {
        poses.sort_by_key(|(time, _)| *time);
        poses.dedup_by_key(|(time, _)| *time);
        Self { poses }
    }

    /// The pose at a time, ns: between two poses straight ahead and turning evenly, and so up to
    /// 150 ms before the first and after the last. `None` beyond that.
    #[must_use]
    pub fn at(&self, time: i64) -> Option<RigidPose> {
        let after = self.poses.partition_point(|(own, _)| *own <= time);
        let [first, second] = match self.poses.len() {
            0 => return None,
            1 => [0, 0],
            count => {
                let second = after.clamp(1, count - 1);
                [second - 1, second]
            }
        };
        let [(t0, a), (t1, b)] = [self.poses[first], self.poses[second]];
        let [start, end] = [self.poses[0].0, self.poses[self.poses.len() - 1].0];
        if time.clamp(start, end).abs_diff(time) > MAX_POSE_EXTRAPOLATION_NS {
            return None;
        }
        if time == t1 {
            return Some(b);
        }
        if t0 == t1 {
            return Some(a);
        }
        // In floating-point numbers, since a time before the first is negative from there.
        let share = (i128::from(time) - i128::from(t0)) as f64 / t0.abs_diff(t1) as f64;
        Some(between(a, b, share))
    }
}

/// Something around the vehicle that has a box at several times.
#[derive(Clone, Debug, PartialEq)]
pub struct LogTrack {
    /// The name in the log.
    pub id: String,
    /// The category, as the log has it.
    pub category: String,
    /// True if it moves at any time of the log, or is of a kind that does: people, animals, riders.
    pub is_mover: bool,
    /// The boxes, in the order of time.
    pub boxes: Vec<LogBox>,
}

/// A box around something at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LogBox {
    /// Nanoseconds.
    pub timestamp: i64,
    /// From its middle, with x along its length and z up.
    pub world_from_box: RigidPose,
    /// Length, width and height, m.
    pub size: DVec3,
}

impl LogTrack {
    /// A track of boxes in any order. It moves if one of its boxes goes faster than 0.5 m/s, or by
    /// its category.
    #[must_use]
    pub fn new(id: String, category: String, mut boxes: Vec<LogBox>) -> Self {
        boxes.sort_by_key(|own| own.timestamp);
        boxes.dedup_by_key(|own| own.timestamp);
        let is_mover = is_living(&category) || has_moved(&boxes);
        Self { id, category, is_mover, boxes }
    }

    /// The box at a time, ns: interpolated between boxes at most a second apart, and held for a
    /// quarter of a second at both ends.
    #[must_use]
    pub fn at(&self, time: i64) -> Option<LogBox> {
        let size = self.boxes.iter().min_by_key(|own| own.timestamp.abs_diff(time))?.size;
        let pose = |own: &LogBox| (own.timestamp, own.world_from_box);
        let world_from_box = interpolate(&self.boxes, time, pose)?;
        Some(LogBox { timestamp: time, world_from_box, size })
    }
}

impl LogBox {
    /// Returns true if a point is in the box, its sides longer by a share.
    #[must_use]
    pub(crate) fn has(&self, point: DVec3, more: f64) -> bool {
        let own = self.world_from_box.inverse().point(point).abs();
        own.cmple(0.5 * (1.0 + more) * self.size).all()
    }

    /// The corners of the box, world axes, its sides longer by a share. Bits of the index: beyond
    /// the middle along x, y, z.
    #[must_use]
    pub(crate) fn corners(&self, more: f64) -> [DVec3; 8] {
        let half = 0.5 * (1.0 + more) * self.size;
        std::array::from_fn(|index| {
            let side = |axis: usize| if index >> axis & 1 == 1 { 1.0 } else { -1.0 };
            self.world_from_box.point(half * DVec3::new(side(0), side(1), side(2)))
        })
    }
}

/// Returns true for kinds that move even when they stand.
fn is_living(category: &str) -> bool {
    const MOVER_CATEGORIES: [&str; 12] = [
        "human",
        "pedestrian",
        "person",
        "people",
        "cyclist",
        "motorcyclist",
        "rider",
        "animal",
        "dog",
        "stroller",
        "wheelchair",
        "signaler",
    ];
    let category = category.to_ascii_lowercase();
    MOVER_CATEGORIES.iter().any(|kind| category.contains(kind))
}

fn has_moved(boxes: &[LogBox]) -> bool {
    let mut later = 0;
    boxes.iter().any(|first| {
        while boxes.get(later).is_some_and(|box_| {
            first.timestamp.abs_diff(box_.timestamp) < MIN_SPEED_BASELINE_NS
                || box_.timestamp < first.timestamp
        }) {
            later += 1;
        }
        boxes.get(later).is_some_and(|second| {
            let seconds = second.timestamp.abs_diff(first.timestamp) as f64 * 1e-9;
            let way = second.world_from_box.translation.distance(first.world_from_box.translation);
            way > MIN_MOVING_SPEED_M_S * seconds
        })
    })
}

/// The pose at a time, of entries in the order of time; `None` more than
/// [`MAX_BOX_EXTRAPOLATION_NS`] beyond the ends, or between two that are farther apart than
/// [`MAX_BOX_GAP_NS`].
fn interpolate<T>(entries: &[T], time: i64, of: impl Fn(&T) -> (i64, RigidPose)) -> Option<RigidPose> {
    let after = entries.partition_point(|entry| of(entry).0 <= time);
    let held = |entry: &T| {
        let (at, pose) = of(entry);
        (at.abs_diff(time) <= MAX_BOX_EXTRAPOLATION_NS).then_some(pose)
    };
    let Some(second) = entries.get(after) else { return entries.last().and_then(held) };
    let Some(first) = after.checked_sub(1).map(|before| &entries[before]) else { return held(second) };
    let ((t0, a), (t1, b)) = (of(first), of(second));
    if t0.abs_diff(t1) > MAX_BOX_GAP_NS {
        return held(first).or_else(|| held(second));
    }
    Some(between(a, b, time.abs_diff(t0) as f64 / t1.abs_diff(t0) as f64))
}

/// A pose that is a share of the way from one to another; beyond them where it is below 0 or above
/// 1.
fn between(a: RigidPose, b: RigidPose, share: f64) -> RigidPose {
    RigidPose {
        rotation: a.rotation.slerp(b.rotation, share).normalize(),
        translation: a.translation.lerp(b.translation, share),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn pose(x: f64, angle: f64) -> RigidPose {
        RigidPose { rotation: DQuat::from_rotation_z(angle), translation: DVec3::new(x, 0.0, 0.0) }
    }

    #[test]
    fn poses_are_interpolated() {
        let track = EgoTrack::new(vec![(2_000_000_000, pose(4.0, 0.3)), (1_000_000_000, pose(2.0, 0.1))]);
        let middle = track.at(1_250_000_000).unwrap();
        assert!(middle.translation.distance(DVec3::new(2.5, 0.0, 0.0)) < 1e-12);
        assert!(middle.rotation.angle_between(DQuat::from_rotation_z(0.15)) < 1e-7);
        assert_eq!(track.at(1_000_000_000), Some(pose(2.0, 0.1)));
        assert_eq!(track.at(2_000_000_000), Some(pose(4.0, 0.3)));
        // A vehicle goes on as it went.
        for (time, x, angle) in [(900_000_000, 1.8, 0.08), (2_100_000_000, 4.2, 0.32)] {
            let beyond = track.at(time).unwrap();
            assert!(beyond.translation.distance(DVec3::new(x, 0.0, 0.0)) < 1e-12);
            assert!(beyond.rotation.angle_between(DQuat::from_rotation_z(angle)) < 1e-7);
        }
        assert_eq!((track.at(2_200_000_000), track.at(800_000_000)), (None, None));
        assert_eq!(EgoTrack::new(vec![(5, pose(4.0, 0.3))]).at(100_000_000), Some(pose(4.0, 0.3)));
        assert_eq!(track.at(i64::MIN), None);
        assert_eq!(EgoTrack::default().at(0), None);
    }

    #[test]
    fn what_moves_is_found() {
        let boxed = |way: f64, category: &str| {
            let own = |k: i64| LogBox {
                timestamp: k * 100_000_000,
                // Annotations jitter by some centimetres.
                world_from_box: pose(way * k as f64 + 0.05 * (k % 2) as f64, 0.0),
                size: DVec3::ONE,
            };
            LogTrack::new("a".into(), category.into(), (0..20).map(own).collect())
        };
        assert!(!boxed(0.0, "REGULAR_VEHICLE").is_mover);
        assert!(boxed(0.1, "REGULAR_VEHICLE").is_mover);
        assert!(boxed(0.0, "human.pedestrian.adult").is_mover);
        let track = boxed(0.1, "car");
        assert!(track.at(1_950_000_000).is_some() && track.at(2_300_000_000).is_none());
        let own = track.at(1_000_000_000).unwrap();
        assert!(own.has(DVec3::new(1.55, 0.0, 0.0), 0.15) && !own.has(DVec3::new(1.6, 0.0, 0.0), 0.15));
        assert_eq!(own.corners(0.0)[7], DVec3::new(1.5, 0.5, 0.5));
    }
}
