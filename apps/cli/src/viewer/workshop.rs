//! The viewer's folder of temporary files: readable by its user alone, and removed at the next
//! start of a viewer if this one is killed.

use super::locked::locked;
use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::sync::Mutex;
use tempfile::{Builder, TempDir};

/// The start of the folder's name.
const PREFIX: &str = "weather-magician-view-";
/// A file in the folder that is locked while its viewer lives. A number of a process would not do:
/// containers that share a folder have the same numbers.
const LOCK: &str = "lock";

/// The folder, which is created when it is first needed.
#[derive(Default)]
pub(crate) struct Workshop(Mutex<Option<OpenWorkshop>>);

struct OpenWorkshop {
    // Dropped first: some systems do not remove a file that is open.
    _lock: File,
    folder: TempDir,
}

impl Workshop {
    /// Creates the folder, and removes those of viewers that were killed.
    ///
    /// # Errors
    /// In one line: the system refuses to create it.
    pub(crate) fn open(&self) -> Result<(), String> {
        self.subfolder().map(drop)
    }

    /// Returns a new folder inside it.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(crate) fn subfolder(&self) -> Result<TempDir, String> {
        let mut open = locked(&self.0);
        let inside = |parent: &Path| folder_in(parent, "");
        let parent = std::env::temp_dir();
        let made = match &*open {
            Some(workshop) => inside(workshop.folder.path()),
            None => OpenWorkshop::create(&parent).and_then(|workshop| {
                sweep(&parent, workshop.folder.path());
                inside(open.insert(workshop).folder.path())
            }),
        };
        made.map_err(|error| {
            let parent = parent.display();
            format!("cannot create a temporary folder in {parent}: {error}; name another with TMPDIR")
        })
    }

    /// Removes the folder with all that is in it.
    pub(crate) fn clear(&self) {
        locked(&self.0).take();
    }
}

impl OpenWorkshop {
    fn create(parent: &Path) -> io::Result<Self> {
        let folder = folder_in(parent, PREFIX)?;
        // It has its name once it is locked, so that nobody takes this folder for one that was
        // left.
        let path = folder.path().join(LOCK);
        let unlocked = path.with_extension("new");
        let lock = File::create(&unlocked)?;
        lock.lock()?;
        fs::rename(unlocked, path)?;
        Ok(Self { _lock: lock, folder })
    }
}

/// Creates a folder that no other user can look into.
fn folder_in(parent: &Path, prefix: &str) -> io::Result<TempDir> {
    let mut builder = Builder::new();
    builder.prefix(prefix);
    #[cfg(unix)]
    builder.permissions(<fs::Permissions as std::os::unix::fs::PermissionsExt>::from_mode(0o700));
    builder.tempdir_in(parent)
}

/// Removes the folders in `parent` whose viewers are gone and which belong to the user that `own`
/// belongs to.
fn sweep(parent: &Path, own: &Path) {
    let Ok(entries) = fs::read_dir(parent) else { return };
    for entry in entries.filter_map(Result::ok) {
        let path = entry.path();
        let is_named = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX));
        if is_named && path != own && has_same_owner(&path, own) && is_left(&path) {
            // What cannot be removed stays; there is nobody to be told.
            let _ = fs::remove_dir_all(path);
        }
    }
}

/// Returns true if a folder, which is no link, belongs to the owner of another: that of others may
/// be made to mislead.
fn has_same_owner(path: &Path, own: &Path) -> bool {
    let (Ok(one), Ok(other)) = (fs::symlink_metadata(path), fs::symlink_metadata(own)) else { return false };
    #[cfg(unix)]
    let is_owned = std::os::unix::fs::MetadataExt::uid(&one) == std::os::unix::fs::MetadataExt::uid(&other);
    #[cfg(not(unix))]
    let is_owned = other.is_dir();
    one.is_dir() && is_owned
}

/// Returns true if nobody holds the lock of a folder.
fn is_left(folder: &Path) -> bool {
    File::options().write(true).open(folder.join(LOCK)).is_ok_and(|file| file.try_lock().is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_the_dead_are_swept_and_no_others() {
        let parent = tempfile::tempdir().unwrap();
        let parent = parent.path();
        let living = OpenWorkshop::create(parent).unwrap();
        let dead = OpenWorkshop::create(parent).unwrap();
        let left = dead.folder.keep();
        fs::write(left.join("video.mp4"), "a part").unwrap();
        drop(dead._lock);
        // Not ours: without a lock, a file, a link.
        for name in ["weather-magician-view-new", "weather-magician"] {
            fs::create_dir(parent.join(name)).unwrap();
        }
        fs::write(parent.join("weather-magician-view-file"), "").unwrap();
        #[cfg(unix)]
        std::os::unix::fs::symlink(parent, parent.join("weather-magician-view-link")).unwrap();
        let before = fs::read_dir(parent).unwrap().count();
        let own = OpenWorkshop::create(parent).unwrap();
        sweep(parent, own.folder.path());
        assert!(!left.exists() && living.folder.path().exists() && own.folder.path().exists());
        assert_eq!(fs::read_dir(parent).unwrap().count(), before);
    }

    #[test]
    #[cfg(unix)]
    fn nobody_else_looks_into_it() {
        use std::os::unix::fs::PermissionsExt;
        let workshop = Workshop::default();
        let inner = workshop.subfolder().unwrap();
        for folder in [inner.path(), inner.path().parent().unwrap()] {
            assert_eq!(fs::metadata(folder).unwrap().permissions().mode() & 0o777, 0o700, "{folder:?}");
        }
        let path = inner.path().to_owned();
        workshop.clear();
        assert!(!path.exists());
    }
}
