//! A whole data set whose parts are trained separately: computes what the trainings share before
//! them, and finishes the scene after them.

use super::data::{TrainData, confirmed_pixels};
use super::error::SessionError;
use super::folder::Resume;
use super::folder::RunFolder;
use super::observer::TrainObserver;
use super::options::{PriorSource, SessionOptions};
use super::part::capture_of;
use super::{priors, scene};
use crate::brightness::PhotoGains;
use crate::config::{HazeMode, TrainConfig};
use crate::haze::PhotoHaze;
use crate::priors::points::seen_points;
use crate::priors::{FOLDER, Priors};
use std::collections::HashSet;
use std::path::Path;
use wm_scene::{Camera, Scene, Splats};

/// A data set that is open, and its priors.
pub(crate) struct WholeSession {
    options: SessionOptions,
    pub(crate) data: TrainData,
    pub(crate) priors: Option<Priors>,
}

impl WholeSession {
    /// Opens a data set with its photos and priors; what is made for it lies in the run folder, and
    /// is taken from there if it is there already.
    pub(crate) fn open(
        dataset: &Path,
        options: &SessionOptions,
        run_folder: &Path,
        observer: &mut dyn TrainObserver,
    ) -> Result<Self, SessionError> {
        let mut options = options.clone();
        let mut folder = RunFolder::open(Some(run_folder), Resume::Overwrite)?;
        folder.make()?;
        let data = TrainData::open(dataset, &options, &folder, observer)?;
        data.write_poor(&folder)?;
        let made = run_folder.join(FOLDER);
        let is_given = matches!(options.priors, PriorSource::Folder(_) | PriorSource::None);
        if !is_given && Priors::open(&made)?.is_some() {
            options.priors = PriorSource::Folder(made);
        }
        let priors = priors::open(dataset, &options, &data, &folder, observer)?;
        Ok(Self { options, data, priors })
    }

    /// Returns the points that each of the photos shows, as indices into the capture's.
    pub(crate) fn seen_points(&self, places: &[usize]) -> Vec<Vec<u32>> {
        seen_points(&self.data.set.capture, &self.data.set.photos, places)
    }

    /// Returns the haze of the training photos, and their gains.
    pub(crate) fn haze(
        &self,
        mode: HazeMode,
        observer: &mut dyn TrainObserver,
    ) -> Result<Option<(PhotoHaze, PhotoGains)>, SessionError> {
        scene::haze(mode, &self.data, self.priors.as_ref(), &self.options, observer)
    }

    /// Returns the splats of the sky.
    pub(crate) fn sky(
        &self,
        config: &TrainConfig,
        haze: Option<&(PhotoHaze, PhotoGains)>,
    ) -> Result<Splats, SessionError> {
        let gains = self.data.first_exposures(config.exposure, haze.map(|(_, gains)| gains));
        scene::sky(config, &self.data, self.priors.as_ref(), haze.map(|(haze, _)| haze), gains)
    }

    /// Returns the scene of the splats that trainings of the parts made, as [`scene::finish`] does.
    pub(crate) fn finish(
        &self,
        splats: Splats,
        config: &TrainConfig,
        haze: Option<&PhotoHaze>,
        observer: &mut dyn TrainObserver,
    ) -> Result<Scene, SessionError> {
        scene::finish(splats, config, &self.data, &self.options, self.priors.as_ref(), haze, observer)
    }
}

/// Returns the number of pixels of the photos `places` that confirm what two others of them show.
pub(crate) fn confirmed_of(whole: &WholeSession, places: &[usize]) -> u64 {
    let names: HashSet<&str> = places.iter().map(|place| whole.data.set.name(*place)).collect();
    let part = capture_of(&whole.data.set.capture, |name| names.contains(name), |_| true);
    let cameras: Vec<Camera> = places.iter().map(|place| whole.data.set.photos.camera(*place, 0)).collect();
    confirmed_pixels(&part.points, &cameras)
}
