//! Priors on disk: `priors.json`, and for each photo `disparity/NAME.npy` `[H, W]`,
//! `normal/NAME.npy` `[H, W, 3]` and `sky/NAME.png` (0 the place, 255 the sky, 128 unknown), what
//! there is of them.

use super::fit::Fit;
use super::{Prior, SkyClass};
use crate::files::remove;
use crate::movers::MoverMask;
use crate::photos::cache::{Cache, Weigh};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::{fmt, fs};
use thiserror::Error;
use wm_base::files::write_atomically;
use wm_base::{FormatError, Problem, npy};
use wm_scene::Camera;

/// The file that says what the folder holds.
pub const INDEX: &str = "priors.json";
/// The file that takes its place until the work is done.
pub(crate) const UNFINISHED: &str = "unfinished.json";
const VERSION: u32 = 1;
/// Memory for priors that are in use, bytes.
const CACHE_BYTES: usize = 256 << 20;
/// Longest index, bytes: 10,000 photos take 3 MB.
const MAX_INDEX_BYTES: u64 = 256 << 20;
/// The largest relative difference between the aspect ratios of a map and its photo.
const ASPECT_TOLERANCE: f64 = 0.02;

/// The index of a folder of priors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Index {
    version: u32,
    /// The source of the priors, in words.
    pub source: String,
    /// By the name of the photo.
    pub photos: BTreeMap<String, Entry>,
    /// Photos without, and why.
    pub left_out: BTreeMap<String, String>,
}

/// Means over the photos of a folder of priors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PriorsSummary {
    /// Photos with priors.
    pub photos: usize,
    /// Mean share of the pixels whose depth is known, 0-1.
    pub known: f64,
    /// Mean share of the pixels that are the sky, 0-1.
    pub sky: f64,
}

impl fmt::Display for PriorsSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { photos, known, sky } = self;
        write!(
            f,
            "depth of {:.0} % of the pixels from {photos} photos, {:.0} % are sky",
            100.0 * known,
            100.0 * sky
        )
    }
}

impl Index {
    /// Returns means over the photos.
    #[must_use]
    pub fn summary(&self) -> PriorsSummary {
        let mean = |of: fn(&Entry) -> f32| {
            f64::from(self.photos.values().map(of).sum::<f32>() / self.photos.len().max(1) as f32)
        };
        PriorsSummary {
            photos: self.photos.len(),
            known: mean(|entry| entry.known),
            sky: mean(|entry| entry.sky_share),
        }
    }
}

/// The entry of one photo.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Width of its maps, px.
    pub(crate) width: u32,
    /// Their height, px.
    pub(crate) height: u32,
    /// True if there is inverse depth.
    pub(crate) disparity: bool,
    /// True if there are normals.
    pub(crate) normal: bool,
    /// True if there is a sky map.
    pub(crate) sky: bool,
    /// The error of inverse depth, 1 / scene unit.
    pub(crate) sigma: f32,
    /// Share of the pixels whose depth is known, without the sky.
    pub known: f32,
    /// Share of the pixels that are the sky.
    pub sky_share: f32,
    /// The fit of relative depth to points, if there was one.
    pub fit: Option<Fit>,
}

/// A reason why priors cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PriorsError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FormatError),
    /// The index is none.
    #[error("{}: no index of priors ({reason}); make them again", path.display())]
    Index {
        /// The file.
        path: PathBuf,
        /// The fault.
        reason: String,
    },
    /// The folder holds unfinished priors of another source.
    #[error("{}: {reason}; leave out --resume to begin anew", path.display())]
    Other {
        /// The folder.
        path: PathBuf,
        /// The difference.
        reason: String,
    },
    /// A map does not fit.
    #[error("{}: {reason}; make the priors again", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// The fault.
        reason: String,
    },
}

impl Weigh for Prior {
    fn bytes(&self) -> usize {
        Self::bytes(self)
    }
}

/// Priors of a data set, read when they are asked for.
pub struct Priors {
    pub(crate) folder: PathBuf,
    index: Index,
    /// By the place of the name among all.
    cache: Cache<usize, Prior>,
    /// By name, the pixels of photos of which nothing is believed.
    movers: BTreeMap<String, MoverMask>,
}

/// Writes a folder of priors; the index comes last.
pub struct PriorsWriter {
    folder: PathBuf,
    index: Index,
    /// True if an index of an earlier run may exist, which stays until the first map changes.
    has_former: bool,
}

fn file(folder: &Path, kind: &str, name: &str, extension: &str) -> PathBuf {
    // Names come from files of others, which may name places outside of the folder.
    let parts = Path::new(name).components().filter(|part| matches!(part, Component::Normal(_)));
    let mut path = folder.join(kind).join(parts.collect::<PathBuf>()).into_os_string();
    path.push(".");
    path.push(extension);
    path.into()
}

/// Reads an index; `None` if there is none.
fn read_index(path: &Path) -> Result<Option<Index>, PriorsError> {
    let read = |e| PriorsError::File(FormatError::whole(path, Problem::Read(e)));
    let length = match fs::metadata(path) {
        Ok(found) => found.len(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(read(e)),
    };
    let fault = |reason: String| PriorsError::Index { path: path.into(), reason };
    if length > MAX_INDEX_BYTES {
        return Err(fault(format!("{length} bytes are too many")));
    }
    let text = fs::read_to_string(path).map_err(read)?;
    let index: Index = serde_json::from_str(&text).map_err(|e| fault(e.to_string()))?;
    if index.version != VERSION {
        return Err(fault(format!("version {} and not {VERSION}", index.version)));
    }
    Ok(Some(index))
}

impl Priors {
    /// Opens a folder; `None` if it holds no index.
    ///
    /// # Errors
    /// [`PriorsError`] if the index cannot be read.
    pub fn open(folder: &Path) -> Result<Option<Self>, PriorsError> {
        let index = read_index(&folder.join(INDEX))?;
        Ok(index.map(|index| {
            let (cache, movers) = (Cache::new(CACHE_BYTES), BTreeMap::new());
            Self { folder: folder.into(), index, cache, movers }
        }))
    }

    /// Leaves out the pixels of photos, by their names, that show movers.
    pub(crate) fn forget(&mut self, movers: BTreeMap<String, MoverMask>) {
        self.movers = movers;
        self.cache = Cache::new(CACHE_BYTES);
    }

    /// Returns the index.
    #[must_use]
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// Returns true if any photo shows the sky.
    pub(crate) fn has_sky(&self) -> bool {
        self.index.photos.values().any(|entry| entry.sky && entry.sky_share > 0.0)
    }

    /// The prior of the photo `name`, which `camera` sees; `None` if there is none.
    ///
    /// # Errors
    /// [`PriorsError`] if a map is missing, damaged, or of another shape than the photo.
    pub fn get(&self, name: &str, camera: &Camera) -> Result<Option<Arc<Prior>>, PriorsError> {
        let Some(entry) = self.index.photos.get(name) else { return Ok(None) };
        let (width, height) = (f64::from(entry.width), f64::from(entry.height));
        let shape = width * f64::from(camera.height) / (height * f64::from(camera.width));
        let is_alike = (shape - 1.0).abs() < ASPECT_TOLERANCE;
        if !is_alike {
            let reason = format!(
                "maps of {name} are {width}x{height} px and the photo is {}x{}: not the same shape",
                camera.width, camera.height
            );
            return Err(PriorsError::Map { path: self.folder.join(INDEX), reason });
        }
        let place = self.index.photos.keys().take_while(|key| key.as_str() < name).count();
        self.cache.get(place, || self.read(name, entry)).map(Some)
    }

    fn read(&self, name: &str, entry: &Entry) -> Result<Prior, PriorsError> {
        let (width, height) = (entry.width as usize, entry.height as usize);
        let mut prior =
            Prior { width: entry.width, height: entry.height, sigma: entry.sigma, ..Prior::default() };
        let numbers = |kind: &str, shape: &[usize]| {
            let path = file(&self.folder, kind, name, "npy");
            let (values, found) = npy::read(&path)?;
            if found != shape {
                let reason = format!("shape {found:?} and not {shape:?}");
                return Err(PriorsError::Map { path, reason });
            }
            Ok(values)
        };
        if entry.disparity {
            prior.disparity = numbers("disparity", &[height, width])?;
        }
        if entry.normal {
            prior.normal = numbers("normal", &[height, width, 3])?.as_chunks().0.to_vec();
        }
        if entry.sky {
            let path = file(&self.folder, "sky", name, "png");
            let classes = read_classes(&path, (entry.width, entry.height));
            prior.sky = classes.map_err(|reason| PriorsError::Map { path, reason })?;
        }
        if let Some(movers) = self.movers.get(name) {
            prior.forget(movers.pixels(entry.width, entry.height));
        }
        Ok(prior)
    }
}

fn read_classes(path: &Path, size: (u32, u32)) -> Result<Vec<SkyClass>, String> {
    let opened = fs::File::open(path).map_err(|e| e.to_string())?;
    let mut decoder = png::Decoder::new(std::io::BufReader::new(opened));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    if (reader.info().width, reader.info().height) != size {
        return Err(format!(
            "{}x{} px and not {}x{}",
            reader.info().width,
            reader.info().height,
            size.0,
            size.1
        ));
    }
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("too large")?];
    let info = reader.next_frame(&mut bytes).map_err(|e| e.to_string())?;
    let channels = info.color_type.samples();
    let class = |pixel: &[u8]| match pixel[0] {
        0..64 => SkyClass::Place,
        64..192 => SkyClass::Unknown,
        192.. => SkyClass::Sky,
    };
    Ok(bytes[..info.buffer_size()].chunks_exact(channels).map(class).collect())
}

impl PriorsWriter {
    /// Begins in a folder, which is made. An index that is there stands until the first photo is
    /// added.
    ///
    /// # Errors
    /// [`FormatError`] if the folder cannot be written to.
    pub fn new(folder: &Path, source: String) -> Result<Self, FormatError> {
        fs::create_dir_all(folder).map_err(|e| FormatError::whole(folder, Problem::Write(e.into())))?;
        let index = Index { version: VERSION, source, ..Index::default() };
        let writer = Self { folder: folder.into(), index, has_former: true };
        // Whether it can be written to shows now, and not after the work.
        writer.pause()?;
        Ok(writer)
    }

    /// Goes on with what [`Self::pause`] left, or with what is done but for photos that came later.
    ///
    /// # Errors
    /// [`PriorsError`] if nothing was begun in the folder, or from another source, or it cannot be
    /// written to.
    pub fn resumed(folder: &Path, source: &str) -> Result<Self, PriorsError> {
        let begun = match read_index(&folder.join(UNFINISHED))? {
            Some(begun) => Some(begun),
            None => read_index(&folder.join(INDEX))?,
        };
        let other = |reason| PriorsError::Other { path: folder.into(), reason };
        let index = begun.ok_or_else(|| other("holds no priors that were begun".into()))?;
        if index.source != source {
            return Err(other(format!(
                "holds priors from {}, and these would be from {source}",
                index.source
            )));
        }
        let writer = Self { folder: folder.into(), index, has_former: true };
        writer.pause()?;
        Ok(writer)
    }

    /// Returns true if a photo is done, or left out.
    #[must_use]
    pub fn is_done(&self, name: &str) -> bool {
        self.index.photos.contains_key(name) || self.index.left_out.contains_key(name)
    }

    /// Returns the index so far.
    #[must_use]
    pub fn index(&self) -> &Index {
        &self.index
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Keeps what is done, for [`Self::resumed`].
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be written.
    pub fn pause(&self) -> Result<(), FormatError> {
        self.write(UNFINISHED)
    }

    /// Writes the prior of the photo `name`.
    ///
    /// # Errors
    /// [`FormatError`] if a file cannot be written.
    pub fn add(&mut self, name: &str, prior: &Prior, fit: Option<Fit>) -> Result<(), FormatError> {
        if self.has_former {
            let path = self.folder.join(INDEX);
            remove(&path).map_err(|e| FormatError::whole(&path, Problem::Write(e.into())))?;
            self.has_former = false;
        }
        let (width, height) = (prior.width as usize, prior.height as usize);
        let place = |kind: &str, extension: &str| {
            let path = file(&self.folder, kind, name, extension);
            let parent = path.parent().unwrap_or(&self.folder);
            fs::create_dir_all(parent)
                .map_err(|e| FormatError::whole(parent, Problem::Write(e.into())))
                .map(|()| path.clone())
        };
        if !prior.disparity.is_empty() {
            npy::write(&place("disparity", "npy")?, &prior.disparity, &[height, width])?;
        }
        if !prior.normal.is_empty() {
            npy::write(&place("normal", "npy")?, prior.normal.as_flattened(), &[height, width, 3])?;
        }
        if !prior.sky.is_empty() {
            let bytes: Vec<u8> = prior.sky.iter().map(|class| *class as u8).collect();
            write_atomically(&place("sky", "png")?, |out| {
                let mut encoder = png::Encoder::new(out, prior.width, prior.height);
                encoder.set_color(png::ColorType::Grayscale);
                encoder.set_depth(png::BitDepth::Eight);
                let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes));
                Ok(written.map_err(std::io::Error::from)?)
            })?;
        }
        let pixels = (width * height).max(1) as f32;
        let share = |count: usize| count as f32 / pixels;
        let entry = Entry {
            width: prior.width,
            height: prior.height,
            disparity: !prior.disparity.is_empty(),
            normal: !prior.normal.is_empty(),
            sky: !prior.sky.is_empty(),
            sigma: prior.sigma,
            known: share(prior.disparity.iter().filter(|v| **v > 0.0).count()),
            sky_share: share(prior.sky.iter().filter(|class| **class == SkyClass::Sky).count()),
            fit,
        };
        self.index.photos.insert(name.to_owned(), entry);
        Ok(())
    }

    /// Notes that a photo has no prior.
    pub fn leave_out(&mut self, name: &str, reason: String) {
        self.index.left_out.insert(name.to_owned(), reason);
    }

    /// Writes the index.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be written.
    pub fn finish(self) -> Result<Index, FormatError> {
        self.write(INDEX)?;
        // It is of no use any more, and does no harm where it stays.
        let _ = remove(&self.folder.join(UNFINISHED));
        Ok(self.index)
    }

    /// Gives up, since there is nothing to keep. The folder goes too, if it is empty; an index of
    /// before stays if nothing was added.
    pub fn abandon(self) {
        // What cannot be removed does no harm.
        let _ = remove(&self.folder.join(UNFINISHED)).and_then(|()| fs::remove_dir(&self.folder));
    }

    fn write(&self, name: &str) -> Result<(), FormatError> {
        let path = self.folder.join(name);
        let text = serde_json::to_vec_pretty(&self.index)
            .map_err(|e| FormatError::whole(&path, Problem::Value(e.to_string())))?;
        write_atomically(&path, |out| Ok(out.write_all(&text)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn prior() -> Prior {
        Prior {
            width: 4,
            height: 2,
            disparity: vec![0.0, 0.5, f32::NAN, 0.25, 1.0, 1.0, 1.0, 1.0],
            sigma: 0.125,
            normal: vec![[0.0, 0.0, 1.0]; 8],
            sky: [SkyClass::Sky, SkyClass::Place, SkyClass::Unknown, SkyClass::Place].repeat(2),
        }
    }

    fn camera(size: (u32, u32)) -> Camera {
        Camera::looking(size, 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap()
    }

    #[test]
    fn priors_come_back_and_faults_are_named() {
        let place = tempfile::tempdir().unwrap();
        assert!(Priors::open(place.path()).unwrap().is_none());
        let mut writer = PriorsWriter::new(place.path(), "made up".into()).unwrap();
        writer.add("a/b.jpg", &prior(), None).unwrap();
        writer.leave_out("c.jpg", "too dark".into());
        let index = writer.finish().unwrap();
        assert_eq!((index.photos["a/b.jpg"].sky_share, index.photos["a/b.jpg"].known), (0.25, 0.75));
        let open = || Priors::open(place.path()).unwrap().unwrap();
        let found = open().get("a/b.jpg", &camera((40, 20))).unwrap().unwrap();
        assert!(found.disparity[2].is_nan() && found.disparity[..2] == [0.0, 0.5]);
        assert_eq!(
            (found.sky.clone(), found.normal.clone(), found.sigma),
            (prior().sky, prior().normal, 0.125)
        );
        assert!(open().get("c.jpg", &camera((40, 20))).unwrap().is_none());
        assert_eq!(file(Path::new("p"), "sky", "/../a/./b.jpg", "png"), Path::new("p/sky/a/b.jpg.png"));
        let say = |error: PriorsError| error.to_string();
        assert!(
            say(open().get("a/b.jpg", &camera((40, 30))).unwrap_err())
                .contains("4x2 px and the photo is 40x30")
        );
        npy::write(&place.path().join("disparity/a/b.jpg.npy"), &[1.0; 4], &[2, 2]).unwrap();
        assert!(
            say(open().get("a/b.jpg", &camera((40, 20))).unwrap_err())
                .contains("shape [2, 2] and not [2, 4]")
        );
        fs::write(place.path().join(INDEX), "{\"version\": 1").unwrap();
        assert!(say(Priors::open(place.path()).err().unwrap()).contains("no index of priors"));
    }

    #[test]
    fn what_was_begun_is_gone_on_with() {
        let place = tempfile::tempdir().unwrap();
        let begun = |source: &str| PriorsWriter::resumed(place.path(), source).map_err(|e| e.to_string());
        assert!(begun("made up").err().unwrap().ends_with("begun; leave out --resume to begin anew"));
        let mut writer = PriorsWriter::new(place.path(), "made up".into()).unwrap();
        writer.add("a.jpg", &prior(), None).unwrap();
        writer.pause().unwrap();
        assert!(Priors::open(place.path()).unwrap().is_none());
        assert!(
            begun("elsewhere").err().unwrap().contains("from made up, and these would be from elsewhere")
        );
        let mut writer = begun("made up").unwrap();
        assert!(writer.is_done("a.jpg") && !writer.is_done("b.jpg"));
        writer.add("b.jpg", &prior(), None).unwrap();
        assert_eq!(writer.finish().unwrap().photos.len(), 2);
        assert!(!place.path().join(UNFINISHED).exists());
        // Of what is done nothing is lost before more is added, nor then.
        let mut writer = begun("made up").unwrap();
        assert!(Priors::open(place.path()).unwrap().is_some());
        writer.add("b.jpg", &prior(), None).unwrap();
        assert!(Priors::open(place.path()).unwrap().is_none());
        writer.pause().unwrap();
        assert_eq!(begun("made up").unwrap().finish().unwrap().photos.len(), 2);
        PriorsWriter::new(place.path(), "nothing".into()).unwrap().abandon();
        assert_eq!(Priors::open(place.path()).unwrap().unwrap().index().photos.len(), 2);
        assert!(!place.path().join(UNFINISHED).exists());
    }
}
