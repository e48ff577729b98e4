//! The photos of a capture, as training sees them.
//!
//! [`Photos::open`] looks only at the headers of the files, all threads at once, so that thousands
//! are open in seconds. A photo is decoded when it is asked for, or before, on threads of its own,
//! by `Photos::prefetch`; turned upright; made smaller by area averages ([`PhotoSize`]); freed of
//! its lens; and kept as bytes in a cache that never exceeds [`PhotoOptions::cache_bytes`] but for
//! the photo that is in use.
//!
//! # Sizes
//! A photo may be the one that the model was made from, or that made smaller or larger as a whole,
//! such as those in `images_4`: intrinsics are scaled. Anything else is refused.
//!
//! # Which side is up
//! COLMAP and nerfstudio work on the stored pixels and do not look at EXIF's orientation; other
//! programs turn photos first. The size of the camera tells: where the stored photo fits it, the
//! pixels stay as they are, else the photo is turned as EXIF says. Where both fit (half turns,
//! square photos) nothing is turned, as COLMAP would have it.
//!
//! # Masks
//! Black is left out, white counts; a transparent part of a PNG photo is left out too.

pub(crate) mod cache;
mod error;
mod folder;
mod picture;
mod resize;
#[cfg(test)]
mod tests;
mod undistort;

pub use error::{PhotoError, PhotoErrors, PhotoFault};
pub use folder::photos_in;
pub use picture::Photo;
pub(crate) use picture::level_for;
#[cfg(test)]
pub(crate) use tests::encode_png;

use cache::Cache;
use picture::{Entry, MIN_SIDE_PX, is_scaled, reduced_camera};
use rayon::prelude::*;
use std::{
    collections::VecDeque,
    sync::{Arc, Condvar, Mutex, PoisonError},
    thread::JoinHandle,
};
use undistort::{Lens, undistort_map};
use wm_capture::Capture;
use wm_image::header::{Orientation, PhotoHeader, read_header};
use wm_image::maps::{Filter, Map, MapFault};
use wm_image::photo::DecodeError;
use wm_scene::Camera;
use wm_scene::{Gps, camera::Distortion};

/// The size at which photos are used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum PhotoSize {
    /// Photos keep their size.
    #[default]
    Full,
    /// Sides divided by this, 1 or above, and rounded.
    Divided(f64),
    /// The longer side made this long, px, if it is longer.
    Longest(u32),
}

impl PhotoSize {
    /// Returns the size to which a photo is reduced, px: at least 1 px a side, never larger.
    #[must_use]
    pub fn reduced(self, width: u32, height: u32) -> (u32, u32) {
        let longest = f64::from(width.max(height));
        let scale = match self {
            Self::Full => 1.0,
            Self::Divided(by) => 1.0 / by.max(1.0),
            Self::Longest(side) => (f64::from(side) / longest).min(1.0),
        };
        let side = |length: u32| ((f64::from(length) * scale).round() as u32).clamp(1, length.max(1));
        (side(width), side(height))
    }
}

/// The treatment of photos that cannot be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BadPhotos {
    /// Refuse the capture.
    #[default]
    Refuse,
    /// Go on without them.
    Skip,
}

/// The extent to which photos are checked when they are opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Check {
    /// File and header; a damaged photo is found when it is decoded.
    #[default]
    Headers,
    /// Each photo is decoded once, which fills the cache.
    Pixels,
    /// [`Self::Pixels`] if the cache holds all photos, so that nothing is decoded twice; else
    /// [`Self::Headers`].
    PixelsThatFit,
}

/// Options for opening photos.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoOptions {
    /// The size at which they are used.
    pub size: PhotoSize,
    /// Most bytes of decoded photos that are kept.
    pub cache_bytes: usize,
    /// The treatment of photos that cannot be used.
    pub bad: BadPhotos,
    /// The extent to which they are checked.
    pub check: Check,
    /// Threads that decode what `Photos::prefetch` asks for; 0 for none.
    pub loaders: usize,
}

impl Default for PhotoOptions {
    fn default() -> Self {
        Self {
            size: PhotoSize::Full,
            cache_bytes: 1 << 30,
            bad: BadPhotos::Refuse,
            check: Check::Headers,
            loaders: 2,
        }
    }
}

/// The index of a photo, and the number of times its sides are halved.
type Key = (usize, u8);

/// Photos that wait to be prefetched; more than that are forgotten.
const MAX_WAITING: usize = 256;

/// The photos of a capture.
pub struct Photos {
    shared: Arc<Shared>,
    loaders: Vec<JoinHandle<()>>,
    skipped: Vec<PhotoError>,
    pub(crate) gps: Vec<Option<Gps>>,
    pub(crate) taken: Vec<Option<f64>>,
}

struct Shared {
    entries: Vec<Entry>,
    cache: Cache<Key, Photo>,
    waiting: Mutex<Waiting>,
    woken: Condvar,
}

#[derive(Default)]
struct Waiting {
    keys: VecDeque<Key>,
    is_over: bool,
}

impl Photos {
    /// Looks at every photo of a capture.
    ///
    /// # Errors
    /// [`PhotoErrors`] if any photo cannot be used and none may be skipped, or if none can be used.
    pub fn open(capture: &Capture, options: &PhotoOptions) -> Result<Self, PhotoErrors> {
        let looked: Vec<_> =
            (0..capture.views.len()).into_par_iter().map(|view| look(capture, view, options)).collect();
        let photos = looked.len();
        let (mut entries, mut errors) = (Vec::with_capacity(photos), Vec::new());
        let (mut gps, mut taken) = (vec![None; photos], vec![None; photos]);
        for (view, looked) in looked.into_iter().enumerate() {
            match looked {
                Ok((entry, header)) => {
                    (gps[view], taken[view]) = (header.gps, header.taken);
                    entries.push(entry);
                }
                Err(error) => errors.push(error),
            }
        }
        let mut shared = Shared::of(entries, options);
        let bytes: usize = shared.entries.iter().map(Entry::bytes).sum();
        let is_decoded = match options.check {
            Check::Headers => false,
            Check::Pixels => true,
            Check::PixelsThatFit => bytes <= options.cache_bytes,
        };
        if is_decoded {
            let bad: Vec<(usize, PhotoError)> = (0..shared.entries.len())
                .into_par_iter()
                .filter_map(|index| Some((index, shared.get(index, 0).err()?)))
                .collect();
            if !bad.is_empty() {
                // Photos are known by their place: the cache starts anew where places change.
                let mut index = 0;
                let mut entries = std::mem::take(&mut shared.entries);
                entries.retain(|_| {
                    index += 1;
                    bad.iter().all(|(bad, _)| *bad != index - 1)
                });
                shared = Shared::of(entries, options);
                errors.extend(bad.into_iter().map(|(_, error)| error));
            }
        }
        let is_refused = options.bad == BadPhotos::Refuse && !errors.is_empty();
        if is_refused || shared.entries.is_empty() {
            return Err(PhotoErrors { errors, photos });
        }
        let shared = Arc::new(shared);
        let loader = |_| {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || shared.serve())
        };
        let loaders = (0..options.loaders).map(loader).collect();
        Ok(Self { shared, loaders, skipped: errors, gps, taken })
    }

    /// Returns the number of photos, without those that were skipped.
    #[must_use]
    pub fn len(&self) -> usize {
        self.shared.entries.len()
    }

    /// Returns true if there are none, which [`Self::open`] does not allow.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.shared.entries.is_empty()
    }

    /// The index in [`Capture::views`] of photo `index`.
    ///
    /// # Panics
    /// If there is no such photo.
    #[must_use]
    pub fn view(&self, index: usize) -> usize {
        self.shared.entries[index].view
    }

    /// The camera of photo `index` with sides divided by `2^level`, without decoding it.
    ///
    /// # Panics
    /// If there is no such photo.
    #[must_use]
    pub fn camera(&self, index: usize, level: u8) -> Camera {
        reduced_camera(&self.shared.entries[index].lens.ideal, level)
    }

    /// Returns true if the lens of photo `index` distorts.
    ///
    /// # Panics
    /// If there is no such photo.
    #[must_use]
    pub fn is_bent(&self, index: usize) -> bool {
        self.shared.entries[index].lens.distortion != Distortion::None
    }

    /// A map over the stored photo `index`, of any size, as a map of `size` over the photo that
    /// [`Self::get`] gives. Beside holes, which are values that are not finite, the nearest value
    /// stands.
    ///
    /// # Errors
    /// [`MapFault::Aspect`] if the map has not the shape of the photo.
    ///
    /// # Panics
    /// If there is no such photo, or a side is 0.
    pub(crate) fn without_lens(
        &self,
        index: usize,
        map: &Map,
        size: (u32, u32),
        filter: Filter,
    ) -> Result<Map, MapFault> {
        let lens = &self.shared.entries[index].lens;
        map.check_shape(lens.photo.width, lens.photo.height)?;
        Ok(match lens.distortion {
            Distortion::None => map.resampled(size.0, size.1, filter),
            _ => undistort_map(map, lens, size, filter),
        })
    }

    /// The highest level at which no photo has a side shorter than `shortest` px; 0 at least.
    pub(crate) fn last_level(&self, shortest: u32) -> u8 {
        let sides = self.shared.entries.iter().map(|e| e.lens.ideal.width.min(e.lens.ideal.height));
        let least = sides.min().unwrap_or(1);
        (0..16).take_while(|level| least >> level >= shortest.max(1)).last().unwrap_or(0)
    }

    /// The lowest level at which no side of photo `index` is longer than `longest` px, as far as
    /// sides stay 16 px long.
    ///
    /// # Panics
    /// If there is no such photo.
    pub(crate) fn level_within(&self, index: usize, longest: u32) -> u8 {
        let camera = self.camera(index, 0);
        let side = camera.width.max(camera.height);
        (0..8).find(|level| side >> level <= longest).unwrap_or(8).min(self.last_level(16))
    }

    /// Photo `index` with sides divided by `2^level`: `2^level` px wide blocks averaged, what is
    /// left over at the right and the bottom cut off. Waits until it is decoded.
    ///
    /// # Errors
    /// [`PhotoError`] if it is damaged, or gone.
    ///
    /// # Panics
    /// If there is no such photo, or nothing is left of it at that level.
    pub fn get(&self, index: usize, level: u8) -> Result<Arc<Photo>, PhotoError> {
        let camera = self.camera(index, level);
        assert!(camera.width > 0 && camera.height > 0, "photo {index} has no level {level}");
        self.shared.get(index, level)
    }

    /// Has photo `index` decoded in the background, so that [`Self::get`] need not wait for it
    /// later.
    pub(crate) fn prefetch(&self, index: usize, level: u8) {
        let key = (index, level);
        if self.loaders.is_empty() || index >= self.len() || self.shared.cache.is_under_way(key) {
            return;
        }
        let mut waiting = self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        if waiting.keys.len() < MAX_WAITING && !waiting.keys.contains(&key) {
            waiting.keys.push_back(key);
            drop(waiting);
            self.shared.woken.notify_one();
        }
    }

    /// The photos that were left out, with [`BadPhotos::Skip`].
    #[must_use]
    pub fn skipped(&self) -> &[PhotoError] {
        &self.skipped
    }
}

impl Drop for Photos {
    fn drop(&mut self) {
        self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner).is_over = true;
        self.shared.woken.notify_all();
        for loader in self.loaders.drain(..) {
            // A loader that panicked has nothing left to say.
            let _ = loader.join();
        }
    }
}

impl Shared {
    fn of(entries: Vec<Entry>, options: &PhotoOptions) -> Self {
        let cache = Cache::new(options.cache_bytes);
        Self { entries, cache, waiting: Mutex::default(), woken: Condvar::new() }
    }

    fn get(&self, index: usize, level: u8) -> Result<Arc<Photo>, PhotoError> {
        let entry = &self.entries[index];
        self.cache.get((index, level), || {
            if level == 0 {
                return entry.load();
            }
            match self.cache.peek((index, 0)) {
                Some(whole) => Ok(whole.reduced(level)),
                None => Ok(entry.load()?.reduced(level)),
            }
        })
    }

    /// Decodes what is waited for until there is no more to come.
    fn serve(&self) {
        loop {
            let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            let (index, level) = loop {
                if waiting.is_over {
                    return;
                }
                if let Some(key) = waiting.keys.pop_front() {
                    break key;
                }
                waiting = self.woken.wait(waiting).unwrap_or_else(PoisonError::into_inner);
            };
            drop(waiting);
            // Whoever asks for the photo meets the error himself.
            let _ = self.get(index, level);
        }
    }
}

/// Reads the header of a photo and checks that it fits its camera.
fn look(capture: &Capture, index: usize, options: &PhotoOptions) -> Result<(Entry, PhotoHeader), PhotoError> {
    let view = &capture.views[index];
    let Some(file) = capture.photo(index) else {
        return Err(PhotoError { path: capture.images.join(&view.file), fault: PhotoFault::Missing });
    };
    let mut header = read_header(&file).map_err(|e| DecodeError::of_header(&e))?;
    if let Some(original) = view.original.as_ref().and_then(|file| read_header(file).ok()) {
        header.gps = header.gps.or(original.gps);
        header.taken = header.taken.or(original.taken);
    }
    let PhotoHeader { kind, width, height, orientation, .. } = header;
    let camera = (view.camera.width, view.camera.height);
    let stored = (width, height);
    if width.min(height) < MIN_SIDE_PX {
        return Err(PhotoError {
            path: file,
            fault: PhotoFault::Small { width, height, least: MIN_SIDE_PX },
        });
    }
    let turned = if orientation.swaps_sides() { (height, width) } else { stored };
    let (upright, orientation) = if is_scaled(stored, camera) {
        (stored, Orientation::Upright)
    } else if is_scaled(turned, camera) {
        (turned, orientation)
    } else {
        let fault = PhotoFault::Size { width, height, camera_width: camera.0, camera_height: camera.1 };
        return Err(PhotoError { path: file, fault });
    };
    let size = options.size.reduced(upright.0, upright.1);
    let photo = view.camera.resized(size.0, size.1);
    // Of some lenses hardly a pixel is left.
    let least = MIN_SIDE_PX.min(photo.width).min(photo.height);
    let ideal = view.distortion.undistorted(&photo).filter(|ideal| ideal.width.min(ideal.height) >= least);
    let Some(ideal) = ideal else {
        return Err(PhotoError { path: file, fault: PhotoFault::Lens });
    };
    let lens = Lens { photo, distortion: view.distortion, ideal };
    Ok((Entry { view: index, file, mask: view.mask.clone(), kind, stored, orientation, lens }, header))
}
