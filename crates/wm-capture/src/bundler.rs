//! Bundler's `bundle.out`, version 0.3, with the names of its photos in a list; Metashape,
//! RealityScan and others export it.
//!
//! A camera is a focal length (px), k1 and k2, and camera_from_world with OpenGL axes (y up,
//! looking along -z), which change signs here. The principal point is the middle of the photo,
//! whose size is read from its header. A camera with a focal length of 0 was not registered. Points
//! have a place, a colour, and where they were seen, from the middle of the photo with y up.

use super::{Capture, CaptureOptions, CaptureView, Observation, ReadScope, find_main, places};
use glam::{DMat3, DMat4, DVec3};
use std::path::{Path, PathBuf};
use wm_base::{
    FormatError, Problem,
    error::{number, one_line},
    source::Source,
};
use wm_image::header;
use wm_scene::SparsePoints;
use wm_scene::camera::Distortion;
use wm_scene::{
    Camera,
    camera::{rotation_of, viewmat_of},
};

/// The paths of the file within a data set, in the order in which they are tried.
const FILES: [&str; 3] = ["bundle.out", "bundle/bundle.out", "bundle.rd.out"];
/// The list of photos, beside it or in the data set; else any other file whose name ends in `.lst`.
const LISTS: [&str; 5] =
    ["list.txt", "bundle.list.txt", "bundle.out.list.txt", "imagelist.lst", "imagelist.txt"];

pub(super) fn read(
    dataset: &Path,
    options: &CaptureOptions,
    scope: ReadScope,
) -> Result<Option<Capture>, FormatError> {
    // Any other name, if it says of itself what it is.
    let named = || {
        let file = with_extension(dataset, "out").filter(|file| dataset.is_dir() && is_bundle(file))?;
        Some((file, dataset.to_path_buf()))
    };
    let is_main = |path: &Path| path.extension().is_some_and(|extension| extension == "out");
    let Some((path, folder)) = find_main(dataset, &FILES, is_main).or_else(named) else {
        return Ok(None);
    };
    let beside = path.parent().unwrap_or(&folder);
    let lists =
        [beside, &folder].into_iter().flat_map(|place| LISTS.iter().map(move |name| place.join(name)));
    let Some(list) = lists.into_iter().find(|list| list.is_file()).or_else(|| with_extension(beside, "lst"))
    else {
        let what = "the list of its photos, list.txt or imagelist.lst, is not beside it; export it too";
        return Err(FormatError::value(&path, what));
    };
    let names = read_list(&list)?;
    let mut source = Source::open(&path)?;
    let mut words = Words { source: &mut source };
    let count: usize = words.next("the number of cameras")?;
    let point_count: u64 = words.next("the number of points")?;
    if count != names.len() {
        let what = format!("it has {count} cameras, {} names {} photos", list.display(), names.len());
        return Err(FormatError::value(&path, one_line(&what)));
    }
    // Photos are looked for before their cameras are known: their size is part of those.
    let mut all: Vec<CaptureView> = names.iter().map(|name| CaptureView::without_camera(name)).collect();
    let (images, remarks) = places::find(&[&folder, beside], options, &places::IMAGES, &mut all)?;
    let mut views = Vec::new();
    // Which view each camera of the file is.
    let mut places_of = Vec::with_capacity(count);
    for (index, mut view) in all.into_iter().enumerate() {
        let pose = words.camera()?;
        let Some((focal, distortion, viewmat)) = pose else {
            places_of.push(None);
            continue;
        };
        let photo = places::photo(&images, &view).ok_or_else(|| {
            let problem = Problem::Photo("the photo is missing, whose size is needed".into());
            FormatError::whole(&images.join(&view.file), problem)
        })?;
        let size = header::read_header(&photo)?;
        let center = [0.5 * f64::from(size.width), 0.5 * f64::from(size.height)];
        view.camera = Camera { viewmat, ..Camera::pinhole((size.width, size.height), [focal; 2], center) };
        view.distortion = distortion;
        view.camera_id = index as u32 + 1;
        let fault = |e: wm_scene::CameraError| {
            FormatError::value(&path, format!("camera {index}, {}: {e}", one_line(&view.name)))
        };
        view.camera.check().map_err(fault)?;
        places_of.push(Some(views.len()));
        views.push(view);
    }
    let mut observations = vec![Vec::new(); views.len()];
    let mut points = SparsePoints::default();
    if scope == ReadScope::Everything {
        for _ in 0..point_count {
            words.point(&places_of, &views, &mut points, &mut observations)?;
        }
    }
    if views.is_empty() {
        let what = "no photo is registered in it; reconstruct the capture again";
        return Err(FormatError::value(&path, what));
    }
    Ok(Some(Capture { images, views, points, observations, remarks, ..Capture::default() }))
}

/// The only file in a folder with an extension.
fn with_extension(folder: &Path, extension: &str) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path());
    let mut found =
        entries.filter(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)));
    found.next().filter(|_| found.next().is_none())
}

/// Returns true if a file begins as Bundler's.
fn is_bundle(path: &Path) -> bool {
    let Ok(mut source) = Source::open(path) else { return false };
    matches!(source.line(), Ok(Some(line)) if line.to_ascii_lowercase().starts_with(b"# bundle file"))
}

/// The name in each line.
fn read_list(path: &Path) -> Result<Vec<String>, FormatError> {
    let mut source = Source::open(path)?;
    let mut names = Vec::new();
    while let Some(line) = source.line()? {
        // Bundler's own lists go on with a number and the focal length of the header.
        let line = String::from_utf8_lossy(line);
        let name = line.trim();
        // Names may have spaces, and even such numbers.
        let numbers = name.rsplit_once(' ').and_then(|(before, focal)| {
            let name = before.trim_end().strip_suffix(" 0")?;
            focal.parse::<f64>().ok().map(|_| name.trim_end())
        });
        let name = numbers.unwrap_or(name).trim_matches('"');
        if !name.is_empty() {
            names.push(name.to_owned());
        }
    }
    Ok(names)
}

/// The numbers of the file, across its lines; lines of comment are stepped over.
struct Words<'a, 'b> {
    source: &'a mut Source<'b>,
}

impl Words<'_, '_> {
    fn next<T: std::str::FromStr>(&mut self, what: &'static str) -> Result<T, FormatError> {
        loop {
            let at_end = !self.source.fill(1)?;
            if at_end {
                return Err(self.source.whole(Problem::CaptureTruncated { what: what.into() }));
            }
            if self.source.bytes()[0] == b'#' {
                self.source.skip_line()?;
                continue;
            }
            if let Some(word) = self.source.word()? {
                let parsed = number(word, what);
                return parsed.map_err(|problem| self.source.in_line(problem));
            }
        }
    }

    fn vector(&mut self, what: &'static str) -> Result<DVec3, FormatError> {
        Ok(DVec3::new(self.next(what)?, self.next(what)?, self.next(what)?))
    }

    /// Focal length, distortion and pose of the next camera; `None` if it was not registered.
    fn camera(&mut self) -> Result<Option<(f64, Distortion, DMat4)>, FormatError> {
        const WHAT: &str = "a camera";
        let [focal, k1, k2] = self.vector(WHAT)?.to_array();
        let rows = [self.vector(WHAT)?, self.vector(WHAT)?, self.vector(WHAT)?];
        let translation = self.vector(WHAT)?;
        if focal == 0.0 {
            return Ok(None);
        }
        // y and z of the camera change their signs.
        let flip = DVec3::new(1.0, -1.0, -1.0);
        let rotation = DMat3::from_cols(rows[0], -rows[1], -rows[2]).transpose();
        let fault = |what: String| self.source.in_line(Problem::Value(format!("{what}; export it again")));
        let distortion = Distortion::from_file([k1, k2, 0.0, 0.0, 0.0])
            .map_err(|what| fault(format!("a camera: {what}")))?;
        let rotation = rotation_of(&rotation)
            .map_err(|e| fault(format!("the rotation of a camera is not a rotation matrix: {e}")))?;
        Ok(Some((focal, distortion, viewmat_of(rotation, translation * flip))))
    }

    fn point(
        &mut self,
        places_of: &[Option<usize>],
        views: &[CaptureView],
        points: &mut SparsePoints,
        observations: &mut [Vec<Observation>],
    ) -> Result<(), FormatError> {
        const WHAT: &str = "a point";
        let (place, color) = (self.vector(WHAT)?, self.vector(WHAT)?);
        let seen: u32 = self.next(WHAT)?;
        let point = points.len() as u32;
        for _ in 0..seen {
            let (camera, _): (usize, u64) = (self.next(WHAT)?, self.next(WHAT)?);
            let (x, y): (f32, f32) = (self.next(WHAT)?, self.next(WHAT)?);
            let view = places_of.get(camera).copied().flatten();
            if let Some(view) = view.filter(|_| x.is_finite() && y.is_finite()) {
                let Camera { cx, cy, .. } = views[view].camera;
                observations[view].push(Observation { point, xy: [cx as f32 + x, cy as f32 - y] });
            }
        }
        points.push(place.to_array(), color.to_array().map(|v| v.clamp(0.0, 255.0) as u8), f32::NAN, seen);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate as capture;
    use std::fs;
    use tempfile::{TempDir, tempdir};

    /// The first bytes of a PNG of 800 x 600 px.
    const PNG: &[u8] =
        b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\x03\x20\0\0\x02\x58\x08\x02\0\0\0CRC_\0\0\0\0IDAT";
    /// A camera at (0, 0, 5) that looks along -z, one that was not registered, and a point before
    /// the first.
    const WHOLE: &str = "# Bundle file v0.3\n2 1\n700 -0.1 0.01\n1 0 0\n0 1 0\n0 0 1\n0 0 -5\n0 0 0\n0 0 0\n0 0 0\n\
                         0 0 0\n0 0 0\n1 2 0\n10 20 30\n1 0 4 140 280\n";

    fn folder_with(text: &str) -> TempDir {
        let folder = tempdir().unwrap();
        fs::write(folder.path().join("bundle.out"), text).unwrap();
        fs::write(folder.path().join("list.txt"), "a.png\nb.png 0 532.1\n").unwrap();
        fs::write(folder.path().join("a.png"), PNG).unwrap();
        folder
    }

    #[test]
    fn cameras_and_points_are_read() {
        let folder = folder_with(WHOLE);
        let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
        let [view] = &capture.views[..] else { panic!("one view") };
        assert_eq!((view.name.as_str(), view.camera.width, view.camera.fx), ("a.png", 800, 700.0));
        assert_eq!(view.distortion, Distortion::Radial { k1: -0.1, k2: 0.01 });
        assert!((view.camera.center() - DVec3::new(0.0, 0.0, 5.0)).length() < 1e-12);
        assert!((view.camera.forward() - DVec3::NEG_Z).length() < 1e-12);
        // Without the lens the point is at (1/5, 2/5) of the focal length, y up: there it was seen.
        let camera = Camera { ..view.camera };
        let (x, y, _) = camera.project(DVec3::new(1.0, 2.0, 0.0)).unwrap();
        let seen = capture.observations[0][0].xy;
        assert!(
            (x - f64::from(seen[0])).abs() < 1e-3 && (y - f64::from(seen[1])).abs() < 1e-3,
            "{x} {y} {seen:?}"
        );
        assert_eq!((capture.points.colors[0], capture.points.track_lengths[0]), ([10, 20, 30], 1));
    }

    #[test]
    fn lists_of_other_computers_name_photos_with_spaces() {
        let folder = folder_with(WHOLE);
        fs::remove_file(folder.path().join("list.txt")).unwrap();
        fs::create_dir(folder.path().join("photos")).unwrap();
        fs::rename(folder.path().join("a.png"), folder.path().join("photos/a 0 1.png")).unwrap();
        fs::rename(folder.path().join("bundle.out"), folder.path().join("scan.out")).unwrap();
        for (list, text) in [
            ("imagelist.lst", "D:\\my scan\\a 0 1.JPG\r\nD:\\my scan\\b.png\r\n"),
            ("scan.lst", "./a 0 1.png 0 532.1\n./b.png\n"),
        ] {
            fs::write(folder.path().join(list), text).unwrap();
            let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
            assert_eq!(capture.photo(0), Some(folder.path().join("photos/a 0 1.png")), "{list}");
            fs::remove_file(folder.path().join(list)).unwrap();
        }
    }

    #[test]
    fn what_is_cut_or_missing_is_named() {
        for length in 0..WHOLE.len() - 4 {
            let folder = folder_with(&WHOLE[..length]);
            let message = capture::read(folder.path(), &CaptureOptions::default()).unwrap_err().to_string();
            assert!(!message.contains('\n'), "{message}");
        }
        let folder = folder_with(&WHOLE.replace("0 0 1\n0 0 -5", "0 0 2\n0 0 -5"));
        let say = |folder: &TempDir| {
            capture::read(folder.path(), &CaptureOptions::default()).unwrap_err().to_string()
        };
        assert!(
            say(&folder)
                .contains("the rotation of a camera is not a rotation matrix: row 3 has the length 2.0")
        );
        let folder = folder_with(WHOLE);
        fs::remove_file(folder.path().join("a.png")).unwrap();
        assert!(say(&folder).contains("the photo is missing, whose size is needed"));
        fs::remove_file(folder.path().join("list.txt")).unwrap();
        assert!(say(&folder).contains("the list of its photos, list.txt or imagelist.lst, is not beside it"));
    }
}
