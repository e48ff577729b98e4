//! Names of channels.

use crate::{SensorInfo, SensorInfoKind, SetInfo};
use glam::DVec3;

/// The channel of each sensor.
///
/// Cameras are named by the nearest of nuScenes' six directions, radars by the nearest of its five,
/// if no other sensor of the kind has the same; the first lidar is `LIDAR_TOP`, which the devkit
/// expects. All others have their own names.
pub(super) fn channels(set: &SetInfo) -> Vec<String> {
    let seen: Vec<Option<&'static str>> = set.sensors.iter().map(direction).collect();
    let first_lidar = set.sensors.iter().position(SensorInfo::is_lidar);
    let by_direction = |index: usize| match seen[index] {
        Some("LIDAR_TOP") => (first_lidar == Some(index)).then_some("LIDAR_TOP"),
        Some(name) => (seen.iter().filter(|other| **other == Some(name)).count() == 1).then_some(name),
        None => None,
    };
    let mut names: Vec<String> = (0..set.sensors.len())
        .map(|index| by_direction(index).map_or_else(|| own_name(&set.sensors[index]), String::from))
        .collect();
    // A sensor whose own name is another's direction: that one goes by its own name too.
    while let Some(index) = (0..names.len()).find(|index| {
        names.iter().filter(|name| **name == names[*index]).count() > 1
            && names[*index] != own_name(&set.sensors[*index])
    }) {
        names[index] = own_name(&set.sensors[index]);
    }
    names
}

/// nuScenes' channel in the direction of a sensor.
fn direction(sensor: &SensorInfo) -> Option<&'static str> {
    let pose = &sensor.rig_from_sensor;
    let (ahead, is_camera) = match sensor.kind {
        SensorInfoKind::Camera(_) => (pose.rotation * DVec3::Z, true),
        SensorInfoKind::Radar { .. } => (pose.rotation * DVec3::X, false),
        SensorInfoKind::Lidar { .. } => return Some("LIDAR_TOP"),
        SensorInfoKind::Other { .. } => return None,
    };
    if ahead.z.abs() > std::f64::consts::FRAC_1_SQRT_2 {
        return None;
    }
    let yaw = ahead.y.atan2(ahead.x).to_degrees();
    Some(match (is_camera, yaw.abs(), yaw > 0.0) {
        // Halfway between 0, 55, 110 and 180 degrees.
        (true, ..=27.5, _) => "CAM_FRONT",
        (true, ..=82.5, true) => "CAM_FRONT_LEFT",
        (true, ..=82.5, false) => "CAM_FRONT_RIGHT",
        (true, ..=145.0, true) => "CAM_BACK_LEFT",
        (true, ..=145.0, false) => "CAM_BACK_RIGHT",
        (true, ..) => "CAM_BACK",
        (false, ..=45.0, _) => "RADAR_FRONT",
        (false, ..=135.0, true) => "RADAR_FRONT_LEFT",
        (false, ..=135.0, false) => "RADAR_FRONT_RIGHT",
        // Both look back; the side that they are on tells them apart.
        (false, ..) if pose.translation.y > 0.05 => "RADAR_BACK_LEFT",
        (false, ..) if pose.translation.y < -0.05 => "RADAR_BACK_RIGHT",
        (false, ..) => return None,
    })
}

fn own_name(sensor: &SensorInfo) -> String {
    let kind = if sensor.camera().is_some() { "CAM" } else { sensor.kind.name() };
    let [prefix, name] = [format!("{kind}_"), sensor.name.replace('-', "_")].map(|name| name.to_uppercase());
    if name.starts_with(&prefix) { name } else { prefix + &name }
}
