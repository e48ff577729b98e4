//! Captures: photographed views from a folder, one module a format, one line a format in the list
//! below.
//!
//! A format recognises its folders and reads a [`Capture`] from them: cameras with OpenCV axes, the
//! distortion of their lenses, the points of the reconstruction, and the folder of the photos. The
//! photos are opened only where a format does not state their size. To add a format: a module with
//! a `read`, and that in the list.
//!
//! A [`DrivingLog`] is what a vehicle recorded, read from KITTI, nuScenes, Argoverse 2 or
//! drivestudio; [`DrivingLog::write_capture`] makes a folder of it that is reconstructed like
//! photos of any other kind.

mod bundler;
mod checks;
pub mod colmap;
pub mod feather;
mod foreign;
pub mod gps;
pub mod ground;
pub mod logs;
mod opensfm;
mod places;
mod polycam;
mod pose;
pub mod site;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
#[cfg(test)]
mod tests;
mod transforms;
pub mod up;

use glam::{DMat3, DVec3};
use std::{
    fs,
    path::{Path, PathBuf},
};
use wm_base::FormatError;
use wm_scene::camera::Distortion;
use wm_scene::{Camera, Remark, SceneView, SparsePoints, origin};

pub use ground::{CaptureGround, CaptureGroundError};
pub use logs::{DrivingLog, LogCaptureOptions, LogCaptureSummary, LogOptions};
pub use pose::RigidPose;
pub use site::CaptureSite;
pub use up::CaptureUp;

/// Reads the capture in a folder, or in a file for formats that are one; `None` if it has another
/// format.
type ReadCapture = fn(&Path, &CaptureOptions, ReadScope) -> Result<Option<Capture>, FormatError>;

/// The reader of each format, in the order in which they are tried.
const READERS: [ReadCapture; 5] =
    [colmap::read, opensfm::read, bundler::read, transforms::read, polycam::read];

/// The part of a capture that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ReadScope {
    Views,
    Everything,
}

/// Folders within a data set; `None` stands for the usual ones.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CaptureOptions {
    /// The folder of the photos, relative to the data set, such as `images_4`.
    pub images: Option<PathBuf>,
    /// The folder of the COLMAP model, relative to the data set, such as `sparse/1`.
    pub model: Option<PathBuf>,
    /// The folder of the masks, relative to the data set.
    pub masks: Option<PathBuf>,
    /// The folder of the photos as the camera wrote them, for position and time where the photos of
    /// the data set have lost them; absolute, or relative to the current folder.
    pub originals: Option<PathBuf>,
}

/// Photographs of a place, with their cameras and the points that both were found with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capture {
    /// The folder that was read, for messages.
    pub source: PathBuf,
    /// The folder that the photos lie in.
    pub images: PathBuf,
    /// `[V]`, sorted by name.
    pub views: Vec<CaptureView>,
    /// The points of the reconstruction; may be empty.
    pub points: SparsePoints,
    /// `[V]`: which points each photo shows and where; empty lists where that is not known.
    pub observations: Vec<Vec<Observation>>,
    /// The point of the world that is zero here, scene units: cameras and points are relative to
    /// it. Zero unless they are far from it; see [`wm_scene::origin`].
    pub origin: DVec3,
    /// Lines on what the reader guessed, ignored or passed over.
    pub remarks: Vec<Remark>,
}

/// A photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureView {
    /// Name: the path in the folder of the photos, with `/` between its parts.
    pub name: String,
    /// The camera as it took the photo: the size of the photo that the model was made from, pose,
    /// and what a pinhole of these intrinsics would show before the lens bends it.
    pub camera: Camera,
    /// The distortion of its lens.
    pub distortion: Distortion,
    /// Views of equal number share intrinsics.
    pub camera_id: u32,
    /// The path of the photo below [`Capture::images`]; see [`Capture::photo`].
    pub file: PathBuf,
    /// The path of the mask of the photo, black where nothing is learnt, if it has one.
    pub mask: Option<PathBuf>,
    /// The path of the photo as the camera wrote it, if that is kept besides.
    pub original: Option<PathBuf>,
}

/// A point in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Index into [`SparsePoints`].
    pub point: u32,
    /// Position in the photo, px of [`CaptureView::camera`], distortion included.
    pub xy: [f32; 2],
}

impl CaptureView {
    /// A view of a photo, by its path in the folder of the photos; `/` divides the name, whatever
    /// divides the path.
    #[must_use]
    pub fn new(file: &str, camera: Camera, distortion: Distortion, camera_id: u32) -> Self {
        let (name, file) = (file.replace('\\', "/"), file.into());
        Self { name, camera, distortion, camera_id, file, mask: None, original: None }
    }

    /// A view whose camera is not known before its photo is found.
    fn without_camera(file: &str) -> Self {
        Self::new(file, Camera::posed((1, 1), 50.0, DVec3::ZERO, DMat3::IDENTITY), Distortion::None, 1)
    }

    /// The pinhole camera of the photo without its distortion; see [`Distortion::undistorted`].
    #[must_use]
    pub fn undistorted(&self) -> Option<Camera> {
        self.distortion.undistorted(&self.camera)
    }

    /// Picture point (px) of a world point in the photo as it is, distortion included; `None`
    /// behind the camera.
    #[must_use]
    pub fn project(&self, point: DVec3) -> Option<(f64, f64)> {
        let camera = &self.camera;
        let p = camera.viewmat.transform_point3(point);
        (p.z > 1e-9).then(|| {
            let (x, y) = self.distortion.distort(p.x / p.z, p.y / p.z);
            (camera.fx * x + camera.cx, camera.fy * y + camera.cy)
        })
    }
}

impl Capture {
    /// The path of a view's photo; `None` if there is no such file.
    #[must_use]
    pub fn photo(&self, view: usize) -> Option<PathBuf> {
        places::photo(&self.images, &self.views[view])
    }

    /// Checks that a reconstruction can be made of it: three photos and a point.
    ///
    /// # Errors
    /// [`FormatError`] says which it lacks.
    pub fn check_trainable(&self) -> Result<(), FormatError> {
        let fault = |what: String| Err(FormatError::value(&self.source, what));
        match self.views.len() {
            count @ 0..=2 => fault(format!(
                "{count} of the photos {} registered, at least 3 are needed; take more, with overlap, and \
                 reconstruct again",
                if count == 1 { "is" } else { "are" }
            )),
            _ if self.points.is_empty() => fault(
                "the model has no points to start from; reconstruct again, or give a capture with points3D"
                    .into(),
            ),
            _ => Ok(()),
        }
    }

    /// For each view the views that share the most points with it, most first, at most `most`.
    ///
    /// Built on [`Self::observations`]: none where they are not known.
    #[must_use]
    pub fn neighbours(&self, view: usize, most: usize) -> Vec<(usize, u32)> {
        let mut is_seen = vec![false; self.points.len()];
        for seen in &self.observations[view] {
            is_seen[seen.point as usize] = true;
        }
        let shared = |other: &Vec<Observation>| {
            other.iter().filter(|seen| is_seen[seen.point as usize]).count() as u32
        };
        let mut counts: Vec<(usize, u32)> = self
            .observations
            .iter()
            .enumerate()
            .filter(|(index, _)| *index != view)
            .map(|(index, other)| (index, shared(other)))
            .filter(|(_, count)| *count > 0)
            .collect();
        counts.sort_by_key(|(index, count)| (std::cmp::Reverse(*count), *index));
        counts.truncate(most);
        counts
    }

    /// Makes cameras and points relative to another origin, zero for that of the world.
    pub fn set_origin(&mut self, origin: DVec3) {
        let by = origin - self.origin;
        if by == DVec3::ZERO {
            return;
        }
        self.origin = origin;
        for view in &mut self.views {
            view.camera = view.camera.moved(-by);
        }
        for position in &mut self.points.positions {
            *position = (DVec3::from_array(*position) - by).to_array();
        }
    }

    /// Chooses an origin if the place is far from zero.
    fn choose_origin(&mut self) {
        let points = self.points.positions.iter().map(|position| DVec3::from_array(*position));
        let mut positions: Vec<DVec3> = points.collect();
        if positions.is_empty() {
            positions = self.views.iter().map(|view| view.camera.center()).collect();
        }
        let Some(origin) = origin::choose(&positions, 0.0) else { return };
        self.set_origin(origin);
        let origin = origin::text_of(origin);
        self.remarks.push(Remark::note(
            "far-origin",
            format!("the coordinates are far from zero: they are kept relative to the origin {origin}"),
        ));
    }

    fn sort(&mut self) {
        let mut order: Vec<usize> = (0..self.views.len()).collect();
        order.sort_by(|a, b| self.views[*a].name.cmp(&self.views[*b].name));
        self.views = order.iter().map(|index| self.views[*index].clone()).collect();
        self.observations =
            order.iter().map(|index| std::mem::take(&mut self.observations[*index])).collect();
    }
}

/// The folder of a data set, also where one of its files was given.
#[must_use]
pub fn folder_of(dataset: &Path) -> &Path {
    if dataset.is_file() { dataset.parent().unwrap_or(Path::new("")) } else { dataset }
}

/// Reads a capture: the folder of a data set, of its model, or a `transforms.json`.
///
/// # Errors
/// [`FormatError`] if it is missing, of no known format, or broken.
pub fn read(dataset: &Path, options: &CaptureOptions) -> Result<Capture, FormatError> {
    read_as(dataset, options, ReadScope::Everything)
}

/// Reads only the cameras of a capture, sorted by name, as photos without distortion have them, in
/// world coordinates: [`wm_scene::Scene::set_world_views`] takes them.
///
/// # Errors
/// [`FormatError`] as for [`read`], and if the distortion of a camera cannot be undone.
pub fn read_views(dataset: &Path) -> Result<Vec<SceneView>, FormatError> {
    let capture = read_as(dataset, &CaptureOptions::default(), ReadScope::Views)?;
    let ideal = capture.views.into_iter().map(|view| match view.undistorted() {
        Some(camera) => Ok(SceneView { name: view.name, camera }),
        None => Err(FormatError::value(dataset, folds(&view.name))),
    });
    ideal.collect()
}

/// The problem of a lens whose distortion folds over within the photo.
pub(crate) fn folds(name: &str) -> String {
    format!(
        "the distortion of the camera of {name:?} folds over within the photo; reconstruct the capture again with \
         another camera model"
    )
}

/// The main file of a data set and the folder that the other files are relative to: the first of
/// `names` that is in the folder `dataset`, or `dataset` itself if it is a file that `is_main`
/// holds for. `None` if there is none.
fn find_main(dataset: &Path, names: &[&str], is_main: impl Fn(&Path) -> bool) -> Option<(PathBuf, PathBuf)> {
    if dataset.is_dir() {
        let file = names.iter().map(|name| dataset.join(name)).find(|file| file.is_file())?;
        return Some((file, dataset.to_path_buf()));
    }
    let parent = dataset.parent().unwrap_or(Path::new(""));
    is_main(dataset).then(|| (dataset.to_path_buf(), parent.to_path_buf()))
}

/// The advice for a file of JSON that cannot be read.
const JSON_ADVICE: &str = "correct the file or export it again";

fn read_as(dataset: &Path, options: &CaptureOptions, scope: ReadScope) -> Result<Capture, FormatError> {
    fs::metadata(dataset).map_err(|e| FormatError::reading(dataset, e))?;
    if let Some(originals) = &options.originals {
        fs::read_dir(originals).map_err(|e| FormatError::reading(originals, e))?;
    }
    for reader in READERS {
        if let Some(mut capture) = reader(dataset, options, scope)? {
            capture.source = dataset.into();
            capture.observations.resize(capture.views.len(), Vec::new());
            capture.sort();
            checks::clean(&mut capture)?;
            // Views are wanted as they are, to be put into scenes that have origins of their own.
            if scope == ReadScope::Everything {
                capture.choose_origin();
            }
            return Ok(capture);
        }
    }
    Err(foreign::refusal(dataset))
}
