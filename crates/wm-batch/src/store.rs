//! The files of a set on disk: blocks are made in a folder of their own, put in place whole, and
//! marked as done.
//!
//! A marker is written last. So a block without one is made again, from the beginning, and a second
//! run gives the same bytes.

use crate::{ClipInfo, FileSink, PlaceInfo, ReadingInfo, SetError, WeatherInfo};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use wm_base::files::{WriteFault, lock_folder, rename, write_durably, write_staged};
use wm_place::{Error, Result};
use wm_scene::levels::INDEX_NAME;

/// The folder of markers.
const MARKER_FOLDER: &str = "done";
/// The folder in which blocks are made.
const WORK_FOLDER: &str = ".work";
/// Longest marker that is read, bytes.
const MAX_MARKER_BYTES: u64 = 1 << 30;

/// The folder of a set.
#[derive(Clone, Debug)]
pub struct BatchStore {
    folder: PathBuf,
}

/// The marker of a block: its clips and its files.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct BlockMarker {
    /// The number of the block.
    pub(crate) block: u64,
    /// The digest of the plan.
    pub(crate) plan: String,
    /// The device and the instructions that drew it.
    pub(crate) renderer: String,
    /// The name of the scene.
    pub(crate) scene: String,
    /// The SHA-256 of the scene's file.
    pub(crate) scene_sha256: String,
    /// The clips of the block, or their parts.
    pub(crate) clips: Vec<MarkedClip>,
    /// The files of the block, in the order of their paths.
    pub(crate) files: Vec<MarkedFile>,
}

/// A file of a set.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MarkedFile {
    /// From the folder of the set, with `/` between its parts.
    pub(crate) path: String,
    /// The length.
    pub(crate) bytes: u64,
    /// The SHA-256, in hexadecimal digits.
    pub(crate) sha256: String,
}

impl MarkedFile {
    fn new(path: String, bytes: &[u8]) -> Self {
        Self { path, bytes: bytes.len() as u64, sha256: hex(&Sha256::digest(bytes)) }
    }
}

/// A clip, or a part of one, in a marker. The fields of a [`ClipInfo`] are named here, as serde
/// refuses unknown fields beside one level of flattened structs, not two.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MarkedClip {
    number: u64,
    name: String,
    split: String,
    start: i64,
    seconds: f64,
    #[serde(flatten)]
    place: PlaceInfo,
    #[serde(flatten)]
    weather: WeatherInfo,
    /// The time of the weather at which the clip begins, s.
    pub(crate) at: f64,
    /// The values of what is varied.
    pub(crate) variables: BTreeMap<String, f64>,
    pub(crate) readings: Vec<ReadingInfo>,
}

impl MarkedClip {
    /// A clip with some of its readings.
    pub(crate) fn new(
        clip: ClipInfo,
        at: f64,
        variables: BTreeMap<String, f64>,
        readings: Vec<ReadingInfo>,
    ) -> Self {
        let ClipInfo { number, name, split, start, seconds, place, weather } = clip;
        Self { number, name, split, start, seconds, place, weather, at, variables, readings }
    }

    /// The clip.
    pub(crate) fn clip(&self) -> ClipInfo {
        ClipInfo {
            number: self.number,
            name: self.name.clone(),
            split: self.split.clone(),
            start: self.start,
            seconds: self.seconds,
            place: self.place.clone(),
            weather: self.weather.clone(),
        }
    }
}

fn fault(path: &Path, says: impl std::fmt::Display) -> Error {
    Error::Unsupported(format!("{}: {says}", path.display()))
}

impl BatchStore {
    /// The set in a folder, which is made.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the folder cannot be made.
    pub fn new(folder: &Path) -> Result<Self> {
        let store = Self { folder: folder.into() };
        let done = folder.join(MARKER_FOLDER);
        fs::create_dir_all(&done).map_err(|error| fault(&done, error))?;
        Ok(store)
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn marker_path(&self, block: u64) -> PathBuf {
        self.folder.join(MARKER_FOLDER).join(format!("{block:06}.json"))
    }

    /// The marker of a block; `None` if it is not done, or its marker is damaged, as a power cut
    /// may leave it: the block is made again then.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the marker cannot be read, or is of another plan.
    pub fn marker(&self, block: u64, plan: &str) -> Result<Option<BlockMarker>> {
        let path = self.marker_path(block);
        let text = match fs::metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Ok(about) if about.len() > MAX_MARKER_BYTES => return Ok(None),
            _ => fs::read(&path).map_err(|error| fault(&path, error))?,
        };
        let Ok(marker) = serde_json::from_slice::<BlockMarker>(&text) else { return Ok(None) };
        if marker.plan != plan || marker.block != block {
            let says = "is of another plan; give another folder with --out, or remove this one";
            return Err(fault(&path, says));
        }
        Ok(Some(marker))
    }

    /// The first file of a block that is not there as its marker says, by name and length.
    #[must_use]
    pub fn lost_file<'a>(&self, marker: &'a BlockMarker) -> Option<&'a str> {
        let is_there = |file: &&MarkedFile| {
            fs::metadata(self.folder.join(&file.path)).is_ok_and(|about| about.len() == file.bytes)
        };
        marker.files.iter().find(|file| !is_there(file)).map(|file| file.path.as_str())
    }

    /// Removes what killed runs left, once all blocks are done.
    pub(crate) fn clean(&self) {
        // What cannot be removed does no harm.
        let _ = fs::remove_dir_all(self.folder.join(WORK_FOLDER));
    }

    /// Begins a block: what a run left of it before is removed.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if its folder cannot be made, or another process makes the block.
    pub(crate) fn begin(&self, block: u64) -> Result<BlockFiles> {
        let staged = self.folder.join(WORK_FOLDER).join(format!("{block:06}"));
        let lock = || {
            lock_folder(&staged).map_err(|error| match error.kind() {
                ErrorKind::WouldBlock => fault(
                    &self.folder,
                    format!(
                        "another process makes block {block}; wait until it is done, or make another shard"
                    ),
                ),
                _ => fault(&staged, error),
            })
        };
        if staged.exists() {
            let _old = lock()?;
            fs::remove_dir_all(&staged).map_err(|error| fault(&staged, error))?;
        }
        fs::create_dir_all(&staged).map_err(|error| fault(&staged, error))?;
        let lock = lock()?;
        Ok(BlockFiles { staged, folder: self.folder.clone(), files: Vec::new(), _lock: lock })
    }

    /// Puts the files of a block in place and marks it as done.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if a file cannot be moved.
    pub(crate) fn finish(&self, block: BlockFiles, mut marker: BlockMarker) -> Result<()> {
        marker.files = self.place(block)?;
        let path = self.marker_path(marker.block);
        let text = serde_json::to_string(&marker).map_err(|error| fault(&path, error))?;
        Ok(write_durably(&path, |out| Ok(writeln!(out, "{text}")?))?)
    }

    /// Puts the files of a block in place; returns them in the order of their paths.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if a file cannot be moved.
    pub(crate) fn place(&self, block: BlockFiles) -> Result<Vec<MarkedFile>> {
        let mut files = block.files;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        for file in &files {
            let (from, to) = (block.staged.join(&file.path), self.folder.join(&file.path));
            // On the disk before the marker says so.
            let opened = fs::OpenOptions::new().write(true).open(&from);
            opened.and_then(|file| file.sync_all()).map_err(|error| fault(&to, WriteFault::from(error)))?;
            make_folder_of(&to)?;
            rename(&from, &to).map_err(|error| fault(&to, WriteFault::from(error)))?;
        }
        fs::remove_dir_all(&block.staged).map_err(|error| fault(&block.staged, error))?;
        // Gone with the last block of all that are being made.
        let _ = fs::remove_dir(self.folder.join(WORK_FOLDER));
        Ok(files)
    }
}

/// The files of a block while it is made.
#[derive(Debug)]
pub(crate) struct BlockFiles {
    staged: PathBuf,
    folder: PathBuf,
    files: Vec<MarkedFile>,
    /// Keeps other processes out of the folder.
    _lock: Option<fs::File>,
}

impl BlockFiles {
    /// The path at which a file is made; `path` is from the folder of the set.
    ///
    /// # Errors
    /// [`SetError::Write`] if its folder cannot be made.
    pub(crate) fn path(&self, path: &str) -> Result<PathBuf, SetError> {
        let staged = self.staged.join(path);
        make_folder_of(&staged)?;
        Ok(staged)
    }

    /// Counts a file that was made at [`Self::path`].
    ///
    /// # Errors
    /// [`Error::Unsupported`] if it cannot be read.
    pub(crate) fn add(&mut self, path: &str) -> Result<()> {
        let staged = self.staged.join(path);
        let (bytes, sha256) = digest_of(&staged)?;
        self.files.push(MarkedFile { path: path.into(), bytes, sha256 });
        Ok(())
    }

    /// Writes a file of bytes; `path` is from the folder of the set.
    ///
    /// # Errors
    /// [`SetError::Write`] if it cannot be written.
    pub(crate) fn bytes_of(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError> {
        let staged = self.path(path)?;
        write_staged(&staged, bytes).map_err(|error| SetError::Write {
            path: self.folder.join(path),
            problem: WriteFault::from(error).to_string(),
        })?;
        self.files.push(MarkedFile::new(path.into(), bytes));
        Ok(())
    }

    /// Their length so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes).sum()
    }

    /// A layout's part of the files.
    pub(crate) fn layout<'a>(&'a mut self, name: &'a str) -> LayoutFiles<'a> {
        LayoutFiles { files: self, name }
    }
}

/// The files of a layout in a block.
#[derive(Debug)]
pub(crate) struct LayoutFiles<'a> {
    files: &'a mut BlockFiles,
    name: &'a str,
}

impl FileSink for LayoutFiles<'_> {
    fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError> {
        self.files.bytes_of(&format!("{}/{path}", self.name), bytes)
    }
}

/// Makes the folder of a file.
fn make_folder_of(path: &Path) -> Result<(), SetError> {
    let Some(folder) = path.parent() else { return Ok(()) };
    fs::create_dir_all(folder)
        .map_err(|error| SetError::Write { path: folder.into(), problem: error.to_string() })
}

/// The tables of a layout, which are written when all blocks are done.
#[derive(Debug)]
pub(crate) struct TableFiles<'a> {
    /// The folder of the set.
    pub(crate) folder: &'a Path,
    /// The layout.
    pub(crate) name: &'a str,
    /// The files that were written.
    pub(crate) files: Vec<MarkedFile>,
}

impl FileSink for TableFiles<'_> {
    fn write(&mut self, path: &str, bytes: &[u8]) -> Result<(), SetError> {
        let path = format!("{}/{path}", self.name);
        let own = self.folder.join(&path);
        make_folder_of(&own)?;
        wm_base::files::write_atomically(&own, |out| Ok(out.write_all(bytes)?))?;
        self.files.push(MarkedFile::new(path, bytes));
        Ok(())
    }
}

/// Writes bytes as hexadecimal digits.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The length and the SHA-256 of a file.
///
/// # Errors
/// [`Error::Unsupported`] if it cannot be read.
pub(crate) fn digest_of(path: &Path) -> Result<(u64, String)> {
    let mut file = fs::File::open(path).map_err(|error| fault(path, error))?;
    let (mut hash, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 16]);
    loop {
        let count = file.read(&mut buffer).map_err(|error| fault(path, error))?;
        if count == 0 {
            return Ok((bytes, hex(&hash.finalize())));
        }
        hash.update(&buffer[..count]);
        bytes += count as u64;
    }
}

/// The end of the names of folders with what is found of a scene: they grow while a set is made,
/// also within the folder of a scene.
const ASSET_FOLDER_SUFFIX: &str = ".assets";

/// The SHA-256 of a scene: of its file, or of the files of its folder in the order of their names,
/// but for those in `*.assets`. A file that only names others, such as `lod-meta.json`, stands for
/// its folder.
///
/// # Errors
/// [`Error::Unsupported`] if one cannot be read.
pub fn scene_digest_of(path: &Path) -> Result<String> {
    let names_others = [INDEX_NAME, "meta.json"].map(OsStr::new);
    let folder = match path.parent() {
        _ if path.is_dir() => path,
        Some(folder) if path.file_name().is_some_and(|name| names_others.contains(&name)) => folder,
        _ => return Ok(digest_of(path)?.1),
    };
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).map_err(|error| fault(&folder, error))? {
            let path = entry.map_err(|error| fault(&folder, error))?.path();
            let is_assets =
                path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(ASSET_FOLDER_SUFFIX));
            match path.is_dir() {
                true if is_assets => {}
                true => folders.push(path),
                false => files.push(path),
            }
        }
    }
    files.sort();
    let mut hash = Sha256::new();
    for file in &files {
        hash.update(digest_of(file)?.1);
    }
    Ok(hex(&hash.finalize()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_of_a_marker_has_the_known_fields_alone() {
        let [hazy, mut clear] = crate::testing::clips();
        clear.weather.mor = f64::INFINITY;
        for clip in [hazy, clear] {
            let marked = MarkedClip::new(clip, 0.0, BTreeMap::new(), Vec::new());
            let text = serde_json::to_string(&marked).unwrap();
            let read: MarkedClip = serde_json::from_str(&text).unwrap();
            assert_eq!(serde_json::to_string(&read).unwrap(), text);
            let other = text.replacen('{', "{\"other\":1,", 1);
            assert!(serde_json::from_str::<MarkedClip>(&other).is_err(), "{other}");
        }
    }
}
