//! The search for movers before a training: in what, and what follows.

use super::data::TrainData;
use super::error::SessionError;
use super::folder::RunFolder;
use super::observer::{TrainNotice, TrainObserver};
use super::options::SessionOptions;
use crate::config::{MoverMode, TrainConfig};
use crate::movers::{self, MoverMask, MoverOutcome, MoverView, sheet};
use crate::photos::Photo;
use crate::priors::{Prior, Priors, photos};
use std::sync::Arc;
use wm_base::files::write_atomically;

/// Searches the training photos for movers, by the depth that stereo found, and makes the priors
/// forget them. Returns a mask for each photo, or none if there are no movers: a function of photos
/// and priors, so that a training that is resumed has the same.
pub(super) fn search(
    config: &TrainConfig,
    options: &SessionOptions,
    data: &TrainData,
    priors: Option<&mut Priors>,
    folder: &RunFolder,
    observer: &mut dyn TrainObserver,
) -> Result<Vec<MoverMask>, SessionError> {
    // Depth of other sources does not tell what stands still.
    let priors = priors.filter(|priors| priors.index().source == photos::SOURCE);
    let (Some(priors), MoverMode::Auto) = (priors, config.movers) else { return Ok(Vec::new()) };
    let cameras = data.cameras();
    let level = movers::level(&cameras);
    let gains = data.gains().filter(|gains| gains.differ()).map_or(&[][..], |gains| &gains.gains);
    let mut views = Vec::with_capacity(cameras.len());
    for (index, place) in data.set.places.iter().enumerate() {
        let camera = data.set.photos.camera(*place, level);
        let pixels = camera.width as usize * camera.height as usize;
        let prior = priors.get(data.set.name(*place), &data.set.photos.camera(*place, 0))?;
        // A damaged photo is named when the training meets it.
        let (Some(prior), Ok(photo)) = (prior, data.set.photos.get(*place, level)) else {
            views.push(MoverView::new(camera, &vec![[0.0; 3]; pixels], &vec![f32::NAN; pixels]));
            continue;
        };
        let gain = gains.get(index).copied().unwrap_or([1.0; 3]);
        let color = |rgb: &[u8; 3]| [0, 1, 2].map(|c| f32::from(rgb[c]) / 255.0 / gain[c]);
        let colors: Vec<[f32; 3]> = photo.rgb.as_chunks().0.iter().map(color).collect();
        views.push(MoverView::new(camera, &colors, &stereo(&prior, &photo)));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.cpu.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| SessionError::Threads(error.to_string()))?;
    let (outcome, masks) = pool.install(|| movers::find(&views));
    if let MoverOutcome::Found { .. } = outcome {
        write_sheet(data, folder, &masks)?;
        let names = data.set.places.iter().map(|place| data.set.name(*place).to_owned());
        priors.forget(names.zip(masks.iter().cloned()).collect());
    }
    observer.on_notice(&TrainNotice::Movers { outcome, photos: cameras.len() });
    Ok(masks)
}

/// The prior's inverse depth at the size of a photo; where the user's mask leaves the photo out it
/// is not known.
fn stereo(prior: &Prior, photo: &Photo) -> Vec<f32> {
    let middle = |at: u32, pixels: u32, of: u32| ((2 * at + 1) * of / (2 * pixels)) as usize;
    let pixel = |x: u32, y: u32| {
        let at = middle(y, photo.height, prior.height) * prior.width as usize
            + middle(x, photo.width, prior.width);
        let counts = photo.mask.as_ref().is_none_or(|mask| mask[(y * photo.width + x) as usize] > 127);
        prior.disparity.get(at).copied().filter(|_| counts).unwrap_or(f32::NAN)
    };
    (0..photo.height).flat_map(|y| (0..photo.width).map(move |x| (x, y))).map(|(x, y)| pixel(x, y)).collect()
}

/// Draws the masks into the run folder.
fn write_sheet(data: &TrainData, folder: &RunFolder, masks: &[MoverMask]) -> Result<(), SessionError> {
    let mut shown: Vec<(Arc<Photo>, &MoverMask)> = Vec::new();
    for (place, mask) in data.set.places.iter().zip(masks).filter(|(_, mask)| !mask.is_empty()) {
        if let (true, Ok(photo)) = (shown.len() < sheet::MAX_PHOTOS, data.set.photos.get(*place, 0)) {
            shown.push((photo, mask));
        }
    }
    let photos: Vec<(&Photo, &MoverMask)> = shown.iter().map(|(photo, mask)| (&**photo, *mask)).collect();
    write_atomically(&folder.path().join(sheet::FILE), |out| Ok(sheet::write(&photos, out)?))?;
    Ok(())
}
