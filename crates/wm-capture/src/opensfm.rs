//! `reconstruction.json` of OpenSfM and OpenDroneMap.
//!
//! A list of reconstructions that do not know of each other, of which the one with most shots is
//! taken. A shot is camera_from_world with the axes of [`Camera`]: a rotation as axis times angle,
//! and a translation. Lengths of a camera are in units of the longer side of the photo, its
//! principal point is measured from the middle. Of the projections perspective, simple_radial,
//! radial and brown are read.

use super::{Capture, CaptureOptions, CaptureView, JSON_ADVICE, ReadScope, find_main, places};
use crate::logs::read_json;
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use wm_base::FormatError;
use wm_base::error::{excerpt, one_line};
use wm_scene::camera::{Distortion, viewmat_of};
use wm_scene::{Camera, Remark, SparsePoints};

/// The paths of the file within a data set, in the order in which they are tried.
const FILES: [&str; 2] = ["reconstruction.json", "opensfm/reconstruction.json"];

#[derive(Deserialize)]
struct Reconstruction {
    cameras: BTreeMap<String, Lens>,
    shots: BTreeMap<String, Shot>,
    #[serde(default)]
    points: BTreeMap<String, Point>,
}

#[derive(Deserialize)]
struct Lens {
    projection_type: String,
    width: u32,
    height: u32,
    focal: Option<f64>,
    focal_x: Option<f64>,
    focal_y: Option<f64>,
    #[serde(default)]
    c_x: f64,
    #[serde(default)]
    c_y: f64,
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    #[serde(default)]
    k3: f64,
    #[serde(default)]
    p1: f64,
    #[serde(default)]
    p2: f64,
}

#[derive(Deserialize)]
struct Shot {
    camera: String,
    rotation: DVec3,
    translation: DVec3,
}

#[derive(Deserialize)]
struct Point {
    coordinates: [f64; 3],
    #[serde(default)]
    color: [f64; 3],
}

impl Lens {
    fn camera(&self) -> Result<(Camera, Distortion), String> {
        if !["perspective", "simple_radial", "radial", "brown"].contains(&self.projection_type.as_str()) {
            let other = excerpt(self.projection_type.as_bytes());
            return Err(format!("its projection {other} is not read; {UNDISTORT}"));
        }
        let side = f64::from(self.width.max(self.height));
        let Some(fx) = self.focal_x.or(self.focal) else { return Err("it has no focal length".into()) };
        let focal = [fx * side, self.focal_y.unwrap_or(fx) * side];
        let center =
            [0.5 * f64::from(self.width) + self.c_x * side, 0.5 * f64::from(self.height) + self.c_y * side];
        let camera = Camera::pinhole((self.width, self.height), focal, center);
        camera.check().map_err(|e| e.to_string())?;
        let lens = [self.k1, self.k2, self.p1, self.p2, self.k3];
        Ok((camera, Distortion::from_file(lens)?))
    }
}

/// The advice for a lens that is not read.
const UNDISTORT: &str =
    "run `opensfm undistort` and give its folder, or reconstruct with the camera model radial";

pub(super) fn read(
    dataset: &Path,
    options: &CaptureOptions,
    scope: ReadScope,
) -> Result<Option<Capture>, FormatError> {
    let is_main = |path: &Path| path.file_name().is_some_and(|name| name == FILES[0]);
    let Some((path, folder)) = find_main(dataset, &FILES, is_main) else { return Ok(None) };
    let all: Vec<Reconstruction> = read_json(&path, JSON_ADVICE)?;
    let fault = |what: String| FormatError::value(&path, one_line(&what));
    let (parts, shots) = (all.len(), all.iter().map(|one| one.shots.len()).sum::<usize>());
    // Of equal ones the first.
    let largest = all.into_iter().rev().max_by_key(|one| one.shots.len()).filter(|one| !one.shots.is_empty());
    let one =
        largest.ok_or_else(|| fault("there are no shots in it; reconstruct the capture again".into()))?;
    let mut remarks = Vec::new();
    if shots > one.shots.len() {
        let text = format!(
            "{} has {parts} reconstructions that do not know of each other; the largest is read, {} of {shots} photos",
            path.display(),
            one.shots.len()
        );
        remarks.push(Remark::note("other-models", text));
    }
    let mut numbered = BTreeMap::new();
    for (number, (name, lens)) in one.cameras.iter().enumerate() {
        let camera = lens.camera().map_err(|what| fault(format!("the camera {name:?}: {what}")))?;
        numbered.insert(name, (number as u32 + 1, camera));
    }
    let mut views = Vec::with_capacity(one.shots.len());
    for (name, shot) in &one.shots {
        let fault = |what: String| fault(format!("the shot {name:?}: {what}"));
        let (camera_id, (camera, distortion)) = *numbered
            .get(&shot.camera)
            .ok_or_else(|| fault(format!("there is no camera {:?}", shot.camera)))?;
        let rotation = DMat3::from_quat(DQuat::from_scaled_axis(shot.rotation));
        let camera = Camera { viewmat: viewmat_of(rotation, shot.translation), ..camera };
        camera.check().map_err(|e| fault(e.to_string()))?;
        views.push(CaptureView {
            name: name.clone(),
            ..CaptureView::new(name, camera, distortion, camera_id)
        });
    }
    let mut points = SparsePoints::default();
    if scope == ReadScope::Everything {
        for point in one.points.values() {
            points.push(point.coordinates, point.color.map(|v| v.clamp(0.0, 255.0) as u8), f32::NAN, 0);
        }
    }
    let (images, found) = places::find(&[&folder], options, &places::IMAGES, &mut views)?;
    remarks.extend(found);
    Ok(Some(Capture { images, views, points, remarks, ..Capture::default() }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate as capture;
    use std::fs;
    use tempfile::tempdir;

    fn read_json(text: &str) -> Result<Capture, FormatError> {
        let folder = tempdir().unwrap();
        fs::write(folder.path().join("reconstruction.json"), text).unwrap();
        capture::read(folder.path(), &CaptureOptions::default())
    }

    const WHOLE: &str = r#"[{"cameras": {}, "shots": {}}, {"cameras": {
        "v2 drone": {"projection_type": "brown", "width": 4000, "height": 3000, "focal_x": 0.8, "focal_y": 0.81,
            "c_x": 0.01, "c_y": -0.02, "k1": -0.1, "k2": 0.01, "p1": 0.001, "p2": 0.0, "k3": 0.02}},
        "shots": {"b.jpg": {"camera": "v2 drone", "rotation": [0, 1.5707963267948966, 0], "translation": [1, 2, 3]}},
        "points": {"7": {"coordinates": [1, 2, 3], "color": [10, 20.5, 300]}}}]"#;

    #[test]
    fn shots_cameras_and_points_are_read() {
        let capture = read_json(WHOLE).unwrap();
        let [view] = &capture.views[..] else { panic!("one view") };
        let camera = &view.camera;
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (3200.0, 3240.0, 2040.0, 1420.0));
        assert_eq!(view.distortion, Distortion::OpenCv { k1: -0.1, k2: 0.01, p1: 0.001, p2: 0.0, k3: 0.02 });
        // A quarter turn about y takes the world's x to the camera's -z: it looks along the world's
        // -x.
        assert!((camera.forward() - DVec3::NEG_X).length() < 1e-9);
        assert!((camera.viewmat.transform_point3(DVec3::ZERO) - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
        assert_eq!((capture.points.positions[0], capture.points.colors[0]), ([1.0, 2.0, 3.0], [10, 20, 255]));
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (from, to, says) in [
            ("\"brown\"", "\"fisheye\"", "the camera \"v2 drone\": its projection fisheye is not read"),
            ("\"camera\": \"v2 drone\"", "\"camera\": \"x\"", "the shot \"b.jpg\": there is no camera \"x\""),
            ("\"width\": 4000", "\"width\": 0", "the camera \"v2 drone\": picture size 0x3000"),
            ("[1, 2, 3]}}", "[1, 2]}}", "line 4, column"),
        ] {
            let message = read_json(&WHOLE.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(message.contains(says) && !message.contains('\n'), "{message}");
        }
        assert!(read_json("[]").unwrap_err().to_string().contains("there are no shots in it"));
        for length in 0..WHOLE.len() {
            assert!(read_json(&WHOLE[..length]).is_err());
        }
    }
}
