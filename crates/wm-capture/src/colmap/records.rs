//! Cameras, images and points of a model, as both of its formats give them.

use crate::{CaptureView, Observation};
use glam::{DMat3, DQuat, DVec3};
use std::collections::{BTreeMap, HashMap};
use wm_base::Problem;
use wm_scene::SparsePoints;
use wm_scene::camera::{Camera, Distortion, viewmat_of};

/// COLMAP's camera models in the order of their numbers.
pub(super) const MODELS: [&str; 18] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
    "SIMPLE_DIVISION",
    "DIVISION",
    "SIMPLE_FISHEYE",
    "FISHEYE",
    "EUCM",
    "EQUIRECTANGULAR",
];

/// A camera without its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Intrinsics {
    /// The pose is still the identity.
    camera: Camera,
    distortion: Distortion,
}

/// Cameras by their number.
pub(super) type Cameras = BTreeMap<u32, Intrinsics>;

/// Points, and where each number of the file stands among them.
pub(super) type NumberedPoints = (SparsePoints, HashMap<u64, u32>);

/// The second of [`NumberedPoints`]; `None` where 2D points are not wanted.
pub(super) type Places = Option<HashMap<u64, u32>>;

/// The photos of a model and the points that each shows.
pub(super) type Images = (Vec<CaptureView>, Vec<Vec<Observation>>);

/// Most parameters of a camera model that is read.
pub(super) const MAX_PARAMETERS: usize = 12;

/// The number of parameters of a camera model that is read.
///
/// # Errors
/// [`Problem::CameraModel`] for every other model.
pub(super) fn parameters(camera: u32, model: &str) -> Result<usize, Problem> {
    let advice = match model {
        "SIMPLE_PINHOLE" => return Ok(3),
        "PINHOLE" | "SIMPLE_RADIAL" => return Ok(4),
        "RADIAL" => return Ok(5),
        "OPENCV" => return Ok(8),
        "FULL_OPENCV" => return Ok(12),
        "EQUIRECTANGULAR" => "which is a panorama; cut it into pinhole pictures and reconstruct those",
        _ if MODELS.contains(&model) => {
            "whose distortion is not read; remove it with `colmap image_undistorter --image_path IMAGES \
             --input_path MODEL --output_path DATASET` and give DATASET"
        }
        _ => {
            "which is not known; PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV are read"
        }
    };
    Err(Problem::CameraModel { camera, model: model.into(), advice })
}

/// Adds a camera with as many parameters as [`parameters`] says.
pub(super) fn add_camera(
    cameras: &mut Cameras,
    id: u32,
    model: &str,
    size: (u64, u64),
    parameters: &[f64],
) -> Result<(), Problem> {
    let (focal, center, lens) = match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], [0.0; 5]),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], [0.0; 5]),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f], [cx, cy], [k, 0.0, 0.0, 0.0, 0.0]),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], [k1, k2, 0.0, 0.0, 0.0]),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy], [cx, cy], [k1, k2, p1, p2, 0.0]),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]) => {
            ([fx, fy], [cx, cy], [k1, k2, p1, p2, k3])
        }
        ("FULL_OPENCV", _) => {
            let advice =
                "has k4, k5 or k6, which are not read; undistort its photos with `colmap image_undistorter`";
            return Err(Problem::Value(format!("camera {id} {advice}")));
        }
        _ => return Err(value(format!("camera {id} has {} parameters", parameters.len()))),
    };
    // A side beyond 32 bits stays too long for the check.
    let side = |length: u64| u32::try_from(length).unwrap_or(u32::MAX);
    let camera = Camera::pinhole((side(size.0), side(size.1)), focal, center);
    camera.check().map_err(|error| value(format!("camera {id}: {error}")))?;
    let distortion = Distortion::from_file(lens).map_err(|what| value(format!("camera {id}: {what}")))?;
    let intrinsics = Intrinsics { camera, distortion };
    if cameras.insert(id, intrinsics).is_some() {
        return Err(value(format!("camera {id} appears twice")));
    }
    Ok(())
}

/// The view of an image: `pose` is qw qx qy qz tx ty tz, camera_from_world.
pub(super) fn view(
    cameras: &Cameras,
    name: &str,
    camera_id: u32,
    pose: [f64; 7],
) -> Result<CaptureView, Problem> {
    let [w, x, y, z, tx, ty, tz] = pose;
    let quat = DQuat::from_xyzw(x, y, z, w);
    if !(quat.is_finite() && quat.length() > 1e-6) {
        return Err(value(format!("the rotation of {name:?} is not a quaternion")));
    }
    let Some(Intrinsics { camera, distortion }) = cameras.get(&camera_id) else {
        let what = format!("the image {name:?} has camera {camera_id}, which is not in the list of cameras");
        return Err(value(what));
    };
    let rotation = DMat3::from_quat(quat.normalize());
    let camera = Camera { viewmat: viewmat_of(rotation, DVec3::new(tx, ty, tz)), ..*camera };
    camera.check().map_err(|error| value(format!("the image {name:?}: {error}")))?;
    // Models that were made on Windows may have its separator in subfolders.
    Ok(CaptureView::new(&name.replace('\\', "/"), camera, *distortion, camera_id))
}

/// Adds a 3D point of number `id`.
pub(super) fn add_point(
    points: &mut SparsePoints,
    places: &mut HashMap<u64, u32>,
    id: u64,
    position: [f64; 3],
    color: [u8; 3],
    error: f64,
    track_length: u64,
) -> Result<(), Problem> {
    if !position.iter().all(|v| v.is_finite()) {
        return Err(value(format!("the position of point {id} is not finite")));
    }
    let place = u32::try_from(points.len()).map_err(|_| value("there are more than 2^32 points".into()))?;
    if places.insert(id, place).is_some() {
        return Err(value(format!("point {id} appears twice")));
    }
    // COLMAP writes -1 where it has not computed the error.
    let error = if error >= 0.0 { error as f32 } else { f32::NAN };
    points.push(position, color, error, u32::try_from(track_length).unwrap_or(u32::MAX));
    Ok(())
}

/// The 2D point of a 3D point, if that is known. -1, as unsigned, is none.
pub(super) fn observation(places: &HashMap<u64, u32>, xy: [f64; 2], id: u64) -> Option<Observation> {
    let point = *places.get(&id)?;
    Some(Observation { point, xy: xy.map(|v| v as f32) })
}

pub(super) fn value(what: String) -> Problem {
    Problem::Value(format!("{what}; export the model again"))
}

pub(super) fn cut(what: String) -> Problem {
    Problem::CaptureTruncated { what }
}
