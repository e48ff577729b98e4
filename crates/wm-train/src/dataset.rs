//! A data set: a capture, its photos, and the choice of those that are used.

use crate::photos::{BadPhotos, Check, PhotoErrors, PhotoOptions, PhotoSize, Photos};
use glam::DVec3;
use std::path::{Path, PathBuf};
use thiserror::Error;
use wm_base::FormatError;
use wm_capture::gps::{self, GpsFit};
use wm_capture::up::{CaptureUp, UpEvidence};
use wm_capture::{self as capture, Capture, CaptureOptions, CaptureSite};
use wm_scene::Camera;

/// Options for opening a data set: the places of its parts, and how its photos are read.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetReadOptions {
    /// Folder of the photos in the data set; `None` looks in the usual places.
    pub images: Option<PathBuf>,
    /// Folder of masks in the data set; `None` takes `masks` if it exists.
    pub masks: Option<PathBuf>,
    /// Folder of the COLMAP model in the data set; `None` looks in the usual places.
    pub model: Option<PathBuf>,
    /// Folder of the photos as the camera wrote them, whose position and time are read where the
    /// data set's have lost them.
    pub originals: Option<PathBuf>,
    /// The size at which photos are used.
    pub size: PhotoSize,
    /// The treatment of photos that cannot be used.
    pub bad: BadPhotos,
    /// Memory for decoded photos, bytes.
    pub cache_bytes: usize,
}

impl Default for DatasetReadOptions {
    fn default() -> Self {
        Self {
            images: None,
            masks: None,
            model: None,
            originals: None,
            size: PhotoSize::Longest(1600),
            bad: BadPhotos::Refuse,
            cache_bytes: 512 << 20,
        }
    }
}

/// A reason why the photos of a data set cannot be opened.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// The capture has no photos.
    #[error("{}: there are no photos in it; choose another data set", .0.display())]
    NoPhotos(PathBuf),
    /// Photos are missing or damaged.
    #[error(transparent)]
    Photos(#[from] PhotoErrors),
}

impl DatasetReadOptions {
    /// Reads the cameras and points of the data set in a folder.
    ///
    /// # Errors
    /// The errors of [`capture::read`].
    pub fn capture(&self, dataset: &Path) -> Result<Capture, FormatError> {
        let Self { images, masks, model, originals, .. } = self.clone();
        capture::read(dataset, &CaptureOptions { images, model, masks, originals })
    }

    /// Opens the photos of `capture`; [`Photos::skipped`] lists those that were left out.
    ///
    /// # Errors
    /// [`DatasetError`] if there are no photos, or one is damaged and [`Self::bad`] refuses it.
    pub fn photos(&self, dataset: &Path, capture: &Capture, check: Check) -> Result<Photos, DatasetError> {
        if capture.views.is_empty() {
            return Err(DatasetError::NoPhotos(dataset.to_owned()));
        }
        let options = PhotoOptions {
            size: self.size,
            cache_bytes: self.cache_bytes,
            bad: self.bad,
            check,
            ..PhotoOptions::default()
        };
        Ok(Photos::open(capture, &options)?)
    }
}

/// The choice of photos that are held out: every N-th one, in the order of names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeldOut {
    /// One of so many photos is held out; 0 holds out none.
    pub every: u32,
    /// The first photo that is held out, from 0.
    pub from: u32,
}

impl HeldOut {
    /// Returns the indices in `photos` of those that are held out, and of the others. They are
    /// counted by their indices in the capture, so that leaving out a damaged photo does not change
    /// the choice.
    #[must_use]
    pub fn split(self, photos: &Photos) -> (Vec<usize>, Vec<usize>) {
        let is_held = |place: &usize| {
            let view = photos.view(*place) as u32;
            self.every > 0 && view % self.every == self.from % self.every
        };
        (0..photos.len()).partition(is_held)
    }
}

/// An open data set and the photos of it that are used.
pub struct Dataset {
    /// Cameras and points.
    pub capture: Capture,
    /// The photos.
    pub photos: Photos,
    /// Indices in `photos` of those that are used.
    pub places: Vec<usize>,
}

/// Finds up from the positions of photos and the poses of cameras, and how the positions fit.
/// `given` is up if it is known already.
#[must_use]
pub fn orientation(
    capture: &Capture,
    photos: &Photos,
    given: Option<DVec3>,
) -> (Option<CaptureUp>, Option<GpsFit>) {
    let cameras: Vec<Camera> = capture.views.iter().map(|view| view.camera).collect();
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let gps = gps::fit(&centers, &photos.gps);
    let up = match given {
        Some(up) => Some(CaptureUp { up: up.normalize(), error: 0.0, evidence: UpEvidence::Given }),
        None => CaptureUp::of(&cameras, gps.as_ref()),
    };
    (up, gps)
}

/// North, place and time of the capture, as the EXIF of its photos states them. `up` is its
/// direction against gravity, world axes.
#[must_use]
pub fn site(capture: &Capture, photos: &Photos, up: DVec3) -> CaptureSite {
    let centers: Vec<DVec3> = capture.views.iter().map(|view| view.camera.center()).collect();
    CaptureSite::of(&centers, &photos.gps, &photos.taken, up)
}

/// Names of the photos whose stated place is far from where the others put their cameras, or is no
/// place on Earth; [`orientation`] leaves them out.
pub(crate) fn misplaced(capture: &Capture, photos: &Photos) -> Vec<String> {
    let centers: Vec<DVec3> = capture.views.iter().map(|view| view.camera.center()).collect();
    let (_, outliers) = gps::fit_with_outliers(&centers, &photos.gps);
    outliers.into_iter().map(|view| capture.views[view].file.display().to_string()).collect()
}

impl Dataset {
    /// Returns the name of the photo with index `place` in [`Self::photos`].
    ///
    /// # Panics
    /// If there is no such photo.
    #[must_use]
    pub fn name(&self, place: usize) -> &str {
        &self.capture.views[self.photos.view(place)].name
    }
}
