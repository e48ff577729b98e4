//! Opens the data set of a session, with COLMAP's help if there are only photos, and with ffmpeg's
//! if there is only a video.

use super::error::SessionError;
use super::folder::{COLMAP, FRAMES, RunFolder};
use super::observer::{Preparation, TrainNotice, TrainObserver, TrainWarning};
use super::options::SessionOptions;
use crate::brightness::{PhotoGains, photo_gains};
use crate::checkpoint::TrainedPhoto;
use crate::colmap::{self, ColmapOptions, Matching};
use crate::config::ExposureMode;
use crate::dataset::{Dataset, DatasetReadOptions, misplaced, orientation};
use crate::movers::{MoverMask, sheet};
use crate::overlap::{confirmed_share, overlap};
use crate::photos::{Check, Photo};
use crate::poor_photos::{self, PhotoDefect, PoorPhotoMode, poor_photos};
use crate::video;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use wm_base::files::write_atomically;
use wm_base::{FormatError, Problem};
use wm_capture::gps::GpsFit;
use wm_capture::{Capture, CaptureUp};
use wm_scene::SparsePoints;
use wm_scene::{Camera, SceneView, Severity};

/// The picture of the poor photos in the run folder.
const POOR_PHOTOS_FILE: &str = "poor-photos.png";

/// A data set that is open, and which photos it trains on.
pub(crate) struct TrainData {
    /// The training photos.
    pub(crate) set: Dataset,
    /// Indices in the photos of those that are held out.
    pub(crate) held_out: Vec<usize>,
    /// Up, and how well it is known; `None` if nothing tells it.
    pub(crate) up: Option<CaptureUp>,
    /// The fit of the positions of the photos.
    pub(crate) gps: Option<GpsFit>,
    /// True if other trainings learn other parts of the data set.
    is_part: bool,
    /// Poor photos that were left out, with their defects.
    poor: Vec<(usize, PhotoDefect)>,
    gains: OnceLock<Option<PhotoGains>>,
    held_out_gains: OnceLock<Vec<[f32; 3]>>,
}

impl TrainData {
    /// Opens the data set.
    pub(crate) fn open(
        dataset: &Path,
        options: &SessionOptions,
        folder: &RunFolder,
        observer: &mut dyn TrainObserver,
    ) -> Result<Self, SessionError> {
        let (wanted, part) = (&options.dataset, options.part.as_deref());
        let mut capture = open_capture(dataset, wanted, folder, observer)?;
        for remark in &capture.remarks {
            match remark.severity {
                Severity::Note => observer.on_notice(&TrainNotice::Capture(remark.clone())),
                Severity::Doubt => observer.on_warning(&TrainWarning::Capture(remark.clone())),
            }
        }
        if let Some(part) = part {
            capture = part.capture(&capture)?;
        }
        if capture.views.len() < 3 {
            capture.check_trainable()?;
        }
        // Damaged photos should be found now and not after hours.
        let photos = wanted.photos(dataset, &capture, Check::PixelsThatFit)?;
        for skipped in photos.skipped() {
            observer.on_warning(&TrainWarning::LeftOut(skipped.clone()));
        }
        let (held_out, mut places) = match part {
            Some(part) => part.split(&capture, &photos),
            None => options.held_out.split(&photos),
        };
        if places.len() < 3 {
            return Err(SessionError::TooFewPhotos {
                dataset: dataset.to_owned(),
                left: places.len(),
                photos: capture.views.len(),
            });
        }
        if capture.points.is_empty() {
            observer.on_warning(&TrainWarning::NoPoints(dataset.to_owned()));
        }
        let misplaced = misplaced(&capture, &photos);
        if !misplaced.is_empty() && part.is_none() {
            observer.on_warning(&TrainWarning::Misplaced(misplaced));
        }
        let mut poor = match options.poor_photos {
            PoorPhotoMode::Auto => poor_photos(&capture, &photos, &places),
            PoorPhotoMode::Keep => Vec::new(),
        };
        if !poor.is_empty() {
            let most = (poor_photos::MAX_LEFT_OUT_SHARE * places.len() as f64) as usize;
            let are_left_out = poor.len() <= most && places.len() - poor.len() >= 3;
            let name = |place: usize| capture.views[photos.view(place)].name.clone();
            let found = poor.iter().map(|(place, defect)| (name(*place), *defect)).collect();
            observer.on_warning(&TrainWarning::PoorPhotos { found, are_left_out });
            if !are_left_out {
                poor.clear();
            }
            places.retain(|place| poor.iter().all(|(poor, _)| poor != place));
        }
        let (up, gps) = orientation(&capture, &photos, options.facts.up);
        let set = Dataset { capture, photos, places };
        let names = || set.places.iter().map(|place| set.name(*place));
        let gains = part.map_or_else(OnceLock::new, |part| {
            OnceLock::from(part.gains.as_ref().map(|gains| gains.of(names())))
        });
        Ok(Self {
            set,
            is_part: part.is_some(),
            held_out,
            up,
            gps,
            poor,
            gains,
            held_out_gains: OnceLock::new(),
        })
    }

    /// Returns the cameras of the training photos, in their order.
    pub(crate) fn cameras(&self) -> Vec<Camera> {
        self.set.places.iter().map(|place| self.set.photos.camera(*place, 0)).collect()
    }

    /// Returns the number of pixels of the training photos that confirm what two others show.
    pub(crate) fn confirmed_pixels(&self) -> u64 {
        confirmed_pixels(&self.set.capture.points, &self.cameras())
    }

    /// Returns the brightness of the training photos beside each other; `None` if they share too
    /// few points.
    pub(crate) fn gains(&self) -> Option<&PhotoGains> {
        let Dataset { capture, photos, places } = &self.set;
        self.gains.get_or_init(|| photo_gains(capture, photos, places)).as_ref()
    }

    /// Returns the gains that the photos' own exposures begin with; `None` where all photos begin
    /// with the same. `in_haze` are the gains of photos in haze, which changes brightness with
    /// distance.
    pub(crate) fn first_exposures<'a>(
        &'a self,
        mode: ExposureMode,
        in_haze: Option<&'a PhotoGains>,
    ) -> Option<&'a PhotoGains> {
        match mode {
            ExposureMode::Auto => in_haze.or_else(|| self.gains()).filter(|gains| gains.differ()),
            // A training keeps the mean of its exposures, and the parts must agree on how bright
            // the scene is.
            ExposureMode::Photo if self.is_part => in_haze.or_else(|| self.gains()),
            ExposureMode::Photo | ExposureMode::Shared => None,
        }
    }

    /// Returns by what each held-out photo is brighter in red, green and blue than the training
    /// photos are in the mean, by the points that they share; 1 where these are too few.
    pub(crate) fn held_out_gains(&self) -> &[[f32; 3]] {
        let Dataset { capture, photos, places } = &self.set;
        self.held_out_gains.get_or_init(|| {
            let all = [&places[..], &self.held_out].concat();
            let Some(found) = photo_gains(capture, photos, &all) else {
                return vec![[1.0; 3]; self.held_out.len()];
            };
            let (taught, held_out) = found.gains.split_at(places.len());
            let mean =
                [0, 1, 2].map(|c| taught.iter().map(|gain| gain[c]).sum::<f32>() / taught.len() as f32);
            held_out.iter().map(|gain| [0, 1, 2].map(|c| gain[c] / mean[c])).collect()
        })
    }

    /// Draws the poor photos that were left out into the run folder, if there are any.
    pub(crate) fn write_poor(&self, folder: &RunFolder) -> Result<(), SessionError> {
        let photos: Vec<Arc<Photo>> = self
            .poor
            .iter()
            .take(sheet::MAX_PHOTOS)
            .filter_map(|(place, _)| self.set.photos.get(*place, 0).ok())
            .collect();
        if photos.is_empty() {
            return Ok(());
        }
        let whole = MoverMask::default();
        let drawn: Vec<(&Photo, &MoverMask)> = photos.iter().map(|photo| (&**photo, &whole)).collect();
        write_atomically(&folder.path().join(POOR_PHOTOS_FILE), |out| Ok(sheet::write(&drawn, out)?))?;
        Ok(())
    }

    /// Returns every photo's camera with its name.
    pub(crate) fn views(&self) -> Vec<SceneView> {
        let photos = &self.set.photos;
        let view =
            |place| SceneView { name: self.set.name(place).to_owned(), camera: photos.camera(place, 0) };
        (0..photos.len()).map(view).collect()
    }

    /// Returns what a checkpoint says of the training photos.
    pub(crate) fn taught(&self) -> Vec<TrainedPhoto> {
        let taught = |place: &usize| {
            let camera = self.set.photos.camera(*place, 0);
            TrainedPhoto { name: self.set.name(*place).to_owned(), size: (camera.width, camera.height) }
        };
        self.set.places.iter().map(taught).collect()
    }

    /// Returns the index of the photo whose view is offered as an image.
    pub(crate) fn shown(&self) -> usize {
        self.held_out.first().or(self.set.places.first()).copied().unwrap_or(0)
    }
}

/// Returns the number of pixels of the photos of `cameras` that confirm what two others show, by
/// points of the reconstruction.
pub(super) fn confirmed_pixels(points: &SparsePoints, cameras: &[Camera]) -> u64 {
    let pixels: f64 = cameras.iter().map(|camera| f64::from(camera.width) * f64::from(camera.height)).sum();
    (confirmed_share(overlap(points, cameras)) * pixels) as u64
}

/// Reads cameras and points; those of a video or of plain photos are found first.
fn open_capture(
    dataset: &Path,
    wanted: &DatasetReadOptions,
    folder: &RunFolder,
    observer: &mut dyn TrainObserver,
) -> Result<Capture, SessionError> {
    let registered = if video::is_video(dataset) {
        let frames = frames(dataset, folder, observer)?;
        // Frames that follow each other overlap; others rarely do.
        let matching =
            if frames.1 > MAX_EXHAUSTIVE_FRAMES { Matching::Sequential } else { Matching::Exhaustive };
        register(&frames.0, matching, folder, observer)?
    } else {
        match wanted.capture(dataset) {
            Ok(capture) => return Ok(capture),
            Err(FormatError { problem: Problem::NoCapture, .. }) => {}
            Err(error) => return Err(error.into()),
        }
        if let Some(model) = &wanted.model {
            return Err(SessionError::NoModel(dataset.join(model)));
        }
        register(dataset, Matching::Auto, folder, observer)?
    };
    Ok(DatasetReadOptions::default().capture(&registered)?)
}

/// Most frames of a video of which each is compared with each.
const MAX_EXHAUSTIVE_FRAMES: usize = 60;

/// Takes photos out of a video; returns their folder and their number.
fn frames(
    video: &Path,
    folder: &RunFolder,
    observer: &mut dyn TrainObserver,
) -> Result<(PathBuf, usize), SessionError> {
    let (shared, frames) = (RefCell::new(observer), folder.path().join(FRAMES));
    let mut progress = |progress| shared.borrow_mut().on_preparation(&Preparation::Video(progress));
    let is_stopped = || shared.borrow_mut().proceed().is_break();
    let count = video::write_frames(video, &frames, &mut progress, &is_stopped)?;
    shared.into_inner().on_notice(&TrainNotice::FramesChosen(count));
    Ok((frames, count))
}

/// Finds the cameras of plain photos with COLMAP; returns the folder of the data set that it makes.
fn register(
    dataset: &Path,
    matching: Matching,
    folder: &RunFolder,
    observer: &mut dyn TrainObserver,
) -> Result<PathBuf, SessionError> {
    let shared = RefCell::new(observer);
    let mut progress = |progress| shared.borrow_mut().on_preparation(&Preparation::Colmap(progress));
    let done = colmap::reconstruct(
        dataset,
        &folder.path().join(COLMAP),
        &ColmapOptions { matching, ..ColmapOptions::default() },
        &mut progress,
        &|| shared.borrow_mut().proceed().is_break(),
    )?;
    let observer = shared.into_inner();
    observer.on_notice(&TrainNotice::Registered { registered: done.registered, photos: done.photos });
    if !done.unregistered.is_empty() {
        observer.on_warning(&TrainWarning::Unregistered(done.unregistered));
    }
    Ok(done.dataset)
}
