//! Writing files whole or not at all.

use crate::error::{FormatError, Problem};
use std::{
    fs::{self, File, OpenOptions},
    io::{BufWriter, ErrorKind, Write},
    path::{Path, PathBuf},
    sync::atomic::{AtomicU32, Ordering},
};

/// Writes `path` through a temporary file beside it, which takes its place when `write` is done.
///
/// A reader sees the old file or the new one, never a part. A link is followed, so that its target
/// is replaced. A write-protected file is not replaced.
///
/// # Errors
/// [`FormatError`] with `path` if the folder is missing or refuses, or if `write` fails; the
/// temporary file is removed then and `path` is left as it was.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.into());
    check_target(&target).map_err(fault)?;
    let (temporary, file) = Temporary::beside(&target).map_err(fault)?;
    let mut out = BufWriter::with_capacity(1 << 16, file);
    write(&mut out).map_err(fault)?;
    out.flush().map_err(|e| fault(e.into()))?;
    drop(out);
    temporary.take_place_of(&target).map_err(|e| fault(e.into()))
}

/// Refuses what a rename would replace although it should not.
fn check_target(target: &Path) -> Result<(), Problem> {
    let Some(_) = target.file_name() else { return Err(Problem::Occupied("it is no file name")) };
    match fs::metadata(target) {
        Ok(about) if about.is_dir() => Err(Problem::Occupied("it is a folder")),
        Ok(about) if !about.is_file() => Err(Problem::Occupied("it is no regular file")),
        Ok(about) if about.permissions().readonly() => Err(Problem::Occupied("it is write-protected")),
        _ => Ok(()),
    }
}

/// A file that is removed unless it takes its place.
struct Temporary {
    path: PathBuf,
    state: State,
}

#[derive(PartialEq)]
enum State {
    Pending,
    Placed,
}

impl Temporary {
    /// A new file in the folder of `target`.
    fn beside(target: &Path) -> Result<(Self, File), Problem> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let mut attempts = 0;
        loop {
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let mut name = target.file_name().unwrap_or_default().to_owned();
            name.push(format!(".{}-{count}.part", std::process::id()));
            let path = target.with_file_name(name);
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => return Ok((Self { path, state: State::Pending }, file)),
                // Left behind by a process that was killed and whose number came round again.
                Err(error) if error.kind() == ErrorKind::AlreadyExists && attempts < 100 => attempts += 1,
                Err(error) if error.kind() == ErrorKind::NotFound => {
                    let folder = target.parent().unwrap_or(Path::new(""));
                    return Err(Problem::NoFolder(folder.into()));
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    fn take_place_of(mut self, target: &Path) -> std::io::Result<()> {
        fs::rename(&self.path, target)?;
        self.state = State::Placed;
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if self.state == State::Pending {
            // Nothing more can be done if this fails too; the first error is the one to report.
            let _ = fs::remove_file(&self.path);
        }
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
        assert_eq!(names(folder.path()), ["a.ply"]);
    }

    #[test]
    fn an_error_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        fs::write(&path, "old").unwrap();
        let error = write_atomically(&path, |out| {
            out.write_all(&[0; 100_000])?;
            Err(std::io::Error::from(ErrorKind::StorageFull).into())
        });
        let expected = format!("{}: cannot be written: no storage space", path.display());
        assert_eq!(error.unwrap_err().to_string(), expected);
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.ply"]);
    }

    #[test]
    fn outputs_that_cannot_be_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let say = |path: &Path| {
            let error = write_atomically(path, |_| Ok(())).unwrap_err().to_string();
            error.replace(&folder.path().display().to_string(), "DIR")
        };
        assert_eq!(
            say(&folder.path().join("no/a.ply")),
            "DIR/no/a.ply: cannot be written: the folder \"DIR/no\" does not exist; create it first"
        );
        assert_eq!(say(folder.path()), "DIR: cannot be written: it is a folder; choose another name");
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
    fn a_link_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real.ply"), folder.path().join("link.ply"));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write_atomically(&link, |out| Ok(out.write_all(b"new")?)).unwrap();
        assert_eq!(fs::read_to_string(&real).unwrap(), "new");
        assert!(link.is_symlink());
    }
}
