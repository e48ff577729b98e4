//! Opens the priors of a session, or estimates them from the photos.

use super::data::TrainData;
use super::error::SessionError;
use super::folder::RunFolder;
use super::observer::{Preparation, TrainNotice, TrainObserver, TrainWarning};
use super::options::{PriorSource, SessionOptions};
use crate::brightness::PhotoGains;
use crate::photos::{BadPhotos, Photo};
use crate::priors::stereo::{self, StereoOptions};
use crate::priors::{self, FOLDER, Prior, Priors};
use std::path::Path;
use std::sync::Arc;
use wm_capture::folder_of;
use wm_scene::Camera;

/// Approximate largest number of photos whose priors are used for the first splats.
const MAX_PRIOR_PHOTOS: usize = 200;

/// The largest number of photos whose priors are estimated unasked: two minutes on two cores.
const MAX_AUTO_PHOTOS: usize = 300;

/// Opens or estimates the priors; `None` if the training is to have none.
pub(super) fn open(
    dataset: &Path,
    options: &SessionOptions,
    data: &TrainData,
    folder: &RunFolder,
    observer: &mut dyn TrainObserver,
) -> Result<Option<Priors>, SessionError> {
    let made = folder.path().join(FOLDER);
    match &options.priors {
        PriorSource::None => return Ok(None),
        PriorSource::Photos => {}
        PriorSource::Folder(path) => {
            let priors = Priors::open(path)?.ok_or_else(|| SessionError::NoPriors(path.clone()))?;
            check(&priors, data, observer)?;
            return Ok(Some(priors));
        }
        PriorSource::Auto => {
            if let Some(priors) = Priors::open(&folder_of(dataset).join(FOLDER))? {
                check(&priors, data, observer)?;
                return Ok(Some(priors));
            }
        }
    }
    // A training that is resumed keeps its priors.
    if folder.resumes()
        && let Some(priors) = Priors::open(&made)?
    {
        return Ok(Some(priors));
    }
    let mut places = data.set.places.clone();
    if places.len() > MAX_AUTO_PHOTOS && options.priors == PriorSource::Auto {
        observer.on_warning(&TrainWarning::ManyPhotos { photos: places.len(), most: MAX_AUTO_PHOTOS });
        return Ok(None);
    }
    let photos = &data.set.photos;
    if options.dataset.bad == BadPhotos::Skip {
        // The training names them when it meets them. Stereo takes them from the cache in this
        // size.
        let level = stereo::level(photos, &places, &StereoOptions::default());
        places.retain(|place| photos.get(*place, level).is_ok());
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.cpu.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| SessionError::Threads(error.to_string()))?;
    let total = 2 * places.len();
    let index = priors::photos::write_folder(
        &data.set.capture,
        photos,
        &places,
        data.up.as_ref(),
        &pool,
        &made,
        &mut |done| {
            observer.on_preparation(&Preparation::Priors { done, total });
            observer.proceed()
        },
    )?;
    let Some(index) = index else { return Err(SessionError::StoppedEarly) };
    observer.on_notice(&TrainNotice::PriorsMade(index.summary()));
    Ok(Priors::open(&made)?)
}

/// Refuses priors that are not of these photos.
fn check(priors: &Priors, data: &TrainData, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
    let mut found = 0;
    let places = &data.set.places;
    for place in places {
        found += usize::from(priors.index().photos.contains_key(data.set.name(*place)));
        priors.get(data.set.name(*place), &data.set.photos.camera(*place, 0))?;
    }
    let folder = priors.folder.clone();
    if found == 0 {
        return Err(SessionError::OtherPriors(folder));
    }
    if found < places.len() {
        observer.on_notice(&TrainNotice::PriorsIncomplete { folder, found, photos: places.len() });
    }
    Ok(())
}

/// A photo's camera and prior, and the photo in about the size of the prior: its pixels are means
/// of the photo's.
pub(super) struct PriorView {
    pub(super) camera: Camera,
    pub(super) prior: Arc<Prior>,
    pub(super) photo: Arc<Photo>,
    /// The gain in red, green and blue relative to the scene, display-referred.
    pub(super) gain: [f32; 3],
}

/// Returns the photos that have priors; an even choice of them if there are very many.
pub(super) fn prior_views(
    data: &TrainData,
    priors: &Priors,
    gains: Option<&PhotoGains>,
) -> Result<Vec<PriorView>, SessionError> {
    let mut views = Vec::new();
    let places = &data.set.places;
    for (index, place) in places.iter().enumerate().step_by(places.len().div_ceil(MAX_PRIOR_PHOTOS)) {
        let camera = data.set.photos.camera(*place, 0);
        let Some(prior) = priors.get(data.set.name(*place), &camera)? else { continue };
        let level = (0..6).take_while(|level| camera.width >> level >= prior.width).last().unwrap_or(0);
        let gain = gains.map_or([1.0; 3], |gains| gains.gains[index]);
        views.push(PriorView { camera, prior, photo: data.set.photos.get(*place, level)?, gain });
    }
    Ok(views)
}
