//! `transforms.json`, as nerfstudio and instant-ngp write it.
//!
//! Cameras are world_from_camera with OpenGL axes (x right, y up, z backward); y and z change their
//! signs here. Intrinsics stand once for all frames or in each. `ply_file_path` names the points,
//! in the same axes as the frames. Where there is none, but the COLMAP model that the file was made
//! from lies in `colmap/sparse/0`, its points are taken and moved by `applied_transform`, with
//! which the cameras have been moved already. A scale (`aabb_scale`, `scale`, `offset`) is not
//! applied. Where the file does not say how large the photos are, their headers are read.

#[cfg(test)]
mod tests;

use super::{Capture, CaptureOptions, CaptureView, JSON_ADVICE, ReadScope, find_main, places};
use crate::logs::read_json;
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use wm_base::{
    FormatError,
    error::one_line,
    file_index::{self, FileIndex, FileKind},
};
use wm_image::header;
use wm_scene::SparsePoints;
use wm_scene::camera::Distortion;
use wm_scene::{
    Camera, Remark,
    camera::{rotation_of, viewmat_at},
    formats::read_points,
};

/// Names of the file, the likeliest first.
const FILES: [&str; 2] = ["transforms.json", "transforms_train.json"];

/// Intrinsics: at the top of the file, in a frame, or both, of which the frame's win.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
struct Intrinsics {
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    // Some writers have them as floats.
    w: Option<f64>,
    h: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    is_fisheye: Option<bool>,
}

#[derive(Debug, Deserialize)]
struct Transforms {
    #[serde(flatten)]
    shared: Intrinsics,
    camera_model: Option<String>,
    ply_file_path: Option<String>,
    applied_transform: Option<Vec<[f64; 4]>>,
    frames: Vec<Frame>,
}

#[derive(Debug, Deserialize)]
struct Frame {
    file_path: String,
    mask_path: Option<String>,
    depth_file_path: Option<serde::de::IgnoredAny>,
    /// world_from_camera, row by row: 4 rows, or 3.
    transform_matrix: Vec<[f64; 4]>,
    camera_model: Option<String>,
    #[serde(flatten)]
    own: Intrinsics,
}

impl Intrinsics {
    fn or(self, other: Self) -> Self {
        // An angle of the frame wins over a focal length that all share.
        let has_focal = self.fl_x.or(self.camera_angle_x).is_some();
        let kept = |own: Option<f64>, shared: Option<f64>| own.or(if has_focal { None } else { shared });
        macro_rules! or {
            ($($field:ident)+) => {
                Self {
                    fl_x: kept(self.fl_x, other.fl_x),
                    fl_y: kept(self.fl_y, other.fl_y),
                    camera_angle_x: kept(self.camera_angle_x, other.camera_angle_x),
                    camera_angle_y: kept(self.camera_angle_y, other.camera_angle_y),
                    $($field: self.$field.or(other.$field)),+
                }
            };
        }
        or!(cx cy w h k1 k2 k3 k4 p1 p2 is_fisheye)
    }

    fn camera(&self, size: (u32, u32)) -> Result<(Camera, Distortion), String> {
        if self.k4.is_some_and(|v| v != 0.0) {
            return Err(format!("its lens has k4, which is not read; {UNDISTORT}"));
        }
        let (width, height) = (f64::from(size.0), f64::from(size.1));
        let of_angle = |angle: Option<f64>, side: f64| angle.map(|a| 0.5 * side / (0.5 * a).tan());
        let fx = self.fl_x.or(of_angle(self.camera_angle_x, width));
        let fy = self.fl_y.or(of_angle(self.camera_angle_y, height));
        let Some(fx) = fx.or(fy) else {
            return Err("it has no focal length: fl_x or camera_angle_x is needed".into());
        };
        let center = [self.cx.unwrap_or(0.5 * width), self.cy.unwrap_or(0.5 * height)];
        let camera = Camera::pinhole(size, [fx, fy.unwrap_or(fx)], center);
        camera.check().map_err(|e| e.to_string())?;
        let lens = [self.k1, self.k2, self.p1, self.p2, self.k3].map(|v| v.unwrap_or(0.0));
        Ok((camera, Distortion::from_file(lens)?))
    }
}

/// The advice for a lens that is not read.
const UNDISTORT: &str = "undistort the photos with `colmap image_undistorter` and give its output";

pub(super) fn read(
    dataset: &Path,
    options: &CaptureOptions,
    scope: ReadScope,
) -> Result<Option<Capture>, FormatError> {
    let is_main =
        |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let Some((path, folder)) = find_main(dataset, &FILES, is_main) else { return Ok(None) };
    let transforms: Transforms = read_json(&path, JSON_ADVICE)?;
    if transforms.frames.is_empty() {
        let problem = "there are no frames in it; export the capture again";
        return Err(FormatError::value(&path, problem));
    }
    // Photos are looked for before their cameras are known, which may lack their size.
    let mut views: Vec<CaptureView> = transforms.frames.iter().map(Frame::named).collect();
    let usual: Vec<&str> = [""].into_iter().chain(places::IMAGES).collect();
    let (images, mut remarks) = places::find(&[&folder], options, &usual, &mut views)?;
    let mut cameras: Vec<(Camera, Distortion)> = Vec::new();
    for (frame, view) in transforms.frames.iter().zip(&mut views) {
        let fault = |what: String| {
            let what = one_line(&format!("the frame {:?}: {what}", frame.file_path));
            FormatError::value(&path, what)
        };
        let model = frame.camera_model.as_deref().or(transforms.camera_model.as_deref());
        check_model(model).map_err(&fault)?;
        set_camera(view, frame, &transforms.shared, &images, &mut cameras, &fault)?;
    }
    let points = match scope {
        ReadScope::Views => SparsePoints::default(),
        ReadScope::Everything => points_of(&transforms, &folder, &path, &mut remarks)?,
    };
    remarks.extend(unused(&transforms, &path));
    Ok(Some(Capture { images, views, points, remarks, ..Capture::default() }))
}

impl Frame {
    /// The view without its camera.
    fn named(&self) -> CaptureView {
        CaptureView {
            name: self.file_path.trim_start_matches("./").replace('\\', "/"),
            mask: self.mask_path.as_ref().map(PathBuf::from),
            ..CaptureView::without_camera(&self.file_path)
        }
    }
}

fn set_camera(
    view: &mut CaptureView,
    frame: &Frame,
    shared: &Intrinsics,
    images: &Path,
    cameras: &mut Vec<(Camera, Distortion)>,
    fault: &impl Fn(String) -> FormatError,
) -> Result<(), FormatError> {
    let own = frame.own.or(*shared);
    if own.is_fisheye == Some(true) {
        return Err(fault(format!("its lens is a fisheye, which is not read; {UNDISTORT}")));
    }
    let side = |length: f64| {
        // Above what a camera may have, so that the check refuses it.
        if length.fract() == 0.0 && (0.0..4e9).contains(&length) { length as u32 } else { u32::MAX }
    };
    let size = match (own.w, own.h) {
        (Some(w), Some(h)) => (side(w), side(h)),
        _ => {
            let photo = places::photo(images, view).ok_or_else(|| {
                fault("the photo is missing, and the file does not say its size (w and h)".into())
            })?;
            let header = header::read_header(&photo)?;
            (header.width, header.height)
        }
    };
    let (camera, distortion) = own.camera(size).map_err(fault)?;
    let viewmat = viewmat(&frame.transform_matrix).map_err(fault)?;
    let known = cameras.iter().position(|known| *known == (camera, distortion));
    let camera_id = known.unwrap_or_else(|| {
        cameras.push((camera, distortion));
        cameras.len() - 1
    });
    view.camera = Camera { viewmat, ..camera };
    view.camera.check().map_err(|e| fault(e.to_string()))?;
    view.distortion = distortion;
    view.camera_id = camera_id as u32 + 1;
    Ok(())
}

/// Remarks on what else is there and is not read.
fn unused(transforms: &Transforms, path: &Path) -> Vec<Remark> {
    let mut remarks = Vec::new();
    let count = transforms.frames.iter().filter(|frame| frame.depth_file_path.is_some()).count();
    if count > 0 {
        let text = format!(
            "{} names depth maps of {count} photos, which are not read with it; `priors --depth FOLDER` reads them",
            path.display()
        );
        remarks.push(Remark::note("depth-unused", text));
    }
    if path.file_name().is_some_and(|name| name == FILES[1]) {
        let others = ["transforms_test.json", "transforms_val.json"];
        let others: Vec<&str> =
            others.into_iter().filter(|name| path.with_file_name(name).is_file()).collect();
        if !others.is_empty() {
            let text = format!(
                "{} is read; {} passed over",
                path.display(),
                match others[..] {
                    [one] => format!("{one} is"),
                    _ => format!("{} are", others.join(" and ")),
                }
            );
            remarks.push(Remark::note("other-models", text));
        }
    }
    remarks
}

fn check_model(model: Option<&str>) -> Result<(), String> {
    match model {
        None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE") => {
            Ok(())
        }
        Some(other) => {
            let other = wm_base::error::excerpt(other.as_bytes());
            Err(format!("its camera model {other} is not read; {UNDISTORT}"))
        }
    }
}

/// camera_from_world with OpenCV axes of world_from_camera with OpenGL axes.
pub(super) fn viewmat(rows: &[[f64; 4]]) -> Result<glam::DMat4, String> {
    let &([a, b, c] | [a, b, c, _]) = rows else {
        return Err(format!("its transform_matrix has {} rows: 4 are needed", rows.len()));
    };
    let column = |k: usize| DVec3::new(a[k], b[k], c[k]);
    let world_from_camera = DMat3::from_cols(column(0), -column(1), -column(2));
    let world_from_camera = rotation_of(&world_from_camera)
        .map_err(|e| format!("its transform_matrix is not a rotation with a translation: {e}"))?;
    Ok(viewmat_at(world_from_camera.transpose(), column(3)))
}

/// Names of the files of points that programs write without naming them, in the axes of the frames.
const POINTS: [&str; 4] = ["sparse_pc.ply", "points3d.ply", "points3D.ply", "points.ply"];

fn points_of(
    transforms: &Transforms,
    folder: &Path,
    path: &Path,
    remarks: &mut Vec<Remark>,
) -> Result<SparsePoints, FormatError> {
    let named = transforms.ply_file_path.as_deref().map(|name| {
        let index = FileIndex::new(folder, FileKind { extensions: &["ply"], endings: &[], skipped: &[] });
        let found = index.find(name).map_err(|e| FormatError::value(path, e.to_string()))?;
        Ok(found.map_or_else(|| folder.join(file_index::plain(name)), |found| found.path))
    });
    let model = folder.join("colmap");
    let has_model = model.join("sparse").is_dir();
    let usual = || POINTS.iter().map(|name| folder.join(name)).find(|file| !has_model && file.is_file());
    if let Some(file) = named.transpose()?.or_else(usual) {
        let (points, found) = read_points(&file)?;
        remarks.extend(found);
        return Ok(points);
    }
    if !has_model {
        return Ok(SparsePoints::default());
    }
    // The frames are in the axes of this model, even where another one has more photos.
    let first = Path::new("sparse/0");
    let options = CaptureOptions {
        model: model.join(first).is_dir().then(|| first.into()),
        ..CaptureOptions::default()
    };
    let mut points = super::colmap::read_points(&model, &options)?;
    if let Some(rows) = &transforms.applied_transform {
        let &([a, b, c] | [a, b, c, _]) = rows.as_slice() else {
            let what = "applied_transform needs 3 or 4 rows";
            return Err(FormatError::value(path, what));
        };
        for [x, y, z] in &mut points.positions {
            let moved = [a, b, c].map(|[p, q, r, t]| p * *x + q * *y + r * *z + t);
            [*x, *y, *z] = moved;
        }
    }
    Ok(points)
}
