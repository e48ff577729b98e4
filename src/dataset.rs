//! A data set as commands open it: which of its photos, how large, and which are held out.

use anyhow::{Result, bail};
use clap::Args;
use std::path::{Path, PathBuf};
use wm_scene::capture::{self, Capture, CaptureOptions};
use wm_train::photos::{BadPhotos, Check, PhotoOptions, PhotoSize, Photos};

/// Where the photos are, and how large they are used.
#[derive(Args, Clone, Debug)]
pub struct DatasetArgs {
    /// Folder of the photos in the data set, such as images_4 [default: images, or another usual name]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    pub images: Option<PathBuf>,
    /// Folder of masks in the data set: what is black counts nowhere [default: masks, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    pub masks: Option<PathBuf>,
    /// Folder of the COLMAP model in the data set [default: sparse/0, or another usual place]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    pub model: Option<PathBuf>,
    /// Longest side that photos are used with, px; equal numbers and priors take equal sizes
    #[arg(long, value_name = "PX", default_value_t = 1600, value_parser = clap::value_parser!(u32).range(16..=32768), help_heading = "Photos")]
    pub longest: u32,
    /// Leave out photos that are missing or damaged, and go on
    #[arg(long, help_heading = "Photos")]
    pub skip_bad: bool,
    /// Memory for decoded photos, MiB
    #[arg(long, value_name = "MIB", default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..), help_heading = "Photos")]
    pub cache: u32,
}

impl DatasetArgs {
    /// Reads cameras and points.
    ///
    /// # Errors
    /// As [`capture::read`].
    pub fn capture(&self, dataset: &Path) -> Result<Capture, wm_scene::FormatError> {
        let options = CaptureOptions {
            images: self.images.clone(),
            model: self.model.clone(),
            masks: self.masks.clone(),
        };
        capture::read(dataset, &options)
    }

    /// Opens the photos. Warns on the error stream of those that are left out.
    ///
    /// # Errors
    /// There are none, or one is damaged and none may be.
    pub fn photos(&self, dataset: &Path, capture: &Capture, check: Check) -> Result<Photos> {
        if capture.views.is_empty() {
            bail!("{}: there are no photos in it; choose another data set", dataset.display());
        }
        let options = PhotoOptions {
            size: PhotoSize::Longest(self.longest),
            cache_bytes: (self.cache as usize) << 20,
            bad: if self.skip_bad { BadPhotos::Skip } else { BadPhotos::Refuse },
            check,
            ..PhotoOptions::default()
        };
        let photos = Photos::open(capture, &options)?;
        for skipped in photos.skipped() {
            eprintln!("warning: {skipped}; it is left out");
        }
        Ok(photos)
    }
}

/// Every how many photos one is held out.
#[derive(Clone, Copy, Debug)]
pub struct HeldOut {
    /// Every N-th; 0 holds out none.
    pub every: u32,
    /// From which, from 0.
    pub from: u32,
}

impl HeldOut {
    /// Places in `photos` of those that are held out, and of the others. They are counted by their places in the capture,
    /// so that a photo that is left out makes no other one held out.
    #[must_use]
    pub fn split(self, photos: &Photos) -> (Vec<usize>, Vec<usize>) {
        let is_held = |place: &usize| {
            let view = photos.view(*place) as u32;
            self.every > 0 && view % self.every == self.from % self.every
        };
        (0..photos.len()).partition(is_held)
    }
}

/// Photos of an open data set that are looked at, one after another.
pub struct Dataset {
    /// Cameras and points.
    pub capture: Capture,
    /// The photos.
    pub photos: Photos,
    /// Places in `photos` of those that are looked at.
    pub places: Vec<usize>,
}

impl Dataset {
    /// The name of a photo.
    #[must_use]
    pub fn name(&self, place: usize) -> &str {
        &self.capture.views[self.photos.view(place)].name
    }
}
