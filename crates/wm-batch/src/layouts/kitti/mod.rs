//! Conventions that all layouts of the KITTI family share (Geiger et al. 2013, "Vision meets
//! robotics: the KITTI dataset").
//!
//! - Velodyne and IMU: x forward, y left, z up; cameras: x right, y down, z forward; metres. The
//!   IMU is the rig.
//! - `image_02` is the rig's first camera, `image_03` its second, `image_01` its third and
//!   `image_00` its fourth. What KITTI calls "camera 0, rectified" are the axes of the fourth
//!   camera, or of the first in a rig of fewer: then `P2 = K [I | 0]`. Readers rely on
//!   `P0 = K [I | 0]` (pykitti shifts its camera 0 by what `P0` says), so no other camera may be in
//!   `image_00`.
//! - `P_k` is `K_k [R | t]` from these axes to the pixels of camera k. With cameras in a row along
//!   x it is KITTI's own `K [I | -b]`. With turned cameras its left part is no intrinsic matrix:
//!   what multiplies points by `P_k` is right, what splits it into intrinsics and a baseline
//!   (pykitti's `K_camk` and `T_camk_velo`) is right for cameras parallel to camera 0, as
//!   everywhere with KITTI. The raw data has each camera's own `K`, `R` and `T` too.
//! - The centre of the first pixel is at (0, 0): half a pixel less than in [`crate::CameraInfo`].
//! - All readings of a frame bear its number; readings between frames are left out.

mod calibration;
mod oxts;
mod readings;
mod sequences;
#[cfg(test)]
mod tests;
mod trajectory;

pub(super) use calibration::KittiRig;
pub(super) use oxts::oxts_lines;
pub(super) use readings::{KittiFile, KittiFiles};
pub(super) use sequences::{sequence_folder, sequence_tables};
pub(super) use trajectory::{KittiTrajectory, times};

use crate::{SensorInfo, SetError, SetInfo, cameras};
use calibration::CAMERA_FOLDERS;

/// Sensors that a layout cannot do without.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum KittiNeed {
    /// A camera or a lidar.
    Any,
    /// A camera.
    Camera,
    /// A lidar.
    Lidar,
}

/// Checks that a set has what KITTI's layouts can hold.
pub(super) fn check(layout: &'static str, need: KittiNeed, set: &SetInfo) -> Result<(), SetError> {
    let refuse = |problem: String| Err(cameras::refuse(layout, problem));
    let rig = KittiRig::new(set);
    let count = |is: fn(&SensorInfo) -> bool| set.sensors.iter().filter(|sensor| is(sensor)).count();
    let (lidars, cameras) = (count(SensorInfo::is_lidar), count(|sensor| sensor.camera().is_some()));
    if cameras > CAMERA_FOLDERS.len() {
        return refuse(format!(
            "it holds 4 cameras and the rig has {cameras}: leave cameras out, or take the layout nuscenes"
        ));
    }
    if lidars > 1 {
        return refuse(format!(
            "it holds 1 lidar and the rig has {lidars}: leave lidars out, or take the layout nuscenes"
        ));
    }
    let (there, needed) = match need {
        KittiNeed::Camera => (cameras, "a camera"),
        KittiNeed::Lidar => (lidars, "a lidar"),
        KittiNeed::Any => (lidars + cameras, "a camera or a lidar"),
    };
    if there == 0 {
        return refuse(format!("it needs {needed}: add one to the rig"));
    }
    for sensor in rig.cameras.iter().chain(&rig.lidar).map(|index| &set.sensors[*index]) {
        let ratio = sensor.rate / set.frame_rate;
        if !(ratio > 0.999 && (ratio - ratio.round()).abs() < 1e-6 * ratio) {
            return refuse(format!(
                "sensor \"{}\" has {} Hz and frames {} Hz, but readings of a frame are of one time: give it the rate of frames or a \
                 multiple of it",
                sensor.name, sensor.rate, set.frame_rate
            ));
        }
        if sensor.camera().is_some_and(|camera| camera.lens.is_some()) {
            return refuse(format!(
                "camera \"{}\" has a lens, but pictures are rectified: give it a pinhole without distortion",
                sensor.name
            ));
        }
    }
    Ok(())
}
