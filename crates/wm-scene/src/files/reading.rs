//! The one way in which files of scenes are read: from the disk, or where there is none from those that were fetched.

use super::fetched;
use std::{
    fs::{self, File},
    io::{self, ErrorKind, Read},
    path::Path,
    sync::Arc,
};

/// A file that is open, and its length where that is known.
pub(crate) struct Opened {
    pub reader: Box<dyn Read>,
    pub length: Option<u64>,
}

/// The disk or the store of fetched files, one of which has a path.
enum Place {
    Disk,
    /// In the store of fetched files, with the content of the file if it is there.
    Store(Option<Arc<[u8]>>),
}

fn place_of(path: &Path) -> Place {
    if fetched::has(path) { Place::Store(fetched::get(path)) } else { Place::Disk }
}

/// Notes that a fetched file is wanted.
fn lacking<T>(path: &Path) -> io::Result<T> {
    fetched::want(path);
    Err(not_fetched())
}

fn not_fetched() -> io::Error {
    io::Error::new(ErrorKind::NotFound, "it is not fetched yet")
}

/// Reads a whole file.
///
/// # Errors
/// Those of the system; [`ErrorKind::NotFound`] of a file that was not fetched, which is noted as wanted.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    match place_of(path) {
        Place::Disk => fs::read(path),
        Place::Store(file) => file.map_or_else(|| lacking(path), |bytes| Ok(bytes.to_vec())),
    }
}

/// Reads a whole file that need not be there: `None` then, and nothing is noted.
///
/// # Errors
/// Those of the system.
pub fn read_if_there(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match place_of(path) {
        Place::Disk => match fs::read(path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        },
        Place::Store(file) => Ok(file.map(|bytes| bytes.to_vec())),
    }
}

/// Opens a file.
///
/// # Errors
/// As [`read`].
pub(crate) fn open(path: &Path) -> io::Result<Opened> {
    match place_of(path) {
        Place::Disk => {
            let file = File::open(path)?;
            let about = file.metadata()?;
            // Pipes have no length, and files that the kernel makes up say 0.
            let length = (about.is_file() && about.len() > 0).then_some(about.len());
            Ok(Opened { reader: Box::new(file), length })
        }
        Place::Store(None) => lacking(path),
        Place::Store(Some(bytes)) => {
            let length = Some(bytes.len() as u64).filter(|length| *length > 0);
            Ok(Opened { reader: Box::new(io::Cursor::new(bytes)), length })
        }
    }
}

/// Returns true if a path is a folder, false if it is something else.
///
/// # Errors
/// As [`read`] where there is nothing.
pub fn is_folder(path: &Path) -> io::Result<bool> {
    match place_of(path) {
        Place::Disk => Ok(fs::metadata(path)?.is_dir()),
        Place::Store(Some(_)) => Ok(false),
        Place::Store(None) if fetched::is_folder(path) => Ok(true),
        Place::Store(None) => lacking(path),
    }
}

/// Returns true if a path is a regular file, false if it is something else.
///
/// # Errors
/// Those of the system; [`ErrorKind::NotFound`] of a file that was not fetched. Nothing is noted.
pub fn is_file(path: &Path) -> io::Result<bool> {
    match place_of(path) {
        Place::Disk => Ok(fs::metadata(path)?.is_file()),
        Place::Store(Some(_)) => Ok(true),
        Place::Store(None) if fetched::is_folder(path) => Ok(false),
        Place::Store(None) => Err(not_fetched()),
    }
}

/// Returns true if there is a file or a folder with a path. Nothing is noted.
#[must_use]
pub fn is_there(path: &Path) -> bool {
    match place_of(path) {
        Place::Disk => path.exists(),
        Place::Store(file) => file.is_some() || fetched::is_folder(path),
    }
}

/// Returns true if a file has to be fetched before it can be read. Nothing is noted.
#[must_use]
pub fn is_lacking(path: &Path) -> bool {
    matches!(place_of(path), Place::Store(None))
}

/// Notes that a file has to be fetched, if it does.
pub fn want(path: &Path) {
    if is_lacking(path) {
        fetched::want(path);
    }
}
