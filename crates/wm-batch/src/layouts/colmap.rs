//! COLMAP: a sparse model without points, and photos, for training and evaluation in bad weather.
//!
//! `SPLIT/CLIP/` has `sparse/0/{cameras,images,points3D}.txt` and `images/CAMERA/%06d.jpg`. Images
//! are numbered in the order of time, cameras in the order of the rig. Stills of one place in one
//! weather are one model, `SPLIT/PLACE-WEATHER/`, with `images/CAMERA/%08d.jpg`.
//!
//! - Poses are `camera_from_world`, w x y z and translation, with OpenCV's axes; the world is in
//!   metres, z up.
//! - Cameras are `PINHOLE`, `OPENCV`, `FULL_OPENCV` (with k3) or `OPENCV_FISHEYE`.
//! - The principal point counts from the corner of the first pixel, like ours.
//! - `points3D.txt` has no points: what trains on them begins from its own, or from those of the
//!   capture.
//!
//! Source: colmap.github.io, "Output format".

use super::{ClipStream, FileSink, LayerNeeds, Layout};
use crate::cameras::{cameras, check_cameras, distortion, refuse_equirectangular, wxyz_and_translation};
use crate::stills::{for_each_scene, photo, readings, scene_photos};
use crate::{CameraInfo, ClipRecord, SetError, SetInfo};
use std::fmt::Write;
use wm_scene::LensModel;

const NAME: &str = "colmap";

pub(super) const LAYOUT: Layout = Layout {
    name: NAME,
    about: "COLMAP models without points and JPEG of all cameras; a model is a clip, or all stills of a place and weather",
    needs: LayerNeeds::NONE,
    needs_every_sensor: false,
    check,
    block: scene_photos,
    tables,
};

fn check(set: &SetInfo) -> Result<(), SetError> {
    check_cameras(NAME, set)?;
    cameras(set).try_for_each(|(_, sensor, camera)| match model(camera) {
        Some(_) => Ok(()),
        None => Err(refuse_equirectangular(NAME, sensor)),
    })
}

fn tables(set: &SetInfo, clips: ClipStream<'_>, files: &mut dyn FileSink) -> Result<(), SetError> {
    let cameras = camera_table(set);
    for_each_scene(set, clips, &mut |folder, records| {
        let folder = format!("{folder}/sparse/0");
        files.write(&format!("{folder}/cameras.txt"), cameras.as_bytes())?;
        files.write(&format!("{folder}/images.txt"), image_table(set, records).as_bytes())?;
        let points = b"# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
        files.write(&format!("{folder}/points3D.txt"), points)
    })
}

/// The model of a camera and its parameters; `None` if there is none.
fn model(camera: &CameraInfo) -> Option<(&'static str, Vec<f64>)> {
    let pinhole = [camera.focal, camera.center].concat();
    if let Some(LensModel::Fisheye { radial, .. }) = camera.lens {
        return Some(("OPENCV_FISHEYE", [pinhole, radial.to_vec()].concat()));
    }
    Some(match distortion(camera)? {
        [0.0, 0.0, 0.0, 0.0, 0.0] => ("PINHOLE", pinhole),
        [k1, k2, p1, p2, 0.0] => ("OPENCV", [pinhole, vec![k1, k2, p1, p2]].concat()),
        // With k4, k5 and k6.
        [k1, k2, p1, p2, k3] => ("FULL_OPENCV", [pinhole, vec![k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]].concat()),
    })
}

fn camera_table(set: &SetInfo) -> String {
    let mut out = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n".to_owned();
    for (index, _, camera) in cameras(set) {
        if let Some((model, parameters)) = model(camera) {
            let (width, height) = camera.size;
            // Writing to a string does not fail.
            let _ = write!(out, "{} {model} {width} {height}", index + 1);
            parameters.iter().for_each(|value| out.push_str(&format!(" {value}")));
            out.push('\n');
        }
    }
    out
}

fn image_table(set: &SetInfo, records: &[ClipRecord]) -> String {
    let mut out =
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as X, Y, POINT3D_ID\n"
            .to_owned();
    for (place, (clip, info, _)) in readings(set, records).enumerate() {
        let pose = wxyz_and_translation(&info.world_from_sensor(set).inverse());
        out.push_str(&(place + 1).to_string());
        pose.iter().for_each(|value| out.push_str(&format!(" {value}")));
        // The second line holds points.
        let _ = writeln!(out, " {} {}\n", info.sensor + 1, photo(set, clip, info));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lenses_have_their_models() {
        let camera = |lens| CameraInfo { size: (4, 3), focal: [2.0, 2.5], center: [2.0, 1.5], lens };
        let perspective = |values| Some(LensModel::Perspective(wm_scene::camera::Distortion::of(values)));
        let name = |lens| model(&camera(lens)).map(|(name, parameters)| (name, parameters.len()));
        assert_eq!(name(None), Some(("PINHOLE", 4)));
        assert_eq!(name(perspective([0.1, 0.0, 0.0, 0.0, 0.0])), Some(("OPENCV", 8)));
        assert_eq!(name(perspective([0.1, 0.0, 0.0, 0.0, 0.2])), Some(("FULL_OPENCV", 12)));
        let fisheye = Some(LensModel::Fisheye { radial: [0.1, 0.2, 0.3, 0.4], widest: 1.5 });
        assert_eq!(name(fisheye), Some(("OPENCV_FISHEYE", 8)));
        assert_eq!(name(Some(LensModel::Equirectangular)), None);
    }
}
