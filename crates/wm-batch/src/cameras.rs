//! Questions that several layouts ask of cameras and of what they took.

use crate::{
    CameraInfo, PictureReading, ReadingData, RigidPose, SensorInfo, SensorReading, SetError, SetInfo,
};
use wm_scene::LensModel;

/// The error of a layout that cannot hold a set.
pub(crate) fn refuse(layout: &'static str, problem: impl Into<String>) -> SetError {
    SetError::Layout { layout, problem: problem.into() }
}

/// The error of a layout that has no place for a lens that shows all directions.
pub(crate) fn refuse_equirectangular(layout: &'static str, sensor: &SensorInfo) -> SetError {
    refuse(layout, format!("camera \"{}\" is equirectangular; give it another lens", sensor.name))
}

/// The cameras of a set with their indices.
pub(crate) fn cameras(set: &SetInfo) -> impl Iterator<Item = (usize, &SensorInfo, &CameraInfo)> {
    let sensors = set.sensors.iter().enumerate();
    sensors.filter_map(|(index, sensor)| Some((index, sensor, sensor.camera()?)))
}

/// Checks that a set has a camera.
pub(crate) fn check_cameras(layout: &'static str, set: &SetInfo) -> Result<(), SetError> {
    match cameras(set).next() {
        Some(_) => Ok(()),
        None => Err(refuse(layout, "the rig has no camera; add one, or leave out this layout")),
    }
}

/// k1, k2, p1, p2, k3 of a camera; `None` if it is neither a pinhole nor a distorted one.
pub(crate) fn distortion(camera: &CameraInfo) -> Option<[f64; 5]> {
    match camera.lens {
        None => Some([0.0; 5]),
        Some(LensModel::Perspective(distortion)) => Some(distortion.coefficients()),
        Some(_) => None,
    }
}

/// Checks that all cameras are pinholes.
pub(crate) fn check_pinholes(layout: &'static str, set: &SetInfo) -> Result<(), SetError> {
    let Some((_, sensor, _)) = cameras(set).find(|(.., camera)| distortion(camera) != Some([0.0; 5])) else {
        return Ok(());
    };
    let name = &sensor.name;
    Err(refuse(layout, format!("it has no place for the lens of camera \"{name}\"; give it no lens")))
}

/// The picture of a reading with the camera that took it; `None` for readings of other sensors.
pub(crate) fn picture<'a>(
    set: &'a SetInfo,
    reading: &SensorReading<'a>,
) -> Option<(&'a SensorInfo, &'a CameraInfo, PictureReading<'a>)> {
    let sensor = &set.sensors[reading.info.sensor];
    match reading.data {
        ReadingData::Picture(picture) => Some((sensor, sensor.camera()?, picture)),
        _ => None,
    }
}

/// A layer that a layout needs, of `channels` values a pixel.
pub(crate) fn layer<'a, T>(
    sensor: &SensorInfo,
    camera: &CameraInfo,
    layer: Option<&'a [T]>,
    channels: usize,
    name: &str,
) -> Result<&'a [T], SetError> {
    let fault = |problem: String| SetError::Picture { sensor: sensor.name.clone(), problem };
    let layer = layer.ok_or_else(|| fault(format!("it came without its {name}")))?;
    let wanted = camera.size.0 as usize * camera.size.1 as usize * channels;
    if layer.len() != wanted {
        return Err(fault(format!("its {name} has {} values instead of {wanted}", layer.len())));
    }
    Ok(layer)
}

/// The rotation of a pose as w, x, y, z and its translation.
pub(crate) fn wxyz_and_translation(pose: &RigidPose) -> [f64; 7] {
    let (q, t) = (pose.rotation, pose.translation);
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// The first clip, read as a capture, has cameras that show the spot where the set's own do.
    #[test]
    fn our_own_reader_finds_the_spot() {
        for name in ["colmap", "nerfstudio"] {
            let root = tempfile::tempdir().unwrap();
            testing::write(testing::layout(name), &mut testing::FolderSink(root.path().into())).unwrap();
            let set = testing::set();
            let folder = root.path().join(crate::stills::folder(&set, &testing::clips()[0]));
            let capture = wm_capture::read(&folder, &wm_capture::CaptureOptions::default()).unwrap();
            let readings = testing::readings(&set);
            let mut seen = testing::SpotCount::default();
            assert_eq!(capture.views.len(), 3 * testing::FRAMES_PER_CLIP as usize);
            for view in &capture.views {
                let [sensor_name, index] = [0, 1].map(|part| view.name.rsplit('/').nth(1 - part).unwrap());
                let (sensor, _, camera) =
                    cameras(&set).find(|(_, sensor, _)| sensor.name == sensor_name).unwrap();
                let index: u32 = index.trim_end_matches(".jpg").parse().unwrap();
                let info = readings.iter().find(|info| info.sensor == sensor && info.index == index).unwrap();
                let local = view.camera.viewmat.transform_point3(testing::SPOT);
                let spot = testing::spot_in(&set, info);
                assert!(local.distance(spot) < 1e-9, "{}: {local} is not {spot}", view.name);
                let intrinsics = [view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy];
                assert_eq!(intrinsics[..], [camera.focal, camera.center].concat());
                assert!(capture.images.join(&view.file).is_file());
                seen.add(&set, info, testing::project(camera, local));
            }
        }
    }

    #[test]
    fn files_of_readings_do_not_depend_on_blocks() {
        for name in ["argoverse2", "tartanair"] {
            let layout = testing::layout(name);
            assert!(testing::written(layout, 3) == testing::written(layout, 20), "{name}");
        }
    }
}
