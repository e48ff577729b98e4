//! The photos of a data set: those that teach and those that are held out.

use super::PhotoArgs;
use super::folder::RunFolder;
use crate::dataset::HeldOut;
use crate::interrupt;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};
use wm_scene::capture::{self, Capture, CaptureOptions};
use wm_scene::{Camera, FormatError, Problem, SceneView};
use wm_train::colmap::{self, ColmapOptions};
use wm_train::photos::{Check, Photos};

/// A data set that is open.
pub struct Data {
    /// Cameras and points.
    pub capture: Capture,
    /// The photos.
    pub photos: Photos,
    /// Places in `photos` of those that teach.
    pub teaching: Vec<usize>,
    /// Places in `photos` of those that are held out.
    pub held_out: Vec<usize>,
}

impl Data {
    /// Opens it, with COLMAP's help if there are only photos. Warns on the error stream.
    pub fn open(dataset: &Path, args: &PhotoArgs, folder: &RunFolder) -> Result<Self> {
        let capture = match args.set.capture(dataset) {
            Ok(capture) => capture,
            Err(FormatError { problem: Problem::NoCapture, .. }) => {
                if let Some(model) = &args.set.model {
                    bail!("{}: there is no model that COLMAP wrote", dataset.join(model).display());
                }
                capture::read(&register(dataset, folder)?, &CaptureOptions::default())?
            }
            Err(error) => return Err(error.into()),
        };
        if capture.views.len() < 3 {
            capture.check_trainable()?;
        }
        // What is damaged should be told now and not after hours.
        let photos = args.set.photos(dataset, &capture, Check::PixelsThatFit)?;
        let held = HeldOut { every: args.eval_every, from: args.eval_from };
        let (held_out, teaching) = held.split(&photos);
        if teaching.len() < 3 {
            bail!(
                "{}: {} of {} photos are left to learn from, at least 3 are needed; take more photos, or hold out fewer",
                dataset.display(),
                teaching.len(),
                capture.views.len()
            );
        }
        if capture.points.is_empty() {
            eprintln!(
                "warning: {}: the model has no points; splats begin anywhere in view, which takes longer and gives less",
                dataset.display()
            );
        }
        Ok(Self { capture, photos, teaching, held_out })
    }

    /// The cameras of the photos that teach, in their order.
    pub fn cameras(&self) -> Vec<Camera> {
        self.teaching.iter().map(|place| self.photos.camera(*place, 0)).collect()
    }

    /// Pixels of the photos that teach.
    pub fn pixels(&self) -> u64 {
        self.cameras().iter().map(|camera| u64::from(camera.width) * u64::from(camera.height)).sum()
    }

    /// Every photo's camera with its name.
    pub fn views(&self) -> Vec<SceneView> {
        let view =
            |place| SceneView { name: self.name(place).to_owned(), camera: self.photos.camera(place, 0) };
        (0..self.photos.len()).map(view).collect()
    }

    /// The name of a photo.
    pub fn name(&self, place: usize) -> &str {
        &self.capture.views[self.photos.view(place)].name
    }
}

/// Finds the cameras of plain photos; gives the data set that then is.
fn register(dataset: &Path, folder: &RunFolder) -> Result<PathBuf> {
    let mut last = None;
    let run = folder.path().join("colmap");
    let done = colmap::reconstruct(
        dataset,
        &run,
        &ColmapOptions::default(),
        &mut |progress| {
            if last != Some(progress.step) {
                last = Some(progress.step);
                eprintln!("colmap: {}", progress.step.name());
            }
        },
        &interrupt::asked,
    )?;
    eprintln!("colmap: the cameras of {} of {} photos were found", done.registered, done.photos);
    Ok(done.dataset)
}
