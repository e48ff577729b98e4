//! Packets of the GPS/IMU unit, made from poses.

use super::KittiTrajectory;
use crate::{ClipRecord, RigidPose};
use glam::{DQuat, DVec3};

/// Radius of the Earth of KITTI's Mercator projection, m.
const EARTH_RADIUS: f64 = 6_378_137.0;
/// Gravity, which an accelerometer at rest reads, m/s^2.
const GRAVITY: DVec3 = DVec3::new(0.0, 0.0, 9.806_65);

/// One packet a frame, 30 numbers: latitude, longitude (degrees), altitude (m), roll, pitch, yaw
/// (radians; yaw 0 is east, R = Rz Ry Rx), velocities to the north, the east, forward, left and up
/// (m/s), accelerations along the rig's axes and along level ones (m/s^2, with gravity), turn rates
/// in the same two (radians/s), two accuracies, and five integers: the state of the receiver (4:
/// locked), satellites and three modes.
///
/// Latitudes and longitudes are those from which KITTI's Mercator projection, whose scale is the
/// cosine of the first frame's latitude, finds the poses again. The world's x is taken as east; a
/// place without an origin is put to 0, 0, 0.
pub(in super::super) fn oxts_lines(record: &ClipRecord, trajectory: &KittiTrajectory) -> Vec<String> {
    let frames = &trajectory.frames;
    let Some(first) = frames.first() else {
        return Vec::new();
    };
    let [latitude, longitude, altitude] = record.clip.place.origin.unwrap_or_default();
    let origin = Place { latitude, longitude };
    let start = origin.moved(first.world_from_rig.translation);
    let poses: Vec<(f64, RigidPose)> =
        frames.iter().map(|frame| (frame.time, frame.world_from_rig)).collect();
    let packet = |index: usize| {
        let pose = poses[index].1;
        let place = start.moved(pose.translation - first.world_from_rig.translation);
        let (yaw, pitch, roll) = pose.rotation.to_euler(glam::EulerRot::ZYX);
        let motion = Motion::new(&poses, index);
        let level = DQuat::from_rotation_z(yaw).conjugate();
        let body = pose.rotation.conjugate();
        let felt = motion.acceleration + GRAVITY;
        let mut numbers =
            vec![place.latitude, place.longitude, altitude + pose.translation.z, roll, pitch, yaw];
        numbers.extend([motion.velocity.y, motion.velocity.x]);
        for vector in [
            level * motion.velocity,
            body * felt,
            level * felt,
            body * motion.turn_rate,
            level * motion.turn_rate,
        ] {
            numbers.extend(vector.to_array());
        }
        numbers.extend([0.0; 2]);
        let text: Vec<String> = numbers.iter().map(|number| (number + 0.0).to_string()).collect();
        format!("{} 4 0 0 0 0\n", text.join(" "))
    };
    (0..frames.len()).map(packet).collect()
}

/// A place on Earth, degrees.
#[derive(Clone, Copy)]
struct Place {
    latitude: f64,
    longitude: f64,
}

impl Place {
    /// The place so many metres to the east and the north on a Mercator map that is true to scale
    /// here.
    fn moved(self, by: DVec3) -> Self {
        let metres = EARTH_RADIUS * self.latitude.to_radians().cos();
        let north = self.latitude.to_radians().tan().asinh() + by.y / metres;
        Self {
            latitude: north.sinh().atan().to_degrees(),
            longitude: self.longitude + (by.x / metres).to_degrees(),
        }
    }
}

/// Derivatives of poses by their neighbours, world axes.
struct Motion {
    /// m/s.
    velocity: DVec3,
    /// m/s^2.
    acceleration: DVec3,
    /// Radians/s.
    turn_rate: DVec3,
}

impl Motion {
    fn new(poses: &[(f64, RigidPose)], index: usize) -> Self {
        let last = poses.len() - 1;
        let ((before_time, before), (after_time, after)) =
            (poses[index.saturating_sub(1)], poses[(index + 1).min(last)]);
        let seconds = after_time - before_time;
        if seconds <= 0.0 {
            return Self { velocity: DVec3::ZERO, acceleration: DVec3::ZERO, turn_rate: DVec3::ZERO };
        }
        let turn = (after.rotation * before.rotation.conjugate()).to_scaled_axis();
        // At the ends, the acceleration of the next frame inside.
        let middle = index.clamp(1.min(last), last.saturating_sub(1).max(1.min(last)));
        let acceleration = if middle >= 1 && middle < last {
            let step = |from: usize| {
                let (a, b) = (poses[from], poses[from + 1]);
                ((b.1.translation - a.1.translation) / (b.0 - a.0), 0.5 * (a.0 + b.0))
            };
            let ((v0, t0), (v1, t1)) = (step(middle - 1), step(middle));
            (v1 - v0) / (t1 - t0)
        } else {
            DVec3::ZERO
        };
        Self {
            velocity: (after.translation - before.translation) / seconds,
            acceleration,
            turn_rate: turn / seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn packets_tell_the_motion() {
        let (set, clip) = (testing::set(), testing::clips()[0].clone());
        let record = ClipRecord { clip, readings: testing::readings(&set) };
        let trajectory = KittiTrajectory::new(&super::super::KittiRig::new(&set), &record);
        let lines = oxts_lines(&record, &trajectory);
        let numbers = |line: &str| line.split(' ').map(|n| n.trim().parse().unwrap()).collect::<Vec<f64>>();
        let packets: Vec<Vec<f64>> = lines.iter().map(|line| numbers(line)).collect();
        assert!(packets.iter().all(|packet| packet.len() == 30));
        let metres_of = |packet: &[f64]| {
            let scale = packets[0][0].to_radians().cos() * EARTH_RADIUS;
            DVec3::new(
                scale * packet[1].to_radians(),
                scale * (std::f64::consts::FRAC_PI_4 + 0.5 * packet[0].to_radians()).tan().ln(),
                packet[2],
            )
        };
        for (frame, packet) in trajectory.frames.iter().zip(&packets) {
            let expected = frame.world_from_rig.translation - trajectory.frames[0].world_from_rig.translation;
            assert!((metres_of(packet) - metres_of(&packets[0])).distance(expected) < 1e-6);
            let rotation = DQuat::from_rotation_z(packet[5])
                * DQuat::from_rotation_y(packet[4])
                * DQuat::from_rotation_x(packet[3]);
            assert!(rotation.angle_between(frame.world_from_rig.rotation) < 1e-6);
        }
        // x = 10 + 8 t, y = -4 + t^2, z = 0.2 t and a yaw of 0.3 t, at t = 0.5.
        let packet = &packets[5];
        let (sine, cosine) = 0.15f64.sin_cos();
        for (index, expected) in [
            (6, 1.0),
            (7, 8.0),
            (8, 8.0 * cosine + sine),
            (9, -8.0 * sine + cosine),
            (10, 0.2),
            (14, 2.0 * sine),
            (15, 2.0 * cosine),
            (16, 9.80665),
            (22, 0.3),
        ] {
            assert!((packet[index] - expected).abs() < 1e-6, "{index}: {} {expected}", packet[index]);
        }
    }
}
