//! Prepared assets on disk: a folder beside the scene, which can be deleted at any time.
//!
//! Each file names what it was made from by a digest: of the splats, the views and the facts of the
//! scene, of the arithmetic of the renderer, and of the version of this library. A file with
//! another digest, or whose contents do not match its own checksum, is not read; it is made again
//! and replaced.
//!
//! ```text
//! 0   magic, 8 bytes
//! 8   SHA-256 of what it was made from
//! 40  CRC-32 of the contents, 4 bytes, little-endian
//! 44  contents: postcard
//! ```

use super::packed::unpacked;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use std::fmt::{self, Display, Formatter};
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::SystemTime;
use wm_base::files::{self, write_atomically};
use wm_scene::survey::Survey;
use wm_scene::{Metadata, Scene};

const MAGIC: &[u8; 8] = b"WMASSET1";
const HEADER_BYTES: usize = 44;
const EXTENSION: &str = "wmasset";
/// Version of the algorithms that make assets: raise it when any of them gives other numbers for
/// the same scene.
const VERSION: u32 = 28;
/// Bytes that the files of one scene take at most; the oldest go first.
const MOST_BYTES: u64 = 1 << 30;

/// A folder for the prepared assets of one scene, or none.
#[derive(Clone, Debug, Default)]
pub struct AssetCache {
    folder: Option<PathBuf>,
    scene: AssetDigest,
}

/// The name of an asset's file: a word, and numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AssetFile {
    pub word: &'static str,
    pub numbers: Vec<f64>,
}

/// The digest of all that the prepared assets of a scene depend on, under which their files are
/// looked up: 64 hexadecimal digits as text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AssetDigest([u8; 32]);

impl Display for AssetDigest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl FromStr for AssetDigest {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let fault = || format!("`{}` is no digest: it must be 64 hexadecimal digits", text.escape_debug());
        let mut digest = [0; 32];
        let (pairs, rest) = text.as_bytes().as_chunks::<2>();
        if pairs.len() != digest.len() || !rest.is_empty() || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(fault());
        }
        for (byte, pair) in digest.iter_mut().zip(pairs) {
            let pair = std::str::from_utf8(pair).map_err(|_| fault())?;
            *byte = u8::from_str_radix(pair, 16).map_err(|_| fault())?;
        }
        Ok(Self(digest))
    }
}

impl AssetDigest {
    /// The digest for the splats about a focus of the place that has this one.
    pub(crate) fn about(self, path: &[[f64; 3]; 2], splats: usize) -> Self {
        let mut hash = Sha256::new();
        hash.update(self.0);
        path.as_flattened().iter().for_each(|number| hash.update(number.to_le_bytes()));
        hash.update((splats as u64).to_le_bytes());
        Self(hash.finalize().into())
    }
}

impl AssetCache {
    /// No cache: everything is made anew.
    #[must_use]
    pub fn off() -> Self {
        Self::default()
    }

    /// The usual folder of a scene file: `place.ply.assets` beside `place.ply`, `weather.assets`
    /// inside a scene that is a folder.
    #[must_use]
    pub fn folder_of(scene: &Path) -> PathBuf {
        if files::is_folder(scene).is_ok_and(|is_folder| is_folder) {
            return scene.join("weather.assets");
        }
        let mut name = scene.file_name().unwrap_or_default().to_owned();
        name.push(".assets");
        scene.with_file_name(name)
    }

    /// A cache in `folder`, which is made when something is written to it.
    pub(crate) fn new(folder: Option<PathBuf>, scene: AssetDigest) -> Self {
        Self { folder, scene }
    }

    /// The folder; `None` if nothing is kept.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// The name of the file of an asset; `None` if nothing is kept.
    pub(crate) fn name(&self, file: &AssetFile) -> Option<String> {
        Some(self.entry(file)?.0.file_name()?.to_str()?.to_owned())
    }

    /// The digest of the scene; `None` if nothing is kept.
    pub(crate) fn digest(&self) -> Option<AssetDigest> {
        self.folder.as_ref().map(|_| self.scene)
    }

    /// The digest of everything that an asset is made from, and the path that it has.
    fn entry(&self, file: &AssetFile) -> Option<(PathBuf, [u8; 32])> {
        let folder = self.folder.as_ref()?;
        let AssetFile { word: name, numbers } = file;
        let mut hash = Sha256::new();
        hash.update(self.scene.0);
        hash.update(name);
        numbers.iter().for_each(|number| hash.update(rounded(*number).to_le_bytes()));
        let digest: [u8; 32] = hash.finalize().into();
        let short: String = digest[..6].iter().map(|byte| format!("{byte:02x}")).collect();
        Some((folder.join(format!("{name}-{short}.{EXTENSION}")), digest))
    }

    /// Reads an asset; `None` if it is not there, is damaged or belongs to another state of the
    /// scene.
    pub(crate) fn get<T: DeserializeOwned>(&self, file: &AssetFile) -> Option<T> {
        let (path, digest) = self.entry(file)?;
        let bytes = files::read(&path).ok()?;
        let bytes = unpacked(&bytes)?;
        let (header, contents) = bytes.split_at_checked(HEADER_BYTES)?;
        let is_whole = header[..8] == *MAGIC
            && header[8..40] == digest
            && header[40..] == crc32fast::hash(contents).to_le_bytes();
        if !is_whole {
            return None;
        }
        let (asset, rest) = postcard::take_from_bytes(contents).ok()?;
        rest.is_empty().then_some(asset)
    }

    /// Writes an asset. A folder that cannot be written to is no fault: the asset is made again
    /// next time.
    pub(crate) fn put<T: Serialize>(&self, file: AssetFile, asset: &T) {
        // A browser has nothing to write to.
        if cfg!(target_arch = "wasm32") {
            return;
        }
        let Some((path, digest)) = self.entry(&file) else { return };
        let Some(folder) = &self.folder else { return };
        let mut bytes = vec![0; HEADER_BYTES];
        bytes[..8].copy_from_slice(MAGIC);
        bytes[8..40].copy_from_slice(&digest);
        let Ok(mut bytes) = postcard::to_extend(asset, bytes) else { return };
        let checksum = crc32fast::hash(&bytes[HEADER_BYTES..]).to_le_bytes();
        bytes[40..HEADER_BYTES].copy_from_slice(&checksum);
        if bytes.len() as u64 > MOST_BYTES || fs::create_dir_all(folder).is_err() {
            return;
        }
        let _ = write_atomically(&path, |out| Ok(out.write_all(&bytes)?));
        make_room(folder, MOST_BYTES);
    }
}

/// A number of an asset's name in steps of 1e-9: sines and cosines differ in their last digits from
/// system to system, and a browser reads what another computer has made.
fn rounded(number: f64) -> i64 {
    (number * f64::from(1 << 30)).round() as i64
}

/// Removes the oldest assets of a folder until the rest take `most` bytes or fewer.
fn make_room(folder: &Path, most: u64) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut files: Vec<(SystemTime, u64, PathBuf)> = entries
        .flatten()
        .filter(|entry| entry.path().extension().is_some_and(|extension| extension == EXTENSION))
        .filter_map(|entry| {
            let about = entry.metadata().ok()?;
            Some((about.modified().ok()?, about.len(), entry.path()))
        })
        .collect();
    files.sort();
    let mut total: u64 = files.iter().map(|(_, size, _)| size).sum();
    for (_, size, path) in files {
        if total <= most {
            break;
        }
        let _ = fs::remove_file(path);
        total -= size;
    }
}

/// The digest of all that prepared assets depend on: the scene, what is known of it, and who
/// renders its views.
pub(crate) fn scene_digest(scene: &Scene, survey: &Survey, arithmetic: &str) -> AssetDigest {
    let mut hash = Sha256::new();
    hash.update(VERSION.to_le_bytes());
    hash.update(env!("CARGO_PKG_VERSION"));
    hash.update(arithmetic);
    let splats = &scene.splats;
    hash.update((splats.len() as u64).to_le_bytes());
    hash.update([splats.sh_degree]);
    for numbers in [
        splats.means.as_flattened(),
        splats.quats.as_flattened(),
        splats.log_scales.as_flattened(),
        &splats.logit_opacities,
        &splats.sh,
    ] {
        let mut bytes = Vec::with_capacity(1 << 16);
        for part in numbers.chunks(1 << 14) {
            bytes.clear();
            part.iter().for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
            hash.update(&bytes);
        }
    }
    let groups: Vec<u8> = splats.groups.iter().map(|group| *group as u8).collect();
    hash.update(&groups);
    // Their `Debug` texts name every number to the last bit, and every field that is added later.
    for view in &scene.views {
        hash.update(format!("{:?}", view.camera));
    }
    // Lamps have assets of their own.
    let facts = Metadata { lamps: None, windows: None, ..scene.metadata.clone() };
    hash.update(format!("{facts:?} {survey:?}"));
    AssetDigest(hash.finalize().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cache(folder: &Path) -> AssetCache {
        AssetCache::new(Some(folder.join("a.assets")), AssetDigest([7; 32]))
    }

    fn file(direction: [f64; 3]) -> AssetFile {
        AssetFile { word: "sun", numbers: direction.to_vec() }
    }

    #[test]
    fn damaged_and_foreign_files_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let (cache, file) = (cache(folder.path()), file([0.0, 0.0, -1.0]));
        assert_eq!(cache.get::<Vec<f32>>(&file), None);
        let asset = vec![1.5f32, f32::NEG_INFINITY, -0.0];
        cache.put(file.clone(), &asset);
        assert_eq!(cache.get::<Vec<f32>>(&file), Some(asset.clone()));
        let other = AssetCache::new(cache.folder.clone(), AssetDigest([8; 32]));
        assert_eq!(other.get::<Vec<f32>>(&file), None);
        assert_eq!(cache.get::<Vec<f32>>(&self::file([0.0, 1.0, 0.0])), None);
        let (path, _) = cache.entry(&file).unwrap();
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            fs::write(&path, &bytes).unwrap();
            assert_eq!(cache.get::<Vec<f32>>(&file), None, "byte {at}");
            fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(cache.get::<Vec<f32>>(&file), None, "cut at {at}");
        }
        // It is replaced.
        cache.put(file.clone(), &asset);
        assert_eq!(cache.get::<Vec<f32>>(&file), Some(asset));
    }

    #[test]
    fn last_digits_of_directions_do_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let cache = cache(folder.path());
        let sun = [0.48, 0.6, 0.64];
        cache.put(file(sun), &1u8);
        let near = sun.map(|v: f64| v.next_up());
        assert_eq!(cache.get::<u8>(&file(near)), Some(1));
        assert_eq!(cache.get::<u8>(&file([0.48, 0.6, 0.640_001])), None);
    }

    #[test]
    fn the_oldest_files_make_room() {
        let folder = tempfile::tempdir().unwrap();
        for (name, age) in [("old", 30), ("new", 10), ("middle", 20)] {
            let path = folder.path().join(format!("{name}.{EXTENSION}"));
            fs::write(&path, [0; 100]).unwrap();
            let then = SystemTime::now() - std::time::Duration::from_secs(age);
            fs::File::options().write(true).open(&path).unwrap().set_modified(then).unwrap();
        }
        fs::write(folder.path().join("notes.txt"), [0; 1000]).unwrap();
        make_room(folder.path(), 200);
        let is_there = |name: &str| folder.path().join(name).exists();
        assert!(!is_there("old.wmasset") && is_there("middle.wmasset") && is_there("new.wmasset"));
        assert!(is_there("notes.txt"));
    }

    #[test]
    fn the_folder_stands_beside_the_scene() {
        assert_eq!(AssetCache::folder_of(Path::new("a/place.ply")), Path::new("a/place.ply.assets"));
    }
}
