//! The raw data of Polycam: `keyframes` with a photo and a JSON of its camera for each picture.
//!
//! A camera has a focal length and a principal point (px), and world_from_camera `t_00` to `t_23`,
//! row by row, with OpenGL axes; the world's y is up. `corrected_cameras` and `corrected_images`,
//! which Polycam writes where it has optimised the poses, come before those of the device. Depth,
//! confidence and meshes are not read. There are no points.

use super::transforms::viewmat;
use super::{Capture, CaptureOptions, CaptureView, ReadScope, places};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use wm_base::error::{json_fault, one_line};
use wm_base::{FormatError, files};
use wm_scene::camera::Distortion;
use wm_scene::{Camera, Remark};

#[derive(Deserialize)]
struct Shot {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
    #[serde(flatten)]
    pose: Pose,
}

#[derive(Deserialize)]
struct Pose {
    t_00: f64,
    t_01: f64,
    t_02: f64,
    t_03: f64,
    t_10: f64,
    t_11: f64,
    t_12: f64,
    t_13: f64,
    t_20: f64,
    t_21: f64,
    t_22: f64,
    t_23: f64,
}

pub(super) fn read(
    dataset: &Path,
    options: &CaptureOptions,
    _scope: ReadScope,
) -> Result<Option<Capture>, FormatError> {
    let folders = [dataset.join("keyframes"), dataset.to_path_buf()];
    let kinds = [("corrected_cameras", "corrected_images"), ("cameras", "images")];
    let places = folders.iter().flat_map(|folder| kinds.map(|kind| (folder, kind)));
    let mut found =
        places.map(|(folder, (cameras, images))| (folder, json_files(&folder.join(cameras)), images));
    let found = found.find(|(folder, files, images)| !files.is_empty() && folder.join(images).is_dir());
    let Some((folder, files, images)) = found else { return Ok(None) };
    let mut views = Vec::with_capacity(files.len());
    for (index, path) in files.iter().enumerate() {
        let fault = |what: String| FormatError::value(path, one_line(&what));
        let text =
            files::read_text(path, files::SMALL_TEXT).map_err(|error| FormatError::reading(path, error))?;
        let shot: Shot = serde_json::from_str(&text)
            .map_err(|error| json_fault(path, &error, "export the raw data again"))?;
        let Pose { t_00, t_01, t_02, t_03, t_10, t_11, t_12, t_13, t_20, t_21, t_22, t_23 } = shot.pose;
        let rows = [[t_00, t_01, t_02, t_03], [t_10, t_11, t_12, t_13], [t_20, t_21, t_22, t_23]];
        let pinhole = Camera::pinhole((shot.width, shot.height), [shot.fx, shot.fy], [shot.cx, shot.cy]);
        let camera = Camera { viewmat: viewmat(&rows).map_err(fault)?, ..pinhole };
        camera.check().map_err(|error| fault(format!("{error}; export the raw data again")))?;
        let name = format!("{}.jpg", path.file_stem().unwrap_or_default().to_string_lossy());
        views.push(CaptureView::new(&name, camera, Distortion::None, index as u32 + 1));
    }
    let mut remarks = Vec::new();
    if images == kinds[1].1 {
        let text = format!(
            "{} has no corrected cameras: those of the device are read, which drift",
            dataset.display()
        );
        remarks.push(Remark::note("device-poses", text));
    }
    let (images, found) = places::find(&[folder], options, &[images], &mut views)?;
    remarks.extend(found);
    Ok(Some(Capture { images, views, remarks, ..Capture::default() }))
}

/// The JSON files of a folder, sorted by name; none if there is no such folder.
fn json_files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")));
    files.sort();
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate as capture;
    use glam::DVec3;
    use std::fs;
    use tempfile::tempdir;

    const SHOT: &str = r#"{"blur_score": 80, "fx": 500, "fy": 500, "cx": 320, "cy": 240, "width": 640, "height": 480,
        "t_00": 1, "t_01": 0, "t_02": 0, "t_03": 4, "t_10": 0, "t_11": 1, "t_12": 0, "t_13": 5,
        "t_20": 0, "t_21": 0, "t_22": 1, "t_23": 6}"#;

    #[test]
    fn keyframes_are_read_and_corrected_ones_first() {
        let folder = tempdir().unwrap();
        let write = |kind: &str, text: &str| {
            for (place, name, text) in [("cameras", "1.json", text), ("images", "1.jpg", "x")] {
                let place = folder.path().join(format!("keyframes/{kind}{place}"));
                fs::create_dir_all(&place).unwrap();
                fs::write(place.join(name), text).unwrap();
            }
        };
        let read = || capture::read(folder.path(), &CaptureOptions::default());
        write("", &format!("\u{feff}{SHOT}"));
        let capture = read().unwrap();
        let camera = capture.views[0].camera;
        assert!((camera.center() - DVec3::new(4.0, 5.0, 6.0)).length() < 1e-12);
        assert!(
            (camera.forward() - DVec3::NEG_Z).length() < 1e-12 && (camera.up() - DVec3::Y).length() < 1e-12
        );
        assert_eq!(capture.photo(0), Some(folder.path().join("keyframes/images/1.jpg")));
        assert_eq!(capture.remarks[0].code, "device-poses");
        write("corrected_", &SHOT.replace("\"t_03\": 4", "\"t_03\": 7"));
        let capture = read().unwrap();
        assert!(capture.remarks.is_empty() && (capture.views[0].camera.center().x - 7.0).abs() < 1e-12);
        for (from, to, says) in [
            ("\"width\": 640", "\"width\": 0", "picture size 0x480"),
            ("\"t_11\": 1", "\"t_11\": 2", "is not a rotation"),
            ("\"fx\": 500", "\"fx\": 1e-317", "focal"),
            ("\"fx\": 500,", "", "missing field `fx`"),
        ] {
            write("corrected_", &SHOT.replace(from, to));
            let message = read().unwrap_err().to_string();
            assert!(message.contains(says) && !message.contains('\n'), "{message}");
        }
    }
}
