//! Files that appear whole or not at all: written beside their final name, then renamed.
//!
//! The temporary file lies in the same directory, since a rename is only atomic within one file
//! system. It is called `<name>.<process>-<count>.part` and is removed when writing fails. Nothing is
//! flushed to the disk by force: thousands of frames would wait for it, and a power cut costs only
//! the last ones.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicU64, Ordering};

use super::MediaError;

/// Buffer of a file that is written in small pieces, bytes.
const BUFFER: usize = 1 << 18;

/// Writes a file through `fill` and puts it under `path` when `fill` succeeds.
///
/// # Errors
/// Whatever `fill` returns, and the system's refusals; nothing is left behind then, and a file that
/// was under `path` before is untouched.
pub fn write<F>(path: &Path, fill: F) -> Result<(), MediaError>
where
    F: FnOnce(&mut BufWriter<&File>) -> Result<(), MediaError>,
{
    let temp = TempFile::beside(path)?;
    let mut buffered = BufWriter::with_capacity(BUFFER, temp.file());
    fill(&mut buffered)?;
    buffered.flush().map_err(|source| MediaError::io(path, "write", source))?;
    drop(buffered);
    temp.persist()
}

/// A new empty file beside `target`, open for reading and writing; removed when dropped.
#[derive(Debug)]
pub struct TempFile {
    /// `None` once it has its final name.
    path: Option<PathBuf>,
    /// `None` once closed.
    file: Option<File>,
    /// The name it is meant for, as it was given: what errors show.
    target: PathBuf,
    /// The same behind symbolic links: what is renamed to.
    resolved: PathBuf,
}

impl TempFile {
    /// Creates it.
    ///
    /// # Errors
    /// `target` is a directory, a device or a pipe; its directory is missing or not writable; the
    /// disk is full.
    pub fn beside(target: &Path) -> Result<Self, MediaError> {
        let resolved = resolve(target)?;
        let directory = directory_of(&resolved);
        let name =
            resolved.file_name().ok_or_else(|| MediaError::IsDirectory { path: target.to_path_buf() })?;
        // A counter makes names unique in this process, its number among processes; what is left are
        // leftovers of a killed process of the same number, which are stepped over.
        static COUNT: AtomicU64 = AtomicU64::new(0);
        loop {
            let mut temp_name = name.to_os_string();
            temp_name.push(format!(".{}-{}.part", process::id(), COUNT.fetch_add(1, Ordering::Relaxed)));
            let path = resolved.with_file_name(temp_name);
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => {
                    return Ok(Self {
                        path: Some(path),
                        file: Some(file),
                        target: target.to_path_buf(),
                        resolved,
                    });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) if error.kind() == ErrorKind::NotFound && !directory.is_dir() => {
                    return Err(MediaError::MissingDirectory {
                        path: target.to_path_buf(),
                        directory: directory.to_path_buf(),
                    });
                }
                Err(error) => return Err(MediaError::io(target, "create", error)),
            }
        }
    }

    /// The open file, empty and at its start at first.
    #[must_use]
    pub fn file(&self) -> &File {
        self.file.as_ref().expect("open until it is closed, renamed or dropped")
    }

    /// Where it lies now, for another program to write into.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.path.as_deref().expect("there until it is renamed or dropped")
    }

    /// The name it is meant for.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Gives it its final name, replacing what was there.
    ///
    /// # Errors
    /// The system's refusals; the temporary file is removed then.
    pub fn persist(mut self) -> Result<(), MediaError> {
        self.rename()
    }

    /// [`TempFile::persist`] for an owner that is dropped itself; only once.
    ///
    /// # Errors
    /// As there.
    pub fn rename(&mut self) -> Result<(), MediaError> {
        self.file = None;
        fs::rename(self.path(), &self.resolved).map_err(|source| {
            // Windows says "denied" where Unix says "is a directory".
            if self.resolved.is_dir() {
                MediaError::IsDirectory { path: self.target.clone() }
            } else {
                MediaError::io(&self.target, "rename", source)
            }
        })?;
        self.path = None;
        Ok(())
    }
}

impl Drop for TempFile {
    fn drop(&mut self) {
        // Closed first: Windows does not remove open files.
        self.file = None;
        if let Some(path) = self.path.take() {
            // Nothing sensible is left to do about a refusal here.
            let _ = fs::remove_file(path);
        }
    }
}

/// The file behind `target` if it is a symbolic link, else `target`; an error if it is something that
/// must not be replaced.
fn resolve(target: &Path) -> Result<PathBuf, MediaError> {
    let path = || target.to_path_buf();
    match fs::metadata(target) {
        Ok(found) if found.is_dir() => Err(MediaError::IsDirectory { path: path() }),
        Ok(found) if !found.is_file() => Err(MediaError::NotRegular { path: path() }),
        // A rename replaces the link instead of the file it leads to.
        Ok(_) if target.is_symlink() => {
            fs::canonicalize(target).map_err(|source| MediaError::io(target, "follow the link", source))
        }
        // A path that cannot be looked at fails again, with its reason, when the file is created.
        _ => Ok(path()),
    }
}

fn directory_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn write_text(path: &Path, text: &str) -> Result<(), MediaError> {
        write(path, |out| {
            out.write_all(text.as_bytes()).map_err(|source| MediaError::io(path, "write", source))
        })
    }

    #[test]
    fn replaces_a_file_and_leaves_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.txt");
        write_text(&path, "one").unwrap();
        write_text(&path, "two").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(names(directory.path()), ["a.txt"]);
    }

    #[test]
    fn a_failed_write_keeps_the_old_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.txt");
        write_text(&path, "one").unwrap();
        let error = write(&path, |out| {
            out.write_all(b"half").unwrap();
            Err(MediaError::DiskFull { path: path.clone() })
        });
        assert!(matches!(error, Err(MediaError::DiskFull { .. })));
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
        assert_eq!(names(directory.path()), ["a.txt"]);
    }

    #[test]
    fn a_panic_removes_the_temporary_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.txt");
        let result = std::panic::catch_unwind(|| write(&path, |_| panic!("in the middle")));
        assert!(result.is_err());
        assert_eq!(names(directory.path()), [] as [&str; 0]);
    }

    #[test]
    fn says_in_one_line_what_is_wrong() {
        let directory = tempfile::tempdir().unwrap();
        let missing = write_text(&directory.path().join("no/a.txt"), "").unwrap_err();
        assert!(matches!(missing, MediaError::MissingDirectory { .. }), "{missing}");
        let is_directory = write_text(directory.path(), "").unwrap_err();
        assert!(matches!(is_directory, MediaError::IsDirectory { .. }), "{is_directory}");
        let full = MediaError::io(Path::new("a"), "write", ErrorKind::StorageFull.into());
        assert!(matches!(full, MediaError::DiskFull { .. }), "{full}");
        let denied = MediaError::io(Path::new("a"), "write", ErrorKind::PermissionDenied.into());
        assert!(matches!(denied, MediaError::NotWritable { .. }), "{denied}");
        let through_a_file = directory.path().join("file");
        fs::write(&through_a_file, "").unwrap();
        let not_a_directory = write_text(&through_a_file.join("a.txt"), "").unwrap_err();
        for error in [missing, is_directory, full, denied, not_a_directory] {
            assert!(!error.to_string().contains('\n'), "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn follows_links_and_spares_devices() {
        let directory = tempfile::tempdir().unwrap();
        let real = directory.path().join("real.txt");
        let link = directory.path().join("link.txt");
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_text(&link, "new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&real).unwrap(), "new");
        let device = write_text(Path::new("/dev/null"), "").unwrap_err();
        assert!(matches!(device, MediaError::NotRegular { .. }), "{device}");
    }
}
