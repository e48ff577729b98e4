//! TartanAir (the first edition): one trajectory a clip, a camera and its stereo partner.
//!
//! `CLIP/SPLIT/P000/` has `image_left/%06d_left.png`, `depth_left/%06d_left_depth.npy`,
//! `flow/%06d_%06d_flow.npy` with `flow/%06d_%06d_mask.npy`, `pose_left.txt`, the same with `right`
//! (but for flow) if there is a partner, and `intrinsics.txt`, which TartanAir does not have since
//! all of its cameras are alike: `fx fy cx cy`, px, and the baseline, m, 0 without a partner.
//!
//! - The first camera of the rig is the left one; the first with the same intrinsics and
//!   orientation that stands to its right is the right one. Others, lidars and radars are left out.
//! - Poses are `tx ty tz qx qy qz qw` of the camera in the world, m, a line a picture. Both have
//!   north-east-down axes: the world's x is our y (north), its y our x (east); a camera has x
//!   forward, y right and z down.
//! - Depth is f32 along the view axis, m, 10000 where there is nothing, as for TartanAir's sky.
//!   Flow is f32 `[H, W, 2]`, px, from a picture to the next; the mask is u8 `[H, W]`, 0 where the
//!   point is seen there, 1 where something hides it or there is no vector, 100 where it is out of
//!   the picture. The last picture has no flow.
//! - The principal point counts from the corner of the first pixel: TartanAir has 320, 240 in
//!   pictures of 640x480.
//!
//! Source: github.com/castacks/tartanair_tools, data_type.md.

use super::{BlockWriter, ClipStream, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, check_cameras, check_pinholes, layer, picture};
use crate::{
    BlockInfo, CameraInfo, ClipInfo, ClipRecord, RigidPose, SensorInfo, SensorReading, SetError, SetInfo,
};
use crate::{array_files, picture_files};
use glam::{DMat3, DVec3};
use std::fmt::Write;

const NAME: &str = "tartanair";
/// The value of pixels that leave the picture, in masks of flow.
const OUTSIDE_FLOW: u8 = 100;

/// The depth of what is farther than all else, m.
const SKY_DEPTH_M: f32 = 10_000.0;

/// Radians by which partners may differ in orientation, and m by which they may be off the line to
/// the right.
const STEREO_TOLERANCE: f64 = 1e-3;

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "TartanAir trajectories: pictures, depth, flow and poses of one camera and its stereo partner",
    needs: LayerNeeds { depth: true, flow: true, ..LayerNeeds::NONE },
    needs_every_sensor: true,
    check: |set| check_cameras(NAME, set).and_then(|()| check_pinholes(NAME, set)),
    block,
    tables,
};

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    for record in clips {
        let ClipRecord { clip, readings } = record?;
        let folder = folder(&clip);
        let eyes = eyes(set);
        for (sensor, side) in &eyes {
            let mut text = String::new();
            for info in readings.iter().filter(|info| info.sensor == *sensor) {
                let pose = ned(&info.world_from_sensor(set));
                let numbers = pose.translation.to_array().into_iter().chain(pose.rotation.to_array());
                let numbers: Vec<String> = numbers.map(|number| number.to_string()).collect();
                let _ = writeln!(text, "{}", numbers.join(" "));
            }
            files.write(&format!("{folder}/pose_{side}.txt"), text.as_bytes())?;
        }
        if let Some((_, _, CameraInfo { focal: [fx, fy], center: [cx, cy], .. })) = cameras(set).next() {
            let baseline = match eyes[..] {
                [(left, _), (right, _)] => to_right(&set.sensors[left], &set.sensors[right]).x,
                _ => 0.0,
            };
            let text = format!("{fx} {fy} {cx} {cy} {baseline}\n");
            files.write(&format!("{folder}/intrinsics.txt"), text.as_bytes())?;
        }
    }
    Ok(())
}

/// The folder of a clip.
fn folder(clip: &ClipInfo) -> String {
    format!("{}/{}/P000", clip.name, clip.split)
}

/// The cameras that are written, with their sides.
fn eyes(set: &SetInfo) -> Vec<(usize, &'static str)> {
    let Some((left, sensor, camera)) = cameras(set).next() else { return Vec::new() };
    let partner = cameras(set).find(|(_, other, other_camera)| {
        let turn = sensor.rig_from_sensor.rotation.angle_between(other.rig_from_sensor.rotation);
        let shift = to_right(sensor, other);
        *other_camera == camera
            && turn < STEREO_TOLERANCE
            && shift.x > STEREO_TOLERANCE
            && shift.y.hypot(shift.z) < STEREO_TOLERANCE
    });
    let right = partner.map(|(right, _, _)| (right, "right"));
    [(left, "left")].into_iter().chain(right).collect()
}

/// The place of another camera in the axes of one.
fn to_right(sensor: &SensorInfo, other: &SensorInfo) -> DVec3 {
    sensor.rig_from_sensor.inverse().point(other.rig_from_sensor.translation)
}

/// A camera's pose in the axes of TartanAir.
fn ned(world_from_camera: &RigidPose) -> RigidPose {
    let ned_from_world = DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::NEG_Z);
    let camera_from_ned = DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y);
    let axes = ned_from_world * DMat3::from_quat(world_from_camera.rotation) * camera_from_ned;
    RigidPose::new(axes, ned_from_world * world_from_camera.translation)
}

fn block(block: BlockInfo<'_>) -> Box<dyn BlockWriter + '_> {
    let BlockInfo { set, clip, .. } = block;
    let eyes = eyes(set);
    Box::new(move |reading: &SensorReading<'_>, files: &mut dyn FileSink| {
        let info = &reading.info;
        let Some((_, side)) = eyes.iter().find(|(eye, _)| *eye == info.sensor) else { return Ok(()) };
        let Some((sensor, camera, picture)) = picture(set, reading) else { return Ok(()) };
        let (folder, index) = (folder(clip), info.index);
        let (width, height) = (camera.size.0 as usize, camera.size.1 as usize);
        let png = picture_files::png(sensor, camera, picture.rgb)?;
        files.write(&format!("{folder}/image_{side}/{index:06}_{side}.png"), &png)?;
        let depth = layer(sensor, camera, picture.depth, 1, "depth")?;
        let depth = depth.iter().map(|depth| if *depth > 0.0 { *depth } else { SKY_DEPTH_M });
        let bytes = array_files::floats(depth, &[height, width]);
        files.write(&format!("{folder}/depth_{side}/{index:06}_{side}_depth.npy"), &bytes)?;
        let is_last = info.time + 1.0 / sensor.rate > clip.seconds - 1e-6;
        if *side == "left" && !is_last {
            let flow = layer(sensor, camera, picture.flow, 2, "flow")?;
            let pairs = flow.as_chunks::<2>().0;
            let is_known = |pair: &[f32; 2]| pair.iter().all(|value| value.is_finite());
            let known = pairs.iter().flat_map(|pair| if is_known(pair) { *pair } else { [0.0; 2] });
            let states = picture.flow_states.unwrap_or_default();
            let state = |pixel: usize| states.get(pixel).copied().unwrap_or(0);
            let masked = |pixel: usize| match state(pixel) {
                _ if !is_known(&pairs[pixel]) => 1,
                2 => OUTSIDE_FLOW,
                state => u8::from(state > 0),
            };
            let mask: Vec<u8> = (0..pairs.len()).map(masked).collect();
            let name = format!("{folder}/flow/{index:06}_{:06}", index + 1);
            files.write(&format!("{name}_flow.npy"), &array_files::floats(known, &[height, width, 2]))?;
            files.write(&format!("{name}_mask.npy"), &array_files::bytes(&mask, &[height, width]))?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{self, SPOT};
    use glam::DQuat;

    #[test]
    fn the_spot_is_where_poses_say() {
        let files = testing::written(&LAYOUT, 8);
        let set = testing::set();
        let folder = folder(&testing::clips()[0]);
        let text = String::from_utf8(files[&format!("{folder}/pose_left.txt")].clone()).unwrap();
        let readings: Vec<_> = testing::readings(&set).into_iter().filter(|info| info.sensor == 0).collect();
        assert_eq!(text.lines().count(), readings.len());
        let (_, _, camera) = cameras(&set).next().unwrap();
        let mut seen = testing::SpotCount::default();
        for (line, info) in text.lines().zip(readings) {
            let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
            let [x, y, z, qx, qy, qz, qw] = numbers[..] else { panic!("{line}") };
            let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
            let pose = RigidPose { rotation, translation: DVec3::new(x, y, z) };
            let local = pose.inverse().point(DVec3::new(SPOT.y, SPOT.x, -SPOT.z));
            let truth = testing::spot_in(&set, &info);
            // Forward, right and down.
            assert!((local - DVec3::new(truth.z, truth.x, truth.y)).length() < 1e-9);
            seen.add(&set, &info, testing::project(camera, DVec3::new(local.y, local.z, local.x)));
        }
        let count = |part: &str| files.keys().filter(|path| path.contains(part)).count();
        assert_eq!([count("_left.png"), count("_left_depth.npy"), count("_flow.npy")], [40, 40, 38]);
        assert_eq!(files[&format!("{folder}/depth_left/000003_left_depth.npy")].len(), 128 + 4 * 64 * 40);
    }

    #[test]
    fn a_partner_to_the_right_is_found() {
        let mut set = testing::set();
        set.sensors[2].rig_from_sensor = set.sensors[0].rig_from_sensor;
        assert_eq!(eyes(&set), [(0, "left")]);
        set.sensors[2].rig_from_sensor.translation.y -= 0.25;
        assert_eq!(eyes(&set), [(0, "left"), (2, "right")]);
    }
}
