//! Files that appear whole or not at all: written beside their final name, then renamed.
//!
//! The temporary file lies in the same folder, since a rename is only atomic within one file system.
//! It is called `<name>.<process>-<count>.part` and is removed when writing fails, and by
//! [`abandon_temporaries`] before the process is ended. Nothing is flushed to the disk by force, except by
//! [`write_durably`]: thousands of frames would wait for it, and a power cut costs only the last ones.

#[cfg(any(target_arch = "wasm32", test, feature = "testing"))]
pub mod fetched;
// Never used there: nothing is fetched where files are on a disk.
#[cfg(not(any(target_arch = "wasm32", test, feature = "testing")))]
#[allow(dead_code, unreachable_pub)]
mod fetched;
mod reading;

use crate::error::{FormatError, Problem};
pub(crate) use reading::{
    BYTE_ORDER_MARK, LFS_REFUSED, LONGEST_MARK, is_lfs_pointer, open, refused_text, without_byte_order_mark,
};
pub use reading::{
    is_file, is_folder, is_lacking, is_there, read, read_if_there, read_text, skip_byte_order_mark, text_of,
    want,
};
use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, ErrorKind, Write},
    path::{Path, PathBuf},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};
use thiserror::Error;

/// Buffer of a file that is written in small pieces, bytes.
const BUFFER: usize = 1 << 18;

/// The reason why a file cannot be written, and the remedy; printed after its path.
#[derive(Debug, Error)]
pub enum WriteFault {
    /// The folder to write into does not exist.
    #[error("cannot be written: the folder \"{}\" does not exist; create it first", .0.display())]
    NoFolder(PathBuf),
    /// A folder is in the place of the file.
    #[error("cannot be written: it is a folder; name a file in it")]
    IsFolder,
    /// A device, pipe or socket is in the place of the file: it cannot be replaced by renaming.
    #[error("cannot be written: it is not a regular file; choose another name")]
    NotRegular,
    /// There is a file that its owner protected.
    #[error("cannot be written: it is write-protected; choose another name")]
    Protected,
    /// No right to write there.
    #[error("cannot be written: {0}; change the rights of its folder or write elsewhere")]
    Denied(io::Error),
    /// No room.
    #[error("cannot be written: the disk is full; free some space or write elsewhere")]
    DiskFull,
    /// Anything else that the system refused.
    #[error("cannot be written: {0}; write elsewhere")]
    Other(io::Error),
}

impl From<io::Error> for WriteFault {
    fn from(error: io::Error) -> Self {
        use ErrorKind::{IsADirectory, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
        match error.kind() {
            StorageFull | QuotaExceeded => Self::DiskFull,
            PermissionDenied | ReadOnlyFilesystem => Self::Denied(error),
            IsADirectory => Self::IsFolder,
            _ => Self::Other(error),
        }
    }
}

/// Writes `path` whole or not at all; a reader sees the old file or the new one, never a part.
///
/// A link is followed, so that its target is replaced. A write-protected file is not replaced.
///
/// # Errors
/// [`FormatError`] with `path` if the folder is missing or refuses, or if `write` fails; `path` is left
/// as it was then, and nothing beside it.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    write_whole(path, |f| fault(f.into()), |out| write(out).map_err(fault))
}

/// Writes a file as [`write_atomically`] does, and returns once it is on the disk, so that a power cut leaves the old file or the
/// new one: for files that are worth hours, such as checkpoints.
///
/// # Errors
/// Those of [`write_atomically`].
pub fn write_durably(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    let temporary = written(path, |f| fault(f.into()), |out| write(out).map_err(fault))?;
    temporary.file().sync_all().map_err(|error| fault(WriteFault::from(error).into()))?;
    let folder = folder_of(&temporary.resolved).to_owned();
    temporary.persist().map_err(|f| fault(f.into()))?;
    // The new name is in the folder, which some systems do not open as a file.
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Writes a file whole or not at all, as [`write_atomically`] does, with errors of another type; `fault` converts
/// those of the system.
///
/// # Errors
/// Those of `write`, and those of the system; then `path` is as it was.
pub fn write_whole<E>(
    path: &Path,
    fault: impl Fn(WriteFault) -> E,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<(), E> {
    written(path, &fault, write)?.persist().map_err(&fault)
}

/// Writes the temporary file of `path`.
fn written<E>(
    path: &Path,
    fault: impl Fn(WriteFault) -> E,
    write: impl FnOnce(&mut BufWriter<&File>) -> Result<(), E>,
) -> Result<TempFile, E> {
    let temporary = TempFile::beside(path).map_err(&fault)?;
    let mut out = BufWriter::with_capacity(BUFFER, temporary.file());
    write(&mut out)?;
    out.flush().map_err(|error| fault(error.into()))?;
    drop(out);
    Ok(temporary)
}

/// Checks that `path` can be written, before long work.
///
/// # Errors
/// [`FormatError`] if no file can be made beside it, or it is not a regular file.
pub fn check_writable(path: &Path) -> Result<(), FormatError> {
    TempFile::beside(path).map(drop).map_err(|fault| FormatError::whole(path, fault.into()))
}

/// The temporary files and folders that exist now.
static PENDING: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Locks the list, which stays valid if a thread panicked while it held the lock.
fn pending() -> MutexGuard<'static, Vec<PathBuf>> {
    PENDING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes every temporary file and folder of this process before it is ended at once. From then on other threads
/// wait when they begin or complete a file.
pub fn abandon_temporaries() {
    let mut pending = pending();
    for path in pending.drain(..) {
        // What cannot be removed stays; there is nobody left to be told.
        let _ = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    }
    std::mem::forget(pending);
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
    /// The name behind symbolic links, to which the file is renamed.
    resolved: PathBuf,
}

impl TempFile {
    /// Creates the file.
    ///
    /// # Errors
    /// `target` is a folder, a device or a pipe, or protected; its folder is missing or refuses; the
    /// disk is full.
    pub fn beside(target: &Path) -> Result<Self, WriteFault> {
        let resolved = resolve(target)?;
        let name = resolved.file_name().ok_or(WriteFault::IsFolder)?;
        // A counter makes names unique in this process, its number among processes; what is left are
        // leftovers of a killed process of the same number, which are stepped over.
        static COUNT: AtomicU64 = AtomicU64::new(0);
        loop {
            let mut temporary = name.to_os_string();
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            temporary.push(format!(".{}-{count}.part", std::process::id()));
            let path = resolved.with_file_name(temporary);
            let mut pending = pending();
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => {
                    pending.push(path.clone());
                    return Ok(Self { path: Some(path), file: Some(file), target: target.into(), resolved });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    let folder = folder_of(&resolved);
                    let is_missing = error.kind() == ErrorKind::NotFound && !folder.is_dir();
                    return Err(if is_missing { WriteFault::NoFolder(folder.into()) } else { error.into() });
                }
            }
        }
    }

    /// The open file, empty and at its start at first.
    #[must_use]
    pub fn file(&self) -> &File {
        self.file.as_ref().expect("open until it is closed, renamed or dropped")
    }

    /// Its present path, for another program to write to.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.path.as_deref().expect("there until it is renamed or dropped")
    }

    /// The name it is meant for.
    #[must_use]
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Gives the file its final name, replacing an existing one.
    ///
    /// # Errors
    /// The system's refusals; the temporary file is removed then.
    pub fn persist(mut self) -> Result<(), WriteFault> {
        self.rename()
    }

    /// [`TempFile::persist`] for an owner that is dropped itself; only once.
    ///
    /// # Errors
    /// The system's refusals; the temporary file is removed then.
    pub fn rename(&mut self) -> Result<(), WriteFault> {
        self.file = None;
        let mut pending = pending();
        // Windows says "denied" where Unix says "is a directory".
        fs::rename(self.path(), &self.resolved)
            .map_err(|error| if self.resolved.is_dir() { WriteFault::IsFolder } else { error.into() })?;
        pending.retain(|path| Some(path) != self.path.as_ref());
        self.path = None;
        Ok(())
    }
}

/// A new empty folder beside `target`, for what is made of many files; removed with all of them when dropped.
#[derive(Debug)]
pub struct TempFolder {
    path: PathBuf,
}

impl TempFolder {
    /// Creates the folder.
    ///
    /// # Errors
    /// The folder that `target` is in is missing or refuses; the disk is full.
    pub fn beside(target: &Path) -> Result<Self, WriteFault> {
        // Also of `site/..` and of the like.
        let name = target.file_name().ok_or(WriteFault::IsFolder)?;
        static COUNT: AtomicU64 = AtomicU64::new(0);
        loop {
            let mut temporary = name.to_os_string();
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            temporary.push(format!(".{}-{count}.parts", std::process::id()));
            let path = target.with_file_name(temporary);
            let mut pending = pending();
            match fs::create_dir(&path) {
                Ok(()) => {
                    pending.push(path.clone());
                    return Ok(Self { path });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    let folder = folder_of(&path);
                    let is_missing = error.kind() == ErrorKind::NotFound && !folder.is_dir();
                    return Err(if is_missing { WriteFault::NoFolder(folder.into()) } else { error.into() });
                }
            }
        }
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for TempFolder {
    fn drop(&mut self) {
        let mut pending = pending();
        // Nothing more can be done if this fails; the first error is the one to report.
        let _ = fs::remove_dir_all(&self.path);
        pending.retain(|other| *other != self.path);
    }
}

impl Drop for TempFile {
    fn drop(&mut self) {
        // Closed first: Windows does not remove open files.
        self.file = None;
        if let Some(path) = self.path.take() {
            let mut pending = pending();
            // Nothing more can be done if this fails; the first error is the one to report.
            let _ = fs::remove_file(&path);
            pending.retain(|other| *other != path);
        }
    }
}

/// The file behind `target` if it is a symbolic link, else `target`; an error if it is something that
/// must not be replaced.
fn resolve(target: &Path) -> Result<PathBuf, WriteFault> {
    match fs::metadata(target) {
        Ok(about) if about.is_dir() => Err(WriteFault::IsFolder),
        Ok(about) if !about.is_file() => Err(WriteFault::NotRegular),
        Ok(about) if about.permissions().readonly() => Err(WriteFault::Protected),
        // A rename replaces the link instead of the file it leads to.
        Ok(_) if target.is_symlink() => Ok(fs::canonicalize(target)?),
        // A path that cannot be looked at fails again, with its reason, when the file is created.
        _ => Ok(target.into()),
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        for text in ["first", "second"] {
            write_atomically(&path, |out| Ok(out.write_all(text.as_bytes())?)).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        write_durably(&path, |out| Ok(out.write_all(b"third")?)).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "third");
        assert_eq!(names(folder.path()), ["a.ply"]);
    }

    #[test]
    fn an_error_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        fs::write(&path, "old").unwrap();
        let error = write_atomically(&path, |out| {
            out.write_all(&[0; 1_000_000])?;
            Err(io::Error::from(ErrorKind::StorageFull).into())
        });
        let expected = format!(
            "{}: cannot be written: the disk is full; free some space or write elsewhere",
            path.display()
        );
        assert_eq!(error.unwrap_err().to_string(), expected);
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.ply"]);
    }

    #[test]
    fn a_panic_removes_the_temporary_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let result = std::panic::catch_unwind(|| write_atomically(&path, |_| panic!("in the middle")));
        assert!(result.is_err());
        assert_eq!(names(folder.path()), [] as [&str; 0]);
    }

    #[test]
    fn temporary_folders_go_with_what_is_in_them() {
        let folder = tempfile::tempdir().unwrap();
        let made = TempFolder::beside(&folder.path().join("site")).unwrap();
        fs::create_dir(made.path().join("place")).unwrap();
        fs::write(made.path().join("place/a"), "a").unwrap();
        assert_ne!(TempFolder::beside(&folder.path().join("site")).unwrap().path(), made.path());
        assert_eq!(names(folder.path()).len(), 1);
        drop(made);
        assert_eq!(names(folder.path()), [] as [&str; 0]);
        let fault = TempFolder::beside(&folder.path().join("no/site")).unwrap_err().to_string();
        assert!(fault.contains("does not exist; create it first"), "{fault}");
    }

    #[test]
    fn outputs_that_cannot_be_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let say = |path: &Path| {
            let error = write_atomically(path, |_| Ok(())).unwrap_err().to_string();
            assert!(!error.contains('\n'), "{error}");
            error.replace(&folder.path().display().to_string(), "DIR")
        };
        assert_eq!(
            say(&folder.path().join("no/a.ply")),
            "DIR/no/a.ply: cannot be written: the folder \"DIR/no\" does not exist; create it first"
        );
        assert_eq!(say(folder.path()), "DIR: cannot be written: it is a folder; name a file in it");
        let path = folder.path().join("protected.ply");
        fs::write(&path, "mine").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        assert_eq!(
            say(&path),
            "DIR/protected.ply: cannot be written: it is write-protected; choose another name"
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
        let below_a_file = say(&path.join("a.ply"));
        assert!(below_a_file.starts_with("DIR/protected.ply/a.ply: cannot be written: "), "{below_a_file}");
    }

    #[test]
    fn refusals_of_the_system_are_told_apart() {
        let say = |kind: ErrorKind| WriteFault::from(io::Error::from(kind));
        assert!(matches!(say(ErrorKind::StorageFull), WriteFault::DiskFull));
        assert!(matches!(say(ErrorKind::ReadOnlyFilesystem), WriteFault::Denied(_)));
        assert!(matches!(say(ErrorKind::IsADirectory), WriteFault::IsFolder));
        assert!(matches!(say(ErrorKind::BrokenPipe), WriteFault::Other(_)));
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_refuses_is_reported() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o555)).unwrap();
        if File::create(folder.path().join("probe")).is_ok() {
            eprintln!("skipped: this user may write to read-only folders");
            return;
        }
        let path = folder.path().join("a.ply");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(error.starts_with(&format!("{}: cannot be written: ", path.display())), "{error}");
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_devices_spared() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real.ply"), folder.path().join("link.ply"));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_atomically(&link, |out| Ok(out.write_all(b"new")?)).unwrap();
        assert_eq!(fs::read_to_string(&real).unwrap(), "new");
        assert!(link.is_symlink());
        let error = write_atomically(Path::new("/dev/null"), |_| Ok(())).unwrap_err().to_string();
        assert_eq!(error, "/dev/null: cannot be written: it is not a regular file; choose another name");
    }
}
