//! The folder of a site: made beside its place, and moved there when it is whole.

use anyhow::{Context, Result, bail};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use wm_base::files::{TempFolder, check_writable, rename, write_atomically, write_staged};

/// The file by which a site of this program is known.
pub(crate) const MARK: &str = "place/place.json";
/// An empty file in the output folder while the site's files are moved there. If the program is
/// killed then, it stays, and says that the folder belongs to a site and may be written to again.
const UNFINISHED: &str = ".unfinished-site";
/// Parts of an older site that are removed even if the new one lacks them.
const PARTS: [&str; 2] = ["place", "video.mp4"];

/// A site that is being made.
pub(crate) struct SiteFolder {
    made: TempFolder,
    out: PathBuf,
}

impl SiteFolder {
    /// Begins a site that will be the folder `out`, or a file if `is_file` is set.
    ///
    /// # Errors
    /// `out` cannot be written, or is a folder that holds something else than a site.
    pub(crate) fn new(out: &Path, is_file: bool) -> Result<Self> {
        // `site/` is the folder `site`.
        let out: PathBuf = out.components().collect();
        if is_file {
            check_writable(&out)?;
        } else {
            check_folder(&out)?;
        }
        let made = at(TempFolder::beside(&out), &out)?;
        Ok(Self { made, out })
    }

    /// The folder to write into.
    pub(crate) fn path(&self) -> &Path {
        self.made.path()
    }

    /// Moves the site to its place, and returns its size, bytes. What else lies in a folder with an
    /// older site stays.
    pub(crate) fn finish(self) -> Result<u64> {
        let (made, out) = (self.made.path(), &self.out);
        let bytes = size_of(made)?;
        at(fs::create_dir_all(out), out)?;
        let unfinished = out.join(UNFINISHED);
        at(write_staged(&unfinished, b""), &unfinished)?;
        let old = made.join("old");
        at(fs::create_dir(&old), &old)?;
        let mut names: Vec<_> =
            at(fs::read_dir(made), made)?.flatten().map(|entry| entry.file_name()).collect();
        names.retain(|name| name != "old");
        // The mark is in the last: a folder with it is whole.
        names.sort_by_key(|name| name == "place");
        for name in PARTS.iter().map(Into::into).chain(names.iter().cloned()) {
            match rename(&out.join(&name), &old.join(&name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => at(Err(error), &out.join(&name))?,
                _ => {}
            }
        }
        for name in &names {
            at(rename(&made.join(name), &out.join(name)), &out.join(name))?;
        }
        at(fs::remove_file(&unfinished), &unfinished)?;
        Ok(bytes)
    }
}

/// Fails unless a site can be written to `out`: there is nothing, an empty folder or a site.
fn check_folder(out: &Path) -> Result<()> {
    let entries = match fs::read_dir(out) {
        Ok(mut entries) => entries.next(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) if error.kind() == ErrorKind::NotADirectory => {
            bail!("{}: is a file; name a folder for the site", out.display())
        }
        Err(error) => return at(Err(error), out),
    };
    let is_ours = || [MARK, UNFINISHED].iter().any(|name| out.join(name).is_file());
    if entries.is_some() && !is_ours() {
        bail!("{}: holds other things than a site; name a new or an empty folder", out.display());
    }
    Ok(())
}

/// Adds the path to an error about it.
pub(crate) fn at<T, E: Into<anyhow::Error>>(outcome: Result<T, E>, path: &Path) -> Result<T> {
    outcome.map_err(Into::into).with_context(|| path.display().to_string())
}

/// Writes a file whole or not at all.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(write_atomically(path, |out| Ok(out.write_all(bytes)?))?)
}

/// Makes a folder.
pub(crate) fn make_folder(path: &Path) -> Result<()> {
    at(fs::create_dir_all(path), path)
}

/// Returns the size of a file, or of all files in a folder, bytes; 0 if it is not there.
pub(crate) fn size_of(path: &Path) -> Result<u64> {
    let about = match fs::metadata(path) {
        Ok(about) => about,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(0),
        Err(error) => return at(Err(error), path),
    };
    if !about.is_dir() {
        return Ok(about.len());
    }
    let entries = at(fs::read_dir(path), path)?;
    entries.map(|entry| size_of(&at(entry, path)?.path())).sum()
}

/// Returns a number of bytes in words, such as "1.2 MB".
pub(crate) fn megabytes(bytes: u64) -> String {
    if bytes < 100_000 {
        return format!("{:.1} kB", bytes as f64 / 1e3);
    }
    format!("{:.1} MB", bytes as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn site(out: &Path, page: &str) -> Result<u64> {
        let made = SiteFolder::new(out, false)?;
        fs::create_dir(made.path().join("place")).unwrap();
        fs::write(made.path().join(MARK), "{}").unwrap();
        fs::write(made.path().join("index.html"), page).unwrap();
        made.finish()
    }

    #[test]
    fn sites_are_replaced_and_other_things_stay() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("site");
        assert_eq!(site(&out, "first").unwrap(), 7);
        for name in ["video.mp4", "CNAME", "place/scene.sog"] {
            fs::write(out.join(name), "a").unwrap();
        }
        site(&out.join(""), "second").unwrap();
        assert_eq!(fs::read_to_string(out.join("index.html")).unwrap(), "second");
        assert!(out.join("CNAME").exists() && out.join(MARK).exists());
        assert!(!out.join("video.mp4").exists() && !out.join("place/scene.sog").exists());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        fs::remove_file(out.join(MARK)).unwrap();
        let said = site(&out, "third").unwrap_err().to_string();
        assert!(
            said.ends_with("site: holds other things than a site; name a new or an empty folder"),
            "{said}"
        );
        let said = site(&out.join("index.html"), "").unwrap_err().to_string();
        assert!(said.ends_with("index.html: is a file; name a folder for the site"), "{said}");
        // Nothing is left of what was not finished.
        drop(SiteFolder::new(&folder.path().join("other"), false).unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
