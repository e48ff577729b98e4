//! Scenes that are folders: what the reference 3DGS training writes, and SOG.
//!
//! In SOG, `lod-meta.json` or `meta.json` is the scene file. Of a training,
//! `point_cloud/iteration_<n>/point_cloud.ply` are the splats, of which the highest n counts, and
//! `cameras.json` in the folder of the training holds the photographed views, if it exists.

use super::beside::places;
use crate::{
    Camera, SceneView,
    camera::{rotation_of, viewmat_at},
};
use glam::{DMat3, DVec3};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::{
    fs,
    io::ErrorKind::{NotADirectory, NotFound, Unsupported},
    path::{Path, PathBuf},
};
use wm_base::{
    FormatError, Problem,
    error::json_fault,
    files::{self, write_atomically},
};

/// The scene file that `path` means: itself, or the splats in it if it is a folder.
///
/// # Errors
/// [`FormatError`] if there is nothing at the path, or it is a folder without splats.
pub fn scene_file(path: &Path) -> Result<PathBuf, FormatError> {
    if !files::is_folder(path).map_err(|e| FormatError::reading(path, e))? {
        return Ok(path.into());
    }
    for name in ["lod-meta.json", "meta.json"] {
        if files::is_file(&path.join(name)).is_ok_and(|is_file| is_file) {
            return Ok(path.join(name));
        }
    }
    let no_scene = || FormatError::whole(path, Problem::NotASceneFolder);
    let entries = match fs::read_dir(path.join("point_cloud")) {
        Ok(entries) => entries,
        Err(error) if matches!(error.kind(), NotFound | NotADirectory | Unsupported) => {
            return Err(no_scene());
        }
        Err(error) => return Err(FormatError::reading(path, error)),
    };
    let mut best: Option<(u64, PathBuf)> = None;
    for entry in entries {
        let entry = entry.map_err(|e| FormatError::reading(path, e))?;
        let name = entry.file_name();
        let number = name.to_str().and_then(|n| n.strip_prefix("iteration_")).and_then(|n| n.parse().ok());
        let file = entry.path().join("point_cloud.ply");
        if let Some(number) = number
            && best.as_ref().is_none_or(|(highest, _)| number > *highest)
            && file.is_file()
        {
            best = Some((number, file));
        }
    }
    best.map(|(_, file)| file).ok_or_else(no_scene)
}

/// The file of the views in the folder of a training.
const CAMERAS: &str = "cameras.json";

/// The path of the views of a scene file, beside it: `<scene file>.cameras.json`.
#[must_use]
pub fn cameras_path(scene_file: &Path) -> PathBuf {
    let mut name = scene_file.as_os_str().to_owned();
    name.push(".cameras.json");
    name.into()
}

/// Writes views as a `cameras.json`.
///
/// # Errors
/// [`FormatError`] if the file cannot be written; then it is as it was.
pub fn write_cameras(path: &Path, views: &[SceneView]) -> Result<(), FormatError> {
    let entries: Vec<serde_json::Value> =
        views.iter().enumerate().map(|(id, view)| entry(id, view)).collect();
    let text = serde_json::to_string_pretty(&entries)
        .map_err(|error| FormatError::value(path, error.to_string()))?;
    write_atomically(path, |out| Ok(writeln!(out, "{text}")?))
}

fn entry(id: usize, view: &SceneView) -> serde_json::Value {
    let Camera { width, height, fx, fy, cx, cy, .. } = view.camera;
    let rotation = view.camera.rotation();
    serde_json::json!({
        "id": id,
        "img_name": view.name,
        "width": width,
        "height": height,
        "position": view.camera.center(),
        // World from camera, row by row: the columns of camera_from_world.
        "rotation": [rotation.x_axis, rotation.y_axis, rotation.z_axis],
        "fx": fx,
        "fy": fy,
        "cx": cx,
        "cy": cy,
    })
}

/// Reads the views of the scene file `file`, which was given as `path`: the first there is of the
/// `cameras.json` of a folder that was given, the views beside the file, and the `cameras.json` of
/// the training that it lies in; then those of the file that it leads to as a symbolic link.
pub(super) fn views_of(path: &Path, file: &Path) -> Result<Vec<SceneView>, FormatError> {
    let mut candidates = Vec::new();
    if file != path {
        candidates.push(path.join(CAMERAS));
    }
    for place in places(file) {
        candidates.push(cameras_path(&place));
        candidates.extend(training_of(&place).map(|training| training.join(CAMERAS)));
    }
    for candidate in candidates {
        if let Some(views) = cameras_in(&candidate)? {
            return Ok(views);
        }
    }
    Ok(Vec::new())
}

/// Returns the folder of the training that a scene file lies in: that above
/// `point_cloud/iteration_<n>/point_cloud.ply`.
fn training_of(file: &Path) -> Option<&Path> {
    let is_named = |path: &Path, name: &str| path.file_name().is_some_and(|found| found == name);
    let iteration = file.parent().filter(|_| is_named(file, "point_cloud.ply"))?;
    iteration.file_name()?.to_str()?.strip_prefix("iteration_")?.parse::<u64>().ok()?;
    let clouds = iteration.parent().filter(|clouds| is_named(clouds, "point_cloud"))?;
    clouds.parent()
}

/// Reads a `cameras.json`, in its order; `None` if it is not there.
///
/// The principal point is in the middle of the picture unless `cx` and `cy` say otherwise, which
/// only some programs write.
///
/// # Errors
/// [`FormatError`] with line and column, if it is not JSON or a camera cannot be used.
pub(super) fn cameras_in(path: &Path) -> Result<Option<Vec<SceneView>>, FormatError> {
    let read = files::read_if_there(path).map_err(|error| FormatError::reading(path, error))?;
    let Some(text) = read else { return Ok(None) };
    let entries: Result<Vec<Entry>, _> = serde_json::from_slice(files::without_byte_order_mark(&text));
    let entries = entries.map_err(|error| json_fault(path, &error, "correct or remove the file"))?;
    Ok(Some(entries.into_iter().map(|entry| entry.0).collect()))
}

/// A view that is checked while it is parsed, so that the error of the parser has its place.
#[derive(Deserialize)]
#[serde(try_from = "Raw")]
struct Entry(SceneView);

/// One camera as the file has it; other keys are left alone.
#[derive(Deserialize)]
struct Raw {
    img_name: String,
    #[serde(deserialize_with = "pixels")]
    width: u32,
    #[serde(deserialize_with = "pixels")]
    height: u32,
    /// Camera centre, world axes.
    position: DVec3,
    /// World from camera, row by row.
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
    cx: Option<f64>,
    cy: Option<f64>,
}

/// A size; some programs write it as 420.0.
fn pixels<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let number = f64::deserialize(deserializer)?;
    if number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number) {
        return Ok(number as u32);
    }
    Err(D::Error::custom(format!("{number} is not a number of pixels")))
}

impl TryFrom<Raw> for Entry {
    type Error = String;

    fn try_from(raw: Raw) -> Result<Self, String> {
        let fault = |message: &str| format!("the camera of {:?}: {message}", raw.img_name);
        // The rows of world_from_camera are the columns of camera_from_world.
        let [x, y, z] = raw.rotation.map(DVec3::from);
        let rotation = DMat3::from_cols(x, y, z);
        let rotation = rotation_of(&rotation)
            .map_err(|e| fault(&format!("its rotation is not a rotation matrix: {e}")))?;
        let middle = |side: u32| 0.5 * f64::from(side);
        let center = [raw.cx.unwrap_or(middle(raw.width)), raw.cy.unwrap_or(middle(raw.height))];
        let pinhole = Camera::pinhole((raw.width, raw.height), [raw.fx, raw.fy], center);
        let camera = Camera { viewmat: viewmat_at(rotation, raw.position), ..pinhole };
        camera.check().map_err(|e| fault(&e.to_string()))?;
        Ok(Self(SceneView { name: raw.img_name, camera }))
    }
}
