//! COLMAP models: `cameras` and `images`, binary (`.bin`) or text (`.txt`).
//!
//! COLMAP's axes are those of [`Camera`]: x right, y down, z forward; a pose is camera_from_world as
//! a wxyz quaternion and a translation; the centre of the top left pixel is (0.5, 0.5). So nothing
//! is converted. Only cameras without distortion are read, since photos with it cannot be compared
//! with what is rendered. 2D points are stepped over; 3D points are not read.

mod binary;
#[cfg(test)]
mod tests;
mod text;

use super::Format;
use crate::{Camera, FormatError, Problem, View, camera::viewmat_of, source::Source};
use glam::{DMat3, DMat4, DQuat, DVec3};
use std::{collections::BTreeMap, path::Path};

/// The entry of [`FORMATS`](super::FORMATS).
pub const FORMAT: Format =
    Format { name: "COLMAP", about: "COLMAP model, binary or text, undistorted (PINHOLE)", read };

/// Where a model may lie in the folder that is given.
const FOLDERS: [&str; 4] = ["", "sparse/0", "sparse", "0"];

/// COLMAP's camera models in the order of their numbers.
const MODELS: [&str; 18] = [
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

/// Cameras by their number; the pose is still the identity.
type Cameras = BTreeMap<u32, Camera>;

/// One of the two ways in which a model is stored.
struct Kind {
    cameras: &'static str,
    images: &'static str,
    read_cameras: fn(&mut Source) -> Result<Cameras, FormatError>,
    read_images: fn(&mut Source, &Cameras) -> Result<Vec<View>, FormatError>,
}

const KINDS: [Kind; 2] = [
    Kind {
        cameras: "cameras.bin",
        images: "images.bin",
        read_cameras: binary::read_cameras,
        read_images: binary::read_images,
    },
    Kind {
        cameras: "cameras.txt",
        images: "images.txt",
        read_cameras: text::read_cameras,
        read_images: text::read_images,
    },
];

fn read(folder: &Path) -> Result<Option<Vec<View>>, FormatError> {
    let places = FOLDERS.iter().flat_map(|place| KINDS.iter().map(move |kind| (folder.join(place), kind)));
    let there: Vec<(usize, _)> = places
        .map(|(place, kind)| {
            let files = [kind.cameras, kind.images].into_iter().filter(|file| place.join(file).is_file());
            (files.count(), (place, kind))
        })
        .collect();
    // Half a model is taken only where there is no whole one: opening it names the missing file.
    let best = there.iter().find(|(files, _)| *files == 2).or_else(|| there.iter().find(|(files, _)| *files == 1));
    let Some((_, (place, kind))) = best else { return Ok(None) };
    let cameras = (kind.read_cameras)(&mut Source::open(&place.join(kind.cameras))?)?;
    let mut images = Source::open(&place.join(kind.images))?;
    let views = (kind.read_images)(&mut images, &cameras)?;
    if views.is_empty() {
        let problem = "no image is registered in the model; reconstruct the capture again";
        return Err(images.whole(Problem::Value(problem.into())));
    }
    Ok(Some(views))
}

/// How many parameters a model that can be used has.
///
/// # Errors
/// [`Problem::CameraModel`] for every other model.
fn parameters(camera: u32, model: &str) -> Result<usize, Problem> {
    let advice = match model {
        "SIMPLE_PINHOLE" => return Ok(3),
        "PINHOLE" => return Ok(4),
        "EQUIRECTANGULAR" => "which is a panorama; cut it into pinhole pictures and reconstruct those",
        _ if MODELS.contains(&model) => {
            "which has distortion; remove it with `colmap image_undistorter --image_path IMAGES --input_path \
             MODEL --output_path DATASET` and give DATASET"
        }
        _ => "which is not known; only PINHOLE and SIMPLE_PINHOLE are read",
    };
    Err(Problem::CameraModel { camera, model: model.into(), advice })
}

/// Adds a camera with as many parameters as [`parameters`] says.
fn add_camera(cameras: &mut Cameras, id: u32, size: (u64, u64), parameters: &[f64]) -> Result<(), Problem> {
    let (fx, fy, cx, cy) = match *parameters {
        [f, cx, cy] => (f, f, cx, cy),
        [fx, fy, cx, cy] => (fx, fy, cx, cy),
        _ => return Err(value(format!("camera {id} has {} parameters", parameters.len()))),
    };
    // A side beyond 32 bits stays too long for the check.
    let side = |length: u64| u32::try_from(length).unwrap_or(u32::MAX);
    let camera = Camera {
        width: side(size.0),
        height: side(size.1),
        fx,
        fy,
        cx,
        cy,
        viewmat: DMat4::IDENTITY,
        near: Camera::DEFAULT_NEAR,
    };
    camera.check().map_err(|error| value(format!("camera {id}: {error}")))?;
    if cameras.insert(id, camera).is_some() {
        return Err(value(format!("camera {id} is there twice")));
    }
    Ok(())
}

/// The view of an image: `pose` is qw qx qy qz tx ty tz, camera_from_world.
fn view(cameras: &Cameras, name: String, camera: u32, pose: [f64; 7]) -> Result<View, Problem> {
    let [w, x, y, z, tx, ty, tz] = pose;
    let quat = DQuat::from_xyzw(x, y, z, w);
    if !(quat.is_finite() && quat.length() > 1e-6) {
        return Err(value(format!("the rotation of {name:?} is no quaternion")));
    }
    let Some(intrinsics) = cameras.get(&camera) else {
        return Err(value(format!("the image {name:?} has camera {camera}, which is not in the list of cameras")));
    };
    let rotation = DMat3::from_quat(quat.normalize());
    let camera = Camera { viewmat: viewmat_of(rotation, DVec3::new(tx, ty, tz)), ..*intrinsics };
    camera.check().map_err(|error| value(format!("the image {name:?}: {error}")))?;
    Ok(View { name, camera })
}

fn value(what: String) -> Problem {
    Problem::Value(format!("{what}; export the model again"))
}

fn cut(what: String) -> Problem {
    Problem::CaptureTruncated { what }
}
