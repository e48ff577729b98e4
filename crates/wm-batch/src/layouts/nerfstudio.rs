//! nerfstudio: `transforms.json` and photos, for training and evaluation in bad weather.
//!
//! `SPLIT/CLIP/` has `transforms.json` and `images/CAMERA/%06d.jpg`; frames are in the order of
//! time. Stills of one place in one weather are one scene, `SPLIT/PLACE-WEATHER/`, with
//! `images/CAMERA/%08d.jpg`.
//!
//! - `transform_matrix` is `world_from_camera` with OpenGL's axes, x right, y up and z backward;
//!   the world is in metres, z up.
//! - Intrinsics are in each frame, so that cameras may differ, but all have one `camera_model`:
//!   `OPENCV` (k1, k2, k3, p1, p2) or `OPENCV_FISHEYE` (k1 to k4).
//! - The principal point counts from the corner of the first pixel, like ours.
//! - Depth and points are left out.
//!
//! Source: docs.nerf.studio, "Data conventions".

use super::{ClipStream, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, check_cameras, distortion, refuse, refuse_equirectangular};
use crate::stills::{for_each_scene, photo, readings, scene_photos};
use crate::{CameraInfo, ClipRecord, SetError, SetInfo};
use glam::{DMat4, DVec4};
use serde_json::{Value, json};
use wm_scene::LensModel;

const NAME: &str = "nerfstudio";

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "nerfstudio scenes: transforms.json and JPEG of all cameras; a scene is a clip, or all stills of a place and weather",
    needs: LayerNeeds::NONE,
    needs_every_sensor: false,
    check,
    block: scene_photos,
    tables,
};

fn check(set: &SetInfo) -> Result<(), SetError> {
    check_cameras(NAME, set)?;
    let mut first = None;
    for (_, sensor, camera) in cameras(set) {
        let Some((model, _)) = lens(camera) else { return Err(refuse_equirectangular(NAME, sensor)) };
        if *first.get_or_insert(model) != model {
            let name = &sensor.name;
            let problem = format!("all cameras must be fisheyes or none; change the lens of camera \"{name}\"");
            return Err(refuse(NAME, problem));
        }
    }
    Ok(())
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    for_each_scene(set, clips, &mut |folder, records| {
        let path = format!("{folder}/transforms.json");
        let mut bytes = serde_json::to_vec_pretty(&transforms(set, records))
            .map_err(|error| SetError::Write { path: path.clone().into(), problem: error.to_string() })?;
        bytes.push(b'\n');
        files.write(&path, &bytes)
    })
}

/// The model of a lens and its numbers.
fn lens(camera: &CameraInfo) -> Option<(&'static str, Vec<(&'static str, f64)>)> {
    if let Some(LensModel::Fisheye { radial, .. }) = camera.lens {
        return Some(("OPENCV_FISHEYE", ["k1", "k2", "k3", "k4"].into_iter().zip(radial).collect()));
    }
    let names = ["k1", "k2", "p1", "p2", "k3"];
    distortion(camera).map(|lens| ("OPENCV", names.into_iter().zip(lens).collect()))
}

/// The table of a scene.
fn transforms(set: &SetInfo, records: &[ClipRecord]) -> Value {
    let model = cameras(set).find_map(|(_, _, camera)| lens(camera)).map_or("OPENCV", |(model, _)| model);
    let frames = readings(set, records).filter_map(|(clip, info, camera)| {
        // OpenGL's axes: y and z the other way.
        let axes = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
        let matrix = info.world_from_sensor(set).matrix() * axes;
        let mut frame = json!({
            "file_path": format!("images/{}", photo(set, clip, info)),
            "transform_matrix": matrix.transpose().to_cols_array_2d(),
            "w": camera.size.0,
            "h": camera.size.1,
            "fl_x": camera.focal[0],
            "fl_y": camera.focal[1],
            "cx": camera.center[0],
            "cy": camera.center[1],
            "time": info.time,
        });
        for (name, value) in lens(camera)?.1 {
            frame[name] = value.into();
        }
        Some(frame)
    });
    json!({ "camera_model": model, "frames": frames.collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn mixed_lenses_are_refused() {
        let mut set = testing::set();
        let crate::SensorInfoKind::Camera(camera) = &mut set.sensors[1].kind else { unreachable!() };
        camera.lens = Some(LensModel::Fisheye { radial: [0.0; 4], widest: 1.5 });
        assert!(check(&set).unwrap_err().to_string().contains("fisheyes or none"));
    }
}
