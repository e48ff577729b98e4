//! Files that appear whole or not at all: written beside their final name, then renamed.
//!
//! The temporary file lies in the same folder, since a rename is only atomic within one file
//! system. It is called `<name>.<process>-<count>.part` and is removed when writing fails, and by
//! [`abandon_temporaries`] before the process is ended. Those of processes that were killed are
//! removed when the next process writes into the folder: a live one holds a lock on its own.
//!
//! A file that replaces another is flushed to the disk before it is renamed, so that a power cut
//! leaves the old one or the new one, and has the permissions of the old one. New files are only
//! flushed by [`write_durably`]: thousands of frames would wait for it, and a power cut costs only
//! the last ones.

#[cfg(any(target_arch = "wasm32", test, feature = "testing"))]
pub mod fetched;
// Never used there: nothing is fetched where files are on a disk.
mod faults;
#[cfg(not(any(target_arch = "wasm32", test, feature = "testing")))]
#[allow(dead_code, unreachable_pub)]
mod fetched;
mod reading;

pub use crate::error::WriteFault;
use crate::error::{FormatError, Problem};
use faults::Operation;
pub use reading::{
    BYTE_ORDER_MARK, LFS_REFUSED, MARK_BYTES, is_file, is_lacking, is_lfs_pointer, is_there, open,
    read_if_there, refused_text, without_byte_order_mark,
};
pub use reading::{LARGE_TEXT, SMALL_TEXT, is_folder, read, read_text, skip_byte_order_mark, text_of, want};
use std::{
    collections::BTreeSet,
    ffi::{OsStr, OsString},
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, BufWriter, ErrorKind, Write},
    path::{Path, PathBuf},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

/// Buffer of a file that is written in small pieces, bytes.
const BUFFER_BYTES: usize = 1 << 18;

/// Writes `path` whole or not at all; a reader sees the old file or the new one, never a part.
///
/// A link is followed, so that its target is replaced. A write-protected file is not replaced.
///
/// # Errors
/// [`FormatError`] with `path` if the folder is missing or refuses, or if `write` fails; `path` is
/// left as it was then, and nothing beside it.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    write_whole(path, |f| fault(f.into()), |out| write(out).map_err(fault))
}

/// Writes a file as [`write_atomically`] does, and returns once it is on the disk, so that a power
/// cut leaves the old file or the new one: for files that are worth hours, such as checkpoints.
///
/// # Errors
/// Errors of [`write_atomically`].
pub fn write_durably(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    let temporary = written(path, |f| fault(f.into()), |out| write(out).map_err(fault))?;
    temporary.flush_to_disk().map_err(|f| fault(f.into()))?;
    let folder = folder_of(&temporary.resolved).to_owned();
    temporary.persist().map_err(|f| fault(f.into()))?;
    // The new name is in the folder, which some systems do not open as a file.
    let _ = File::open(folder).and_then(|folder| folder.sync_all());
    Ok(())
}

/// Writes a file whole or not at all, as [`write_atomically`] does, with errors of another type;
/// `fault` converts those of the system.
///
/// # Errors
/// Errors of `write` and of the system; then `path` is as it was.
pub fn write_whole<E>(
    path: &Path,
    fault: impl Fn(WriteFault) -> E,
    write: impl FnOnce(&mut BufWriter<&TempFile>) -> Result<(), E>,
) -> Result<(), E> {
    written(path, &fault, write)?.persist().map_err(&fault)
}

/// Writes the temporary file of `path`.
fn written<E>(
    path: &Path,
    fault: impl Fn(WriteFault) -> E,
    write: impl FnOnce(&mut BufWriter<&TempFile>) -> Result<(), E>,
) -> Result<TempFile, E> {
    let temporary = TempFile::beside(path).map_err(&fault)?;
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, &temporary);
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

/// Removes every temporary file and folder of this process before it is ended at once. From then on
/// other threads wait when they begin or complete a file.
pub fn abandon_temporaries() {
    let mut pending = pending();
    for path in pending.drain(..) {
        // What cannot be removed stays; there is nobody left to be told.
        let _ = remove(&path);
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
    /// `target` is a folder, a device or a pipe, or protected; its folder is missing or refuses;
    /// the disk is full.
    pub fn beside(target: &Path) -> Result<Self, WriteFault> {
        let resolved = resolve(target)?;
        let name = resolved.file_name().ok_or(WriteFault::IsFolder)?;
        sweep(folder_of(&resolved));
        faults::check(Operation::Create)?;
        loop {
            let path = resolved.with_file_name(temporary_name(name, "part"));
            let mut pending = pending();
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => {
                    hold(&file);
                    pending.push(path.clone());
                    return Ok(Self { path: Some(path), file: Some(file), target: target.into(), resolved });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(not_made(&resolved, error)),
            }
        }
    }

    /// The open file, empty and at its start at first.
    #[must_use]
    pub fn file(&self) -> &File {
        self.file.as_ref().expect("open until it is closed, renamed or dropped")
    }

    /// Waits until what was written is on the disk.
    ///
    /// # Errors
    /// The system's refusals.
    pub fn flush_to_disk(&self) -> Result<(), WriteFault> {
        faults::check(Operation::Flush)?;
        Ok(self.file().sync_all()?)
    }

    /// The present path, for another program to write to.
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
        if let (Ok(old), Some(file)) = (fs::metadata(&self.resolved), &self.file) {
            self.flush_to_disk()?;
            file.set_permissions(old.permissions())?;
        }
        faults::check(Operation::Rename)?;
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

impl Write for TempFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        (&*self).write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        (&*self).flush()
    }
}

impl Write for &TempFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        faults::check(Operation::Write)?;
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

/// A new empty folder beside `target`, for what is made of many files; removed with all of them
/// when dropped.
#[derive(Debug)]
pub struct TempFolder {
    path: PathBuf,
    /// Held open while the folder is in use.
    lock: Option<File>,
}

impl TempFolder {
    /// Creates the folder.
    ///
    /// # Errors
    /// The folder that `target` is in is missing or refuses; the disk is full.
    pub fn beside(target: &Path) -> Result<Self, WriteFault> {
        // Also of `site/..` and of the like.
        let name = target.file_name().ok_or(WriteFault::IsFolder)?;
        sweep(folder_of(target));
        faults::check(Operation::Create)?;
        loop {
            let path = target.with_file_name(temporary_name(name, "parts"));
            let mut pending = pending();
            match fs::create_dir(&path) {
                Ok(()) => {
                    pending.push(path.clone());
                    let lock = File::open(&path).ok();
                    lock.as_ref().iter().for_each(|folder| hold(folder));
                    return Ok(Self { path, lock });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(not_made(&path, error)),
            }
        }
    }

    /// The path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for TempFolder {
    fn drop(&mut self) {
        // Closed first: Windows does not remove open folders.
        self.lock = None;
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

/// The file behind `target` if it is a symbolic link, else `target`; an error if it is something
/// that must not be replaced.
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

/// Longest part of a final name that a temporary name begins with, bytes: systems allow 255 in all.
const MAX_STEM_BYTES: usize = 200;

/// A name for a temporary file or folder that will be called `name`. A counter makes it unique in
/// this process, and its number among processes.
fn temporary_name(name: &OsStr, ending: &str) -> OsString {
    static NAME_COUNT: AtomicU64 = AtomicU64::new(0);
    let count = NAME_COUNT.fetch_add(1, Ordering::Relaxed);
    let tail = format!(".{}-{count}.{ending}", std::process::id());
    let mut temporary = match name.as_encoded_bytes() {
        long if long.len() > MAX_STEM_BYTES => {
            String::from_utf8_lossy(&long[..MAX_STEM_BYTES]).trim_end_matches('\u{fffd}').to_owned().into()
        }
        _ => name.to_os_string(),
    };
    temporary.push(tail);
    temporary
}

/// Returns true if a name is one that [`temporary_name`] makes.
fn is_temporary_name(name: &OsStr) -> bool {
    let Some(name) = name.to_str() else { return false };
    let Some((rest, "part" | "parts")) = name.rsplit_once('.') else { return false };
    let numbers = rest.rsplit_once('.').and_then(|(_, numbers)| numbers.split_once('-'));
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    numbers.is_some_and(|(process, count)| is_number(process) && is_number(count))
}

/// Renames a file or a folder, as [`fs::rename`]; tests can have it fail.
///
/// # Errors
/// The system's refusals.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    faults::check(Operation::Rename)?;
    fs::rename(from, to)
}

/// Writes a file into a folder that has not its final name yet, as [`fs::write`]; tests can have it
/// fail.
///
/// # Errors
/// The system's refusals.
pub fn write_staged(path: &Path, bytes: &[u8]) -> io::Result<()> {
    faults::check(Operation::Create)?;
    faults::check(Operation::Write)?;
    fs::write(path, bytes)
}

/// Locks a folder against other processes until the lock is dropped. `None` where folders cannot be
/// locked: on Windows and on some network file systems.
///
/// # Errors
/// [`ErrorKind::WouldBlock`] if it is locked already; other errors if it cannot be opened.
pub fn lock_folder(folder: &Path) -> io::Result<Option<File>> {
    if !cfg!(unix) {
        return Ok(None);
    }
    let opened = File::open(folder)?;
    match opened.try_lock() {
        Ok(()) => Ok(Some(opened)),
        Err(TryLockError::WouldBlock) => Err(ErrorKind::WouldBlock.into()),
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// Locks a temporary file or folder, so that [`sweep`] leaves it. Some file systems have no locks:
/// leftovers stay there.
fn hold(file: &File) {
    // Elsewhere a lock keeps other programs from writing to the file.
    if cfg!(unix) {
        let _ = file.try_lock();
    }
}

/// Removes temporary files and folders from `folder` whose process was killed, once for each
/// folder.
///
/// A live process holds a lock on its own. Young ones are left, since they may not be locked yet.
fn sweep(folder: &Path) {
    const MIN_AGE: Duration = Duration::from_secs(60);
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if !SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.into()) {
        return;
    }
    // Files that cannot be looked at or removed stay: they harm nothing.
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_ours = entry.file_type().is_ok_and(|kind| kind.is_file() || kind.is_dir());
        if !cfg!(unix) || !is_ours || !is_temporary_name(&entry.file_name()) {
            continue;
        }
        let age = entry.metadata().and_then(|about| about.modified()).ok().and_then(|at| at.elapsed().ok());
        let is_dead = || File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if age.is_some_and(|age| age > MIN_AGE) && is_dead() {
            let _ = remove(&entry.path());
        }
    }
}

/// The fault of a file or folder that could not be made.
fn not_made(path: &Path, error: io::Error) -> WriteFault {
    let folder = folder_of(path);
    let is_missing = error.kind() == ErrorKind::NotFound && !folder.is_dir();
    if is_missing { WriteFault::NoFolder(folder.into()) } else { error.into() }
}

/// Removes a file, or a folder with all that is in it.
fn remove(path: &Path) -> io::Result<()> {
    if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests;
