//! Perfect captures of a built-in place: a data set as COLMAP leaves it, in metres, and the truth
//! beside it.
//!
//! ```text
//! made-up.txt                 what it is
//! images/00000.png ...        photos
//! sparse/0/                   cameras, poses, and points on the surfaces with their tracks
//! truth/depth/00000.npy ...   view z of the first surface at each pixel's centre, m; 0 in the sky
//! truth/normal/00000.npy ...  its normal, world axes, towards the camera; 0 in the sky
//! truth/sky/00000.npy ...     1 in the sky, else 0
//! ```
//! Cameras, points and where they are seen are exact, so that whatever differs later is not theirs.
//! Everything is the same for any number of threads.

pub(crate) mod files;

use crate::{PhotoPixel, Place, display_of};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};
use wm_base::files::write_atomically;
use wm_base::random::uniform;
use wm_base::{FormatError, Problem};
use wm_capture::colmap::write;
use wm_capture::colmap::write::ColmapStorage;
use wm_capture::{Capture, CaptureView, Observation};
use wm_scene::{Camera, CameraError, SparsePoints, camera::Distortion};

/// The positions from which the photos are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraRoute {
    /// Forward along the place's walk, in three lanes in turn: a single line of cameras that look
    /// where they go sees what is ahead from one side alone.
    #[default]
    Walk,
    /// Around the middle of the place, from above.
    Orbit,
}

/// The choice whether exact depth, normals and sky are written too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GroundTruth {
    /// Writes them.
    #[default]
    Write,
    /// Omits them.
    Omit,
}

/// The options of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DatasetOptions {
    /// The positions from which the photos are taken.
    pub route: CameraRoute,
    /// The number of photos, 1 and above.
    pub count: u32,
    /// Their width and height, px.
    pub size: (u32, u32),
    /// A pixel is the mean of this squared rays.
    pub samples: u32,
    /// Most points.
    pub points: u32,
    /// The encoding of the COLMAP model.
    pub storage: ColmapStorage,
    /// The ground truth that is written too.
    pub truth: GroundTruth,
}

impl DatasetOptions {
    /// Six photos of 72x48 px, for tests.
    pub const TINY: Self = Self {
        route: CameraRoute::Orbit,
        count: 6,
        size: (72, 48),
        samples: 1,
        points: 250,
        storage: ColmapStorage::Binary,
        truth: GroundTruth::Omit,
    };
}

impl Default for DatasetOptions {
    fn default() -> Self {
        Self {
            route: CameraRoute::Walk,
            count: 40,
            size: (600, 400),
            samples: 2,
            points: 20_000,
            storage: ColmapStorage::Binary,
            truth: GroundTruth::Write,
        }
    }
}

/// The file that says what the folder holds.
pub const MARK: &str = "made-up.txt";
/// The text of [`MARK`].
const MARK_TEXT: &str = "Photos of a built-in place of Weather-Magician, ray-cast; poses and points are exact, in metres.\n\
    truth/, where it is: depth (view z, m), normal (world axes) and sky of each pixel's centre.\n";

/// The lanes of the walk: to the right of its middle, m; above eye level, m; turned to the right,
/// degrees.
const WALK_LANES: [(f64, f64, f64); 3] = [(0.0, 0.0, 0.0), (-0.9, 0.5, 10.0), (0.9, -0.3, -10.0)];
/// Depth tolerance of the visibility test, m: a surface nearer to a point does not hide it.
const VISIBILITY_TOLERANCE_M: f64 = 0.02;

/// The cameras of a route, in their order.
///
/// # Errors
/// [`CameraError`] if the size makes no camera.
pub fn cameras(place: &Place, options: &DatasetOptions) -> Result<Vec<Camera>, CameraError> {
    let count = options.count.max(1);
    let camera = |index: u32| match options.route {
        CameraRoute::Walk => {
            let mut view = place.dolly(f64::from(index) / f64::from((count - 1).max(1)));
            let (right, above, turn) = WALK_LANES[index as usize % WALK_LANES.len()];
            let ahead = view.target - view.eye;
            view.eye += ahead.cross(DVec3::Z).normalize() * right + DVec3::Z * above;
            // Towards the middle of the way from both sides, so that much is seen from all lanes.
            view.target = view.eye + DQuat::from_rotation_z(-turn.to_radians()) * ahead;
            view.camera(options.size)
        }
        CameraRoute::Orbit => {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(index) / f64::from(count)).sin_cos();
            // Two heights in turn: one ring of cameras alone leaves heights uncertain.
            let height = if index.is_multiple_of(2) { 24.0 } else { 34.0 };
            let (target, radius) = (place.sights.middle, place.sights.orbit);
            let eye = target + DVec3::new(radius * cos, radius * sin, height);
            Camera::looking(options.size, 50.0, eye, target, DVec3::Z)
        }
    };
    (0..count).map(camera).collect()
}

/// Writes a data set to a folder, which is created if needed, and returns the capture that it
/// holds.
///
/// `progress` receives the number of finished photos and returns false to stop; then the result is
/// `None`. Rows are cast on all threads.
///
/// # Errors
/// [`FormatError`] if a file cannot be written or the size makes no camera.
pub fn write(
    place: &Place,
    folder: &Path,
    options: &DatasetOptions,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Option<Capture>, FormatError> {
    let cameras = cameras(place, options);
    let cameras = cameras.map_err(|e| FormatError::value(folder, e.to_string()))?;
    let truth = if options.truth == GroundTruth::Write { &["depth", "normal", "sky"][..] } else { &[] };
    let images = prepare(folder, MARK_TEXT, truth.iter().copied())?;
    let mut views = Vec::with_capacity(cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        let rows = (0..camera.height).into_par_iter();
        let pixels: Vec<PhotoPixel> =
            rows.flat_map_iter(|y| place.photo_row(camera, y, options.samples)).collect();
        let stem = format!("{index:05}");
        let name = format!("{stem}.png");
        let rgb: Vec<u8> = pixels.iter().flat_map(|pixel| pixel.rgb.map(to_byte)).collect();
        files::write_png(&images.join(&name), options.size, &rgb, None)?;
        if options.truth == GroundTruth::Write {
            files::write_maps(&folder.join("truth"), &stem, camera, &pixels)?;
        }
        views.push(CaptureView::new(&name, *camera, Distortion::None, 1));
        if !progress(index + 1) {
            return Ok(None);
        }
    }
    let (points, observations) = points(place, &cameras, options.points as usize);
    let capture =
        Capture { source: folder.into(), images, views, points, observations, ..Capture::default() };
    write::write(&capture, &folder.join("sparse/0"), options.storage)?;
    Ok(Some(capture))
}

/// Makes the folder of a data set with the folders of its photos and of its `truth`; returns that of
/// the photos. The file [`MARK`] comes before any photo: without it the photos are taken for
/// somebody else's.
pub(crate) fn prepare(
    folder: &Path,
    about: &str,
    truth: impl Iterator<Item = &'static str>,
) -> Result<PathBuf, FormatError> {
    let make = |folder: &Path| {
        fs::create_dir_all(folder).map_err(|e| FormatError::whole(folder, Problem::Write(e.into())))
    };
    make(folder)?;
    write_atomically(&folder.join(MARK), |out| Ok(out.write_all(about.as_bytes())?))?;
    let images = folder.join("images");
    make(&images)?;
    for name in truth {
        make(&folder.join("truth").join(name))?;
    }
    Ok(images)
}

/// Points on surfaces that two cameras see at least, and where each sees which.
fn points(place: &Place, cameras: &[Camera], most: usize) -> (SparsePoints, Vec<Vec<Observation>>) {
    const SEED: u64 = 31;
    // A ray from some pixel of some camera; one in two or so ends in the sky or is seen once.
    let candidate = |index: u64| {
        let random = |lane: u64| uniform(SEED, 4 * index + lane);
        let camera = &cameras[(random(0) * cameras.len() as f64) as usize % cameras.len()];
        let (x, y) = (random(1) * f64::from(camera.width), random(2) * f64::from(camera.height));
        let (eye, direction) = (camera.center(), camera.ray(x, y));
        let hit = place.cast(eye, direction)?;
        let seen = |(index, camera)| Some((index, sees(place, camera, hit.point, VISIBILITY_TOLERANCE_M)?));
        let seen: Vec<(usize, [f32; 2])> = cameras.iter().enumerate().filter_map(seen).collect();
        let color = display_of(hit.radiance).map(to_byte);
        (seen.len() >= 2).then_some((hit.point, color, seen))
    };
    let mut points = SparsePoints::default();
    let mut observations = vec![Vec::new(); cameras.len()];
    let found: Vec<_> = (0..3 * most as u64).into_par_iter().filter_map(candidate).collect();
    for (point, color, seen) in found.into_iter().take(most) {
        for (camera, xy) in &seen {
            observations[*camera].push(Observation { point: points.len() as u32, xy: *xy });
        }
        points.push(point.to_array(), color, 0.0, seen.len() as u32);
    }
    (points, observations)
}

/// The position at which a camera sees a point, px; `None` if it does not. What is less than
/// `slack` m before a point does not hide it.
pub(crate) fn sees(place: &Place, camera: &Camera, point: DVec3, slack: f64) -> Option<[f32; 2]> {
    let (x, y, _) = camera.project(point)?;
    let is_inside = x > 0.0 && y > 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    if !is_inside {
        return None;
    }
    let eye = camera.center();
    let first = place.first(eye, point - eye)?;
    (first.t > eye.distance(point) - slack).then_some([x as f32, y as f32])
}

pub(crate) fn to_byte(value: f64) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Street;
    use std::io;
    use tempfile::tempdir;
    use wm_base::npy;
    use wm_capture::{CaptureOptions, read};

    /// Width and height of a PNG file, px, and the number of bytes of its pixels.
    fn decoded(path: &Path) -> (u32, u32, usize) {
        let file = io::BufReader::new(fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let frame = reader.next_frame(&mut pixels).unwrap();
        (frame.width, frame.height, frame.buffer_size())
    }

    #[test]
    fn what_is_written_is_a_capture_with_its_truth() {
        let street = Street::builtin();
        for (route, storage) in
            [(CameraRoute::Walk, ColmapStorage::Binary), (CameraRoute::Orbit, ColmapStorage::Text)]
        {
            let folder = tempdir().unwrap();
            let truth = GroundTruth::Write;
            let options =
                DatasetOptions { route, size: (60, 40), points: 200, storage, truth, ..DatasetOptions::TINY };
            let mut done = 0;
            let mut progress = |count| {
                done = count;
                true
            };
            let written = write(&street, folder.path(), &options, &mut progress).unwrap().unwrap();
            assert_eq!(done, 6);
            let capture = read(folder.path(), &CaptureOptions::default()).unwrap();
            assert_eq!((&capture.points, &capture.observations), (&written.points, &written.observations));
            assert_eq!(capture.points.len(), 200);
            capture.check_trainable().unwrap();

            for (index, (view, seen)) in capture.views.iter().zip(&capture.observations).enumerate() {
                assert_eq!(decoded(&capture.images.join(&view.file)), (60, 40, 60 * 40 * 3));
                let truth = |kind: &str| {
                    npy::read(&folder.path().join(format!("truth/{kind}/{index:05}.npy"))).unwrap()
                };
                let ((depth, shape), (normal, _), (sky, _)) = (truth("depth"), truth("normal"), truth("sky"));
                assert_eq!(shape, [40, 60]);
                for ((depth, sky), normal) in depth.iter().zip(&sky).zip(normal.chunks(3)) {
                    let length = normal.iter().map(|v| v * v).sum::<f32>();
                    assert!((*depth > 0.0) == (*sky == 0.0) && (length - (1.0 - sky)).abs() < 1e-5);
                }
                for observation in seen {
                    let point = DVec3::from(capture.points.positions[observation.point as usize]);
                    let (x, y) = view.project(point).unwrap();
                    let [seen_x, seen_y] = observation.xy.map(f64::from);
                    // f32 keeps 60 px to 4e-6.
                    assert!((x - seen_x).hypot(y - seen_y) < 1e-5);
                }
            }
            // Neighbours along the route share points.
            assert!(!capture.neighbours(2, 1).is_empty());
        }
    }
}
