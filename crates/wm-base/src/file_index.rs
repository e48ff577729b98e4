//! Files found by the names that other programs wrote down for them.
//!
//! Photos, masks and maps are named in captures as the program that wrote them saw them: with its
//! own folders, separators, extensions and case. [`FileIndex`] lists a folder once and finds the
//! file that such a name means. Of several candidates the one in the nearest place is taken:
//!
//! 1. at the path itself;
//! 2. at the path without its leading folders (`images/back/1.jpg` is `back/1.png` in a folder of
//!    masks);
//! 3. at the path in some folder below;
//! 4. anywhere, with the same file name.
//!
//! In one folder, a name in the same case comes before one in another case, then the name itself
//! before `NAME.jpg.png`, `NAME.png` and `NAME_mask.png`. If two files are equally good, none is
//! taken.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use thiserror::Error;

/// Greatest depth of folders that are listed.
const MAX_DEPTH: usize = 16;
/// Most files that are listed.
const MAX_FILES: usize = 1 << 20;
/// Longest extension that is replaced by another, letters.
const MAX_EXTENSION_LETTERS: usize = 5;

/// The names that files of one kind have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileKind {
    /// Extensions without their dot, lower case.
    pub extensions: &'static [&'static str],
    /// Endings that may follow the name before the extension, lower case, such as `_mask`.
    pub endings: &'static [&'static str],
    /// Starts of the names of folders that are not listed, lower case.
    pub skipped: &'static [&'static str],
}

impl FileKind {
    /// Photos. Folders of masks and maps are not looked into, whose files have the names of photos.
    pub const PHOTO: Self = Self {
        extensions: &["jpg", "jpeg", "png"],
        endings: &[],
        #[rustfmt::skip]
        skipped: &[
            "mask", "depth", "normal", "sky", "segment", "semantic", "label",
            "confidence", "priors", "truth",
        ],
    };
    /// Masks.
    pub const MASK: Self = Self {
        extensions: &["png", "jpg", "jpeg"],
        endings: &["_mask", ".mask", "-mask", "_masks"],
        skipped: &[],
    };
    /// Masks that lie among the photos, and are known by their endings.
    pub const MASK_BESIDE: Self = Self { extensions: &[], ..Self::MASK };
}

/// The place of a file that was found, the nearest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FilePlace {
    /// In another folder.
    Elsewhere,
    /// In a folder below.
    Below,
    /// At the end of the path, without its leading folders.
    WithoutLeading,
    /// At the path.
    Exact,
}

/// The grade with which a file fits a name; greater is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Fit {
    place: FilePlace,
    /// Folders of the path that are the same.
    folders: usize,
    is_same_case: bool,
    /// 4 for the name itself, 3 with an extension appended, 2 with another extension; 1 and 0 with
    /// an ending.
    form: u8,
}

/// A file that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundFile {
    /// The path: that of the folder, and the file's in it.
    pub path: PathBuf,
    /// The place in relation to the name.
    pub place: FilePlace,
}

/// Two files fit a name equally well, or two names a file.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum Ambiguity {
    /// Two files.
    #[error(
        "{} and {} could both be {name:?}; rename or remove one of them", first.display(), second.display()
    )]
    Files {
        /// The name.
        name: String,
        /// A file that fits.
        first: PathBuf,
        /// Another one.
        second: PathBuf,
    },
    /// Two names.
    #[error("{} could be {first:?} and {second:?}; put the files into folders as they are named", path.display())]
    Names {
        /// The only file that fits.
        path: PathBuf,
        /// A name.
        first: String,
        /// Another name.
        second: String,
    },
}

/// The files of one kind in a folder and in those below it, by their names.
#[derive(Debug)]
pub struct FileIndex {
    folder: PathBuf,
    kind: FileKind,
    listing: OnceLock<Listing>,
}

#[derive(Debug, Default)]
struct Listing {
    /// Paths in the folder, with `/`.
    files: Vec<String>,
    /// By a name in lower case: files, and the form (see [`Fit`]) if that is an ending.
    by_name: HashMap<String, Vec<(u32, Ending)>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ending {
    None,
    /// Length of the ending, bytes.
    Some(usize),
}

impl FileIndex {
    /// An index of a folder, which need not exist. It is listed when a name is not found at its
    /// path.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>, kind: FileKind) -> Self {
        Self { folder: folder.into(), kind, listing: OnceLock::new() }
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The paths of all files in the folder, sorted, with `/` between their parts. Hidden files and
    /// folders are left out.
    #[must_use]
    pub fn files(&self) -> &[String] {
        &self.listing().files
    }

    /// Finds the file that a name means; `None` if there is none.
    ///
    /// # Errors
    /// [`Ambiguity`] if two files fit equally well.
    pub fn find(&self, name: &str) -> Result<Option<FoundFile>, Ambiguity> {
        Ok(self.search(name)?.map(|(path, fit)| FoundFile { path, place: fit.place }))
    }

    /// Finds the files that names mean. A file has one name: if several names mean it, the one that
    /// fits best, and the others have none.
    ///
    /// # Errors
    /// [`Ambiguity`] if two files fit a name equally well, or two names a file.
    pub fn find_all(&self, names: &[&str]) -> Result<Vec<Option<FoundFile>>, Ambiguity> {
        let mut found: Vec<Option<(PathBuf, Fit)>> =
            names.iter().map(|name| self.search(name)).collect::<Result<_, _>>()?;
        let mut best: HashMap<PathBuf, usize> = HashMap::new();
        for index in 0..names.len() {
            let Some((path, fit)) = found[index].clone() else { continue };
            let Some(other) = best.get(&path).copied() else {
                best.insert(path, index);
                continue;
            };
            let others = found[other].as_ref().map(|(_, fit)| *fit);
            if names[other] == names[index] {
                continue;
            }
            match Some(fit).cmp(&others) {
                std::cmp::Ordering::Less => found[index] = None,
                std::cmp::Ordering::Greater => {
                    found[other] = None;
                    best.insert(path, index);
                }
                std::cmp::Ordering::Equal => {
                    let (first, second) = (names[other].to_owned(), names[index].to_owned());
                    return Err(Ambiguity::Names { path, first, second });
                }
            }
        }
        Ok(found
            .into_iter()
            .map(|found| found.map(|(path, fit)| FoundFile { path, place: fit.place }))
            .collect())
    }

    fn search(&self, name: &str) -> Result<Option<(PathBuf, Fit)>, Ambiguity> {
        let wanted = plain(name);
        if wanted.is_empty() {
            return Ok(None);
        }
        let exact = self.folder.join(&wanted);
        if self.has_extension(&wanted) && exact.is_file() {
            let fit = Fit { place: FilePlace::Exact, folders: usize::MAX, is_same_case: true, form: 4 };
            return Ok(Some((exact, fit)));
        }
        let found = self.listed(name, &wanted)?;
        match decoded(&wanted) {
            Some(decoded) if found.is_none() => self.listed(name, &decoded),
            _ => Ok(found),
        }
    }

    fn listed(&self, name: &str, wanted: &str) -> Result<Option<(PathBuf, Fit)>, Ambiguity> {
        let listing = self.listing();
        let (folders, file) = split(wanted);
        let stem = stem(file);
        let lower = [file.to_lowercase(), stem.to_lowercase()];
        let keys = if lower[0] == lower[1] { &lower[..1] } else { &lower[..] };
        let entries = keys.iter().flat_map(|key| listing.by_name.get(key)).flatten();
        let mut fits: Vec<(Fit, u32)> = entries
            .map(|(index, ending)| {
                (fit(folders, file, stem, &listing.files[*index as usize], *ending), *index)
            })
            .collect();
        fits.sort_by(|a, b| b.cmp(a));
        // A file may be listed under several names, of which the best counts.
        let mut seen = HashSet::new();
        fits.retain(|(_, index)| seen.insert(*index));
        let path = |index: u32| self.folder.join(&listing.files[index as usize]);
        let Some(&(best, first)) = fits.first() else { return Ok(None) };
        let parent = |index: u32| split(&listing.files[index as usize]).0;
        // Case and extension only tell files of one folder from each other.
        let is_rival = |(fit, index): &&(Fit, u32)| {
            let is_near = (fit.place, fit.folders) == (best.place, best.folders);
            *fit == best || is_near && parent(*index) != parent(first)
        };
        match fits[1..].iter().find(is_rival) {
            Some((_, second)) => {
                Err(Ambiguity::Files { name: name.into(), first: path(first), second: path(*second) })
            }
            None => Ok(Some((path(first), best))),
        }
    }

    fn has_extension(&self, path: &str) -> bool {
        extension(path).is_some_and(|found| self.kind.extensions.contains(&found.to_lowercase().as_str()))
    }

    fn listing(&self) -> &Listing {
        self.listing.get_or_init(|| {
            let mut listing = Listing::default();
            // The masks among photos have the extensions of masks.
            let is_beside = self.kind.extensions.is_empty();
            let extensions = if is_beside { FileKind::MASK.extensions } else { self.kind.extensions };
            listing.files = files_below(&self.folder, self.kind.skipped);
            listing.files.retain(|file| {
                extension(file).is_some_and(|found| extensions.contains(&found.to_lowercase().as_str()))
            });
            listing.files.sort();
            for (index, file) in listing.files.iter().enumerate() {
                let name = split(file).1.to_lowercase();
                let stem = stem(&name).to_owned();
                let mut add = |key: &str, ending| {
                    listing.by_name.entry(key.to_owned()).or_default().push((index as u32, ending));
                };
                if !is_beside {
                    add(&name, Ending::None);
                    add(&stem, Ending::None);
                }
                for ending in self.kind.endings {
                    if let Some(short) = stem.strip_suffix(ending).filter(|short| !short.is_empty()) {
                        add(short, Ending::Some(ending.len()));
                    }
                }
            }
            listing
        })
    }
}

/// Grades the file `found` for the name `file` with the folders `folders`.
fn fit(folders: &str, file: &str, own_stem: &str, found: &str, ending: Ending) -> Fit {
    let (found_folders, found_file) = split(found);
    let found_stem = stem(found_file);
    let (short, with_ending) = match ending {
        Ending::None => (found_stem, 0),
        Ending::Some(length) => (found_stem.get(..found_stem.len() - length).unwrap_or(found_stem), 1),
    };
    let is_same = |a: &str, b: &str| a.to_lowercase() == b.to_lowercase();
    let (form, name, found_name) = if with_ending == 0 && is_same(found_file, file) {
        (4, file, found_file)
    } else if is_same(short, file) {
        (3 - 2 * with_ending, file, short)
    } else {
        (2 - 2 * with_ending, own_stem, short)
    };
    let parts = |path: &str| path.split('/').filter(|part| !part.is_empty()).count();
    let (wanted, there) = (parts(folders), parts(found_folders));
    let pairs = || folders.rsplit('/').zip(found_folders.rsplit('/')).filter(|(a, _)| !a.is_empty());
    let common = pairs().take_while(|(a, b)| is_same(a, b)).count();
    let place = match (common == wanted, common == there) {
        (true, true) => FilePlace::Exact,
        (false, true) => FilePlace::WithoutLeading,
        (true, false) => FilePlace::Below,
        (false, false) => FilePlace::Elsewhere,
    };
    let is_same_case = name == found_name && pairs().take(common).all(|(a, b)| a == b);
    Fit { place, folders: common, is_same_case, form }
}

/// A path with `/` between its parts, without a scheme, a root, and parts that lead elsewhere.
#[must_use]
pub fn plain(name: &str) -> String {
    let name = name.trim().replace('\\', "/");
    let name = name.strip_prefix("file://").unwrap_or(&name);
    let parts: Vec<&str> = name.split('/').filter(|part| !matches!(*part, "" | "." | "..")).collect();
    parts.join("/")
}

/// The text with its percent-encoded bytes decoded; `None` if there are none.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, after @ ..] = rest {
        let code = after.first_chunk::<2>().filter(|_| *first == b'%');
        let byte = code.and_then(|code| std::str::from_utf8(code).ok());
        match byte.and_then(|code| u8::from_str_radix(code, 16).ok()) {
            Some(byte) => (bytes.push(byte), rest = &after[2..]).1,
            None => (bytes.push(*first), rest = after).1,
        }
    }
    String::from_utf8(bytes).ok().filter(|decoded| decoded != text)
}

/// The folders and the file name of a path.
fn split(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

/// The extension of a name, of a few letters and digits of which the first is a letter.
fn extension(name: &str) -> Option<&str> {
    let (stem, extension) = split(name).1.rsplit_once('.')?;
    let is_one = extension.starts_with(|c: char| c.is_ascii_alphabetic())
        && extension.len() <= MAX_EXTENSION_LETTERS
        && extension.bytes().all(|b| b.is_ascii_alphanumeric());
    (is_one && !stem.is_empty()).then_some(extension)
}

/// A file name without its extension.
fn stem(name: &str) -> &str {
    extension(name).map_or(name, |extension| &name[..name.len() - extension.len() - 1])
}

/// The files in a folder and below, with `/` between their parts, in any order. Folders with names
/// that start as `skipped` says (lower case) are left out, and so are hidden files and folders.
fn files_below(folder: &Path, skipped: &[&str]) -> Vec<String> {
    let mut files = Vec::new();
    let mut open = vec![(folder.to_path_buf(), String::new(), 0)];
    // Links may lead back to where they lie.
    let mut visited = HashSet::new();
    while let Some((place, prefix, depth)) = open.pop() {
        let Ok(entries) = fs::read_dir(&place) else { continue };
        for entry in entries.flatten() {
            let Ok(name) = entry.file_name().into_string() else { continue };
            if name.starts_with(['.', '@']) || name == "__MACOSX" || files.len() >= MAX_FILES {
                continue;
            }
            let Ok(kind) = entry.file_type() else { continue };
            let path = entry.path();
            let is_folder = if kind.is_symlink() { path.is_dir() } else { kind.is_dir() };
            if !is_folder {
                files.push(format!("{prefix}{name}"));
                continue;
            }
            let lower = name.to_lowercase();
            let mut is_new =
                || !kind.is_symlink() || fs::canonicalize(&path).is_ok_and(|to| visited.insert(to));
            if depth < MAX_DEPTH && !skipped.iter().any(|start| lower.starts_with(start)) && is_new() {
                open.push((path, format!("{prefix}{name}/"), depth + 1));
            }
        }
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use tempfile::{TempDir, tempdir};

    fn folder(files: &[&str]) -> TempDir {
        let folder = tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "x").unwrap();
        }
        folder
    }

    /// The file that each name means, as paths in the folder, or the message.
    fn find(folder: &TempDir, kind: FileKind, name: &str) -> Result<Option<String>, String> {
        let relative =
            |path: &Path| path.strip_prefix(folder.path()).unwrap().to_string_lossy().replace('\\', "/");
        match FileIndex::new(folder.path(), kind).find(name) {
            Ok(found) => Ok(found.map(|found| relative(&found.path))),
            Err(error) => Err(error.to_string()),
        }
    }

    #[test]
    fn photos_are_found_however_their_names_are_written() {
        let disk = folder(&[
            "a.jpg",
            "back/1.JPG",
            "back/2.png",
            "front/1.jpg",
            "my photo.jpg",
            "0007",
            "x/deep.JPEG",
        ]);
        for (name, file) in [
            ("a.jpg", Some("a.jpg")),
            ("./a.jpg", Some("a.jpg")),
            ("D:\\scan\\kermit\\a.jpg", Some("a.jpg")),
            ("/home/me/a.JPG", Some("a.jpg")),
            ("file:///C:/me/a.jpg", Some("a.jpg")),
            ("a.CR2", Some("a.jpg")),
            ("a", Some("a.jpg")),
            ("images/back/1.jpg", Some("back/1.JPG")),
            ("Back\\1.jpg", Some("back/1.JPG")),
            ("front/1.png", Some("front/1.jpg")),
            ("../photos/back/2.jpg", Some("back/2.png")),
            ("my%20photo.jpg", Some("my photo.jpg")),
            ("deep.jpg", Some("x/deep.JPEG")),
            ("other/deep.jpg", Some("x/deep.JPEG")),
            // Neither a photo nor named like one.
            ("0007", None),
            ("b.jpg", None),
            ("", None),
            ("..", None),
            ("/", None),
        ] {
            assert_eq!(find(&disk, FileKind::PHOTO, name), Ok(file.map(String::from)), "{name}");
        }
        let message = find(&disk, FileKind::PHOTO, "1.jpg").unwrap_err();
        assert!(message.contains("could both be \"1.jpg\"; rename or remove one of them"), "{message}");
    }

    #[test]
    fn masks_are_called_as_their_photos_in_many_ways() {
        let disk = folder(&["back/1.png", "a.jpg.png", "a.png", "b_mask.png", "c.jpg.mask.png", "D.PNG"]);
        for (name, file) in [
            ("images/back/1.jpg", Some("back/1.png")),
            ("a.jpg", Some("a.jpg.png")),
            ("a.tif", Some("a.png")),
            ("b.jpg", Some("b_mask.png")),
            ("c.jpg", Some("c.jpg.mask.png")),
            ("d.jpeg", Some("D.PNG")),
            ("e.jpg", None),
        ] {
            assert_eq!(find(&disk, FileKind::MASK, name), Ok(file.map(String::from)), "{name}");
        }
        // Among the photos only those are masks that say so.
        for (name, file) in [("b.jpg", Some("b_mask.png")), ("a.jpg", None), ("D.jpg", None)] {
            assert_eq!(find(&disk, FileKind::MASK_BESIDE, name), Ok(file.map(String::from)), "{name}");
        }
        // Masks of photos are no photos.
        assert_eq!(find(&folder(&["masks/a.png"]), FileKind::PHOTO, "a.jpg"), Ok(None));
    }

    #[test]
    fn a_file_is_given_to_one_name() {
        let all = |disk: &TempDir, names: &[&str]| {
            let found = FileIndex::new(disk.path(), FileKind::PHOTO).find_all(names);
            found.map(|found| found.into_iter().map(|found| found.is_some()).collect::<Vec<_>>())
        };
        let disk = folder(&["left/0.jpg", "1.jpg"]);
        // The photos of another camera are missing, and are not those of this one.
        assert_eq!(
            all(&disk, &["right/0.jpg", "left/0.jpg", "1.png", "1.png"]).unwrap(),
            [false, true, true, true]
        );
        let message = all(&disk, &["left/1.jpg", "right/1.jpg"]).unwrap_err().to_string();
        assert!(message.contains("could be \"left/1.jpg\" and \"right/1.jpg\""), "{message}");
    }

    #[cfg(unix)]
    #[test]
    fn links_that_lead_back_end() {
        let disk = folder(&["a/1.jpg"]);
        std::os::unix::fs::symlink(disk.path(), disk.path().join("a/again")).unwrap();
        let index = FileIndex::new(disk.path(), FileKind::PHOTO);
        assert!(index.files().len() <= 3 && index.find("missing.jpg") == Ok(None));
    }

    proptest! {
        #[test]
        fn any_name_is_looked_for(name in "[ab./\\\\%2:é ]{0,12}") {
            let disk = folder(&["a.jpg", "b/a.PNG", "é.jpg"]);
            let index = FileIndex::new(disk.path(), FileKind::PHOTO);
            // Whatever is found lies in the folder.
            if let Ok(Some(found)) = index.find(&name) {
                prop_assert!(found.path.starts_with(disk.path()) && found.path.is_file());
            }
        }
    }
}
