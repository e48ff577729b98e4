//! A cache of embeddings: an NPY file that any program reads, and beside it a JSON file with the
//! pictures of its rows. A row is reused if the network and the picture's name, size and
//! modification time are the same.

use crate::names::with_behind;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, UNIX_EPOCH};
use wm_base::files::write_atomically;
use wm_base::npy;

/// Longest time before new embeddings are written.
const MAX_WRITE_INTERVAL: Duration = Duration::from_secs(30);

/// The index of an array of embeddings: the pictures of its rows.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Index {
    /// Identity of the network.
    identity: u64,
    /// Hash of the array's numbers: the rows are only used if both files were written together.
    checksum: u64,
    pictures: Vec<CachedPicture>,
}

/// The identity of a picture.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CachedPicture {
    file: PathBuf,
    bytes: u64,
    /// Nanoseconds since 1970.
    modified: u64,
}

impl CachedPicture {
    fn of(file: &Path) -> Result<Self> {
        let about = fs::metadata(file).with_context(|| format!("{}: cannot be read", file.display()))?;
        let modified = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let modified = modified.map_or(0, |time| time.as_nanos() as u64);
        Ok(Self { file: std::path::absolute(file)?, bytes: about.len(), modified })
    }
}

/// Embeddings of one picture set.
pub(crate) struct EmbeddingCache {
    /// Path of the files without extension; `None` if nothing is kept.
    path: Option<PathBuf>,
    identity: u64,
    width: usize,
    /// Embeddings of an earlier run, by picture.
    before: HashMap<CachedPicture, Vec<f32>>,
    /// Embeddings of this set, in its order.
    pictures: Vec<CachedPicture>,
    values: Vec<f32>,
    /// True if all of them are on disk.
    is_kept: bool,
    written: Instant,
}

/// The suffix of the files of an unfinished set.
pub(crate) const UNFINISHED: &str = "unfinished";

impl EmbeddingCache {
    /// Reads the file if it exists. A file of other embeddings is ignored until it is overwritten.
    pub(crate) fn open(path: Option<PathBuf>, identity: u64, width: usize) -> Result<Self> {
        let mut before = HashMap::new();
        if let Some(path) = &path {
            for path in [path.clone(), named(path, UNFINISHED)] {
                before.extend(read(&path, identity, width).unwrap_or_default());
            }
            let folder = path.parent().unwrap_or(path);
            fs::create_dir_all(folder).with_context(|| format!("{}: cannot be created", folder.display()))?;
        }
        Ok(Self {
            path,
            identity,
            width,
            before,
            pictures: Vec::new(),
            values: Vec::new(),
            is_kept: true,
            written: Instant::now(),
        })
    }

    /// Adds the embedding of a file; computes it if it is not in the cache.
    pub(crate) fn add(&mut self, file: &Path, make: impl FnOnce() -> Result<Vec<f32>>) -> Result<()> {
        let picture = CachedPicture::of(file)?;
        match self.before.get(&picture) {
            Some(row) => self.values.extend(row),
            None => {
                self.values.extend(make()?);
                self.is_kept = false;
            }
        }
        self.pictures.push(picture);
        if self.written.elapsed() > MAX_WRITE_INTERVAL {
            self.keep()?;
        }
        Ok(())
    }

    /// Writes the embeddings so far and returns the path.
    pub(crate) fn keep(&mut self) -> Result<Option<PathBuf>> {
        let Some(path) = &self.path else { return Ok(None) };
        let path = named(path, UNFINISHED);
        if !self.is_kept {
            let (mut pictures, mut values) = (self.pictures.clone(), self.values.clone());
            // Embeddings of an earlier run whose pictures were not reached.
            let added: HashSet<&CachedPicture> = self.pictures.iter().collect();
            for (picture, row) in self.before.iter().filter(|(picture, _)| !added.contains(picture)) {
                pictures.push(picture.clone());
                values.extend(row);
            }
            self.write(&path, pictures, &values)?;
        }
        (self.is_kept, self.written) = (true, Instant::now());
        Ok(Some(named(&path, "npy")))
    }

    /// Writes and returns all embeddings, `[pictures, width]`.
    pub(crate) fn finish(self) -> Result<Vec<f32>> {
        if let Some(path) = &self.path {
            self.write(path, self.pictures.clone(), &self.values)?;
            for extension in ["npy", "json"] {
                // There may be none.
                let _ = fs::remove_file(named(&named(path, UNFINISHED), extension));
            }
        }
        Ok(self.values)
    }

    fn write(&self, path: &Path, pictures: Vec<CachedPicture>, values: &[f32]) -> Result<()> {
        npy::write(&named(path, "npy"), values, &[pictures.len(), self.width])?;
        let index = Index { identity: self.identity, checksum: checksum(values), pictures };
        let text = serde_json::to_string(&index)?;
        Ok(write_atomically(&named(path, "json"), |out| Ok(writeln!(out, "{text}")?))?)
    }
}

/// Returns the cached rows, if they are complete and of this network.
fn read(path: &Path, identity: u64, width: usize) -> Option<HashMap<CachedPicture, Vec<f32>>> {
    let index: Index = serde_json::from_slice(&fs::read(named(path, "json")).ok()?).ok()?;
    let (values, shape) = npy::read(&named(path, "npy")).ok()?;
    let fits = shape == [index.pictures.len(), width]
        && index.identity == identity
        && index.checksum == checksum(&values);
    let rows = values.chunks_exact(width).map(<[f32]>::to_vec);
    fits.then(|| index.pictures.into_iter().zip(rows).collect())
}

/// Appends an extension to a path, whose name may contain dots.
fn named(path: &Path, extension: &str) -> PathBuf {
    with_behind(path, &format!(".{extension}"))
}

/// Returns the FNV-1a hash of the numbers' bits.
fn checksum(values: &[f32]) -> u64 {
    let step = |hash: u64, value: &f32| (hash ^ u64::from(value.to_bits())).wrapping_mul(0x0100_0000_01b3);
    values.iter().fold(0xcbf2_9ce4_8422_2325, step)
}
