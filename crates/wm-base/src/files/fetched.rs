//! Files in memory that stand for those of a disk, where there is none: what a page in a browser
//! fetched.
//!
//! Code that draws must not wait for a network. It reads what is here, does without what is not,
//! and notes the paths that it looked for: whoever fetches takes that list, inserts the files, and
//! draws again.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most paths that are noted; later ones are noted once the list was taken.
pub const MAX_WANTED: usize = 4096;

/// Paths below it are of this store where there is a disk, too: for tests.
pub const ROOT: &str = "fetched:";

struct Store {
    files: BTreeMap<PathBuf, Arc<[u8]>>,
    bytes: u64,
    wanted: Vec<PathBuf>,
}

static STORE: Mutex<Store> = Mutex::new(Store { files: BTreeMap::new(), bytes: 0, wanted: Vec::new() });

/// Locks the store, which stays valid if a thread panicked while it held the lock.
fn store() -> MutexGuard<'static, Store> {
    STORE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One path of several that lead to the same file.
fn plain(path: &Path) -> PathBuf {
    path.components().filter(|part| *part != Component::CurDir).collect()
}

impl Store {
    fn remove(&mut self, path: &Path) {
        if let Some(old) = self.files.remove(path) {
            self.bytes -= old.len() as u64;
        }
    }

    fn want(&mut self, path: PathBuf) {
        if self.wanted.len() < MAX_WANTED && !self.wanted.contains(&path) {
            self.wanted.push(path);
        }
    }
}

/// Returns true if files with this path are read from the store.
pub(super) fn has(path: &Path) -> bool {
    cfg!(target_arch = "wasm32") || cfg!(any(test, feature = "testing")) && path.starts_with(ROOT)
}

/// Adds a file, or replaces it; it is not wanted any more.
pub fn insert(path: &Path, bytes: impl Into<Arc<[u8]>>) {
    let (path, bytes, mut store) = (plain(path), bytes.into(), store());
    store.remove(&path);
    store.wanted.retain(|wanted| *wanted != path);
    store.bytes += bytes.len() as u64;
    store.files.insert(path, bytes);
}

/// Removes a file, if it is there.
pub fn remove(path: &Path) {
    store().remove(&plain(path));
}

/// Returns true if there is a file below a path.
pub(super) fn is_folder(path: &Path) -> bool {
    let (path, store) = (plain(path), store());
    let mut from = store.files.range(path.clone()..);
    // The path itself comes first, if it is a file.
    from.find(|(file, _)| **file != path).is_some_and(|(file, _)| file.starts_with(&path))
}

/// The paths of all files below a folder, in order.
#[must_use]
pub fn files_below(folder: &Path) -> Vec<PathBuf> {
    let folder = plain(folder);
    store().files.keys().filter(|path| path.starts_with(&folder)).cloned().collect()
}

/// Notes that a file is looked for, unless it is there or noted already.
pub fn want(path: &Path) {
    let (path, mut store) = (plain(path), store());
    if !store.files.contains_key(&path) {
        store.want(path);
    }
}

/// Takes the paths that were looked for and not there since the last call, in the order in which
/// they were looked for.
#[must_use]
pub fn take_wanted() -> Vec<PathBuf> {
    std::mem::take(&mut store().wanted)
}

/// Removes files, the first ones first, until no more than `most` bytes are left, and returns true
/// if that is so then.
pub fn keep_within(most: u64, spare: &[PathBuf]) -> bool {
    let mut store = store();
    for path in spare {
        if store.bytes <= most {
            break;
        }
        store.remove(&plain(path));
    }
    store.bytes <= most
}

/// The content of a file; `None` if it is not there.
pub(super) fn get(path: &Path) -> Option<Arc<[u8]>> {
    store().files.get(&plain(path)).cloned()
}
