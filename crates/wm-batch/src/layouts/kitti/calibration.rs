//! Calibration files.

use crate::cameras::cameras;
use crate::{CameraInfo, RigidPose, SensorInfo, SetInfo};
use glam::{DMat3, DVec3};
use std::fmt::Write;

/// The numbers of the folders of cameras in the order of the rig.
pub(super) const CAMERA_FOLDERS: [usize; 4] = [2, 3, 1, 0];

/// The sensors of a rig in KITTI's terms.
pub(in super::super) struct KittiRig<'a> {
    set: &'a SetInfo,
    /// Indices of the cameras, at most four, in the order of [`CAMERA_FOLDERS`].
    pub(super) cameras: Vec<usize>,
    /// Index of the lidar.
    pub(in super::super) lidar: Option<usize>,
    /// The axes of "camera 0, rectified".
    pub(super) rig_from_camera0: RigidPose,
    /// The axes of points; those of the rig without a lidar.
    rig_from_velodyne: RigidPose,
}

impl<'a> KittiRig<'a> {
    pub(in super::super) fn new(set: &'a SetInfo) -> Self {
        let cameras: Vec<usize> =
            cameras(set).map(|(index, _, _)| index).take(CAMERA_FOLDERS.len()).collect();
        let lidar = set.sensors.iter().position(SensorInfo::is_lidar);
        let pose = |index: usize| set.sensors[index].rig_from_sensor;
        let rig_from_velodyne = lidar.map_or(RigidPose::IDENTITY, pose);
        // Without cameras, a camera at the lidar that looks ahead.
        let optical = RigidPose::new(DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X), DVec3::ZERO);
        let rig_from_camera0 = cameras
            .get(3)
            .or(cameras.first())
            .map_or_else(|| rig_from_velodyne.then(&optical), |index| pose(*index));
        Self { set, cameras, lidar, rig_from_camera0, rig_from_velodyne }
    }

    /// The number of a camera's folder.
    pub(super) fn slot(&self, sensor: usize) -> Option<usize> {
        self.cameras.iter().position(|index| *index == sensor).map(|place| CAMERA_FOLDERS[place])
    }

    /// Sensors with their folders' numbers.
    pub(in super::super) fn slots(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.cameras.iter().copied().zip(CAMERA_FOLDERS)
    }

    /// The camera of a folder's number, or the first where the rig has none: files list all four.
    fn camera(&self, slot: usize) -> Option<(RigidPose, CameraInfo)> {
        let place = CAMERA_FOLDERS.iter().position(|number| *number == slot)?;
        let sensor = &self.set.sensors[*self.cameras.get(place).or(self.cameras.first())?];
        Some((sensor.rig_from_sensor, *sensor.camera()?))
    }

    /// Camera k from camera 0.
    fn camera_from_camera0(&self, slot: usize) -> RigidPose {
        self.camera(slot).map_or(RigidPose::IDENTITY, |(rig_from_camera, _)| {
            rig_from_camera.inverse().then(&self.rig_from_camera0)
        })
    }

    fn intrinsics(&self, slot: usize) -> DMat3 {
        self.camera(slot).map_or(DMat3::IDENTITY, |(_, camera)| {
            let ([fx, fy], [cx, cy]) = (camera.focal, camera.center);
            DMat3::from_cols(DVec3::X * fx, DVec3::Y * fy, DVec3::new(cx - 0.5, cy - 0.5, 1.0))
        })
    }

    /// The rows of `P_k`, 3x4.
    fn projection(&self, slot: usize) -> [f64; 12] {
        let (pose, k) = (self.camera_from_camera0(slot), self.intrinsics(slot));
        rows(k * DMat3::from_quat(pose.rotation), k * pose.translation)
    }

    fn camera0_from_velodyne(&self) -> RigidPose {
        self.rig_from_camera0.inverse().then(&self.rig_from_velodyne)
    }

    fn velodyne_from_rig(&self) -> RigidPose {
        self.rig_from_velodyne.inverse()
    }

    /// `P0` to `P3`.
    fn projection_lines(&self) -> String {
        let mut text = String::new();
        (0..CAMERA_FOLDERS.len())
            .for_each(|slot| line(&mut text, &format!("P{slot}"), &self.projection(slot)));
        text
    }

    /// `calib.txt` of a sequence: `P0` to `P3`, and `Tr`, camera 0 from velodyne.
    pub(in super::super) fn sequence_file(&self) -> String {
        let mut text = self.projection_lines();
        line(&mut text, "Tr", &pose_rows(&self.camera0_from_velodyne()));
        text
    }

    /// The file of a frame of the object benchmark.
    pub(in super::super) fn object_file(&self) -> String {
        let mut text = self.projection_lines();
        line(&mut text, "R0_rect", &matrix_rows(DMat3::IDENTITY));
        line(&mut text, "Tr_velo_to_cam", &pose_rows(&self.camera0_from_velodyne()));
        line(&mut text, "Tr_imu_to_velo", &pose_rows(&self.velodyne_from_rig()));
        text
    }

    /// `calib_velo_to_cam.txt` of a day.
    pub(in super::super) fn velo_to_cam_file(&self, calibrated: &str) -> String {
        let mut text = rigid_file(calibrated, &self.camera0_from_velodyne());
        line(&mut text, "delta_f", &[0.0; 2]);
        line(&mut text, "delta_c", &[0.0; 2]);
        text
    }

    /// `calib_imu_to_velo.txt` of a day.
    pub(in super::super) fn imu_to_velo_file(&self, calibrated: &str) -> String {
        rigid_file(calibrated, &self.velodyne_from_rig())
    }

    /// `calib_cam_to_cam.txt` of a day. Pictures are rectified as they are, so that `K`, `R` and
    /// `T` describe the same cameras as `P_rect`, one by one.
    pub(in super::super) fn cam_to_cam_file(&self, calibrated: &str) -> String {
        let mut text = format!("calib_time: {calibrated}\n");
        // The distance of corners of the checkerboard that KITTI's cameras were calibrated with;
        // there was none here.
        line(&mut text, "corner_dist", &[0.0]);
        for slot in 0..CAMERA_FOLDERS.len() {
            let pose = self.camera_from_camera0(slot);
            let size = self
                .camera(slot)
                .map_or([0.0; 2], |(_, camera)| [camera.size.0, camera.size.1].map(f64::from));
            let mut own = |key: &str, numbers: &[f64]| line(&mut text, &format!("{key}_{slot:02}"), numbers);
            own("S", &size);
            own("K", &matrix_rows(self.intrinsics(slot)));
            own("D", &[0.0; 5]);
            own("R", &matrix_rows(DMat3::from_quat(pose.rotation)));
            own("T", &pose.translation.to_array());
            own("S_rect", &size);
            own("R_rect", &matrix_rows(DMat3::IDENTITY));
            own("P_rect", &self.projection(slot));
        }
        text
    }
}

fn rigid_file(calibrated: &str, pose: &RigidPose) -> String {
    let mut text = format!("calib_time: {calibrated}\n");
    line(&mut text, "R", &matrix_rows(DMat3::from_quat(pose.rotation)));
    line(&mut text, "T", &pose.translation.to_array());
    text
}

fn line(text: &mut String, key: &str, numbers: &[f64]) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{key}: {}", numbers_text(numbers));
}

/// Numbers with thirteen digits and a space between them.
pub(super) fn numbers_text(numbers: &[f64]) -> String {
    // No minus before zero.
    numbers.iter().map(|number| format!("{:.12e}", number + 0.0)).collect::<Vec<_>>().join(" ")
}

fn matrix_rows(m: DMat3) -> [f64; 9] {
    m.transpose().to_cols_array()
}

fn rows(m: DMat3, t: DVec3) -> [f64; 12] {
    let [a, b, c] = m.transpose().to_cols_array_2d();
    [a[0], a[1], a[2], t.x, b[0], b[1], b[2], t.y, c[0], c[1], c[2], t.z]
}

/// The upper three rows of a pose as a matrix.
pub(super) fn pose_rows(pose: &RigidPose) -> [f64; 12] {
    rows(DMat3::from_quat(pose.rotation), pose.translation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use glam::DVec4;

    #[test]
    fn points_reach_all_four_cameras_by_way_of_camera_0() {
        let mut set = testing::set();
        let mut back = set.sensors[0].clone();
        (back.name, back.rig_from_sensor.translation) = ("back".into(), DVec3::new(-1.0, 0.2, 1.3));
        back.rig_from_sensor.rotation = glam::DQuat::from_rotation_z(2.8) * back.rig_from_sensor.rotation;
        set.sensors.push(back);
        let rig = KittiRig::new(&set);
        assert_eq!(rig.slots().collect::<Vec<_>>(), [(0, 2), (1, 3), (2, 1), (5, 0)]);
        // What pykitti takes for camera 0's place.
        assert_eq!(rig.projection(0)[3], 0.0);
        let point = DVec3::new(9.0, 4.0, -1.0);
        let in_camera0 = rig.camera0_from_velodyne().point(point);
        for (sensor, slot) in rig.slots() {
            let p = rig.projection(slot);
            let found = [0, 1, 2].map(|row| DVec4::from_slice(&p[4 * row..]).dot(in_camera0.extend(1.0)));
            let pose = set.sensors[sensor].rig_from_sensor.inverse().then(&set.sensors[3].rig_from_sensor);
            let camera = set.sensors[sensor].camera().unwrap();
            let expected = testing::project(camera, pose.point(point));
            for k in 0..2 {
                assert!((found[k] / found[2] + 0.5 - expected[k]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_rig_without_cameras_has_one_at_the_lidar() {
        let mut set = testing::set();
        set.sensors.drain(..3);
        let ahead = KittiRig::new(&set).camera0_from_velodyne().point(DVec3::new(5.0, 1.0, 2.0));
        assert!(ahead.distance(DVec3::new(-1.0, -2.0, 5.0)) < 1e-12);
    }
}
