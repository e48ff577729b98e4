//! Scene files: one module a format, one line a format in the list below.
//!
//! A format is told by the first bytes of a file; its extension only matters for writing. A format
//! converts activations, quantisation and axes itself, so that a [`Scene`] is the same whatever it
//! came from. To add one: a module with a `FORMAT`, and its name in the list.
//!
//! A scene may also be a folder that a 3DGS training wrote ([`folder`]), and any scene file may have
//! a TOML file of metadata beside it ([`sidecar`]) and the photographed views in a JSON file.

pub mod folder;
pub mod sidecar;

use crate::{
    Scene,
    error::{FormatError, Problem, excerpt},
    files::write_atomically,
    source::Source,
};
pub use sidecar::{sidecar_path, write_sidecar};
use std::{
    io::{Read, Write},
    path::Path,
};

macro_rules! formats {
    ($($name:ident),+ $(,)?) => {
        $(pub mod $name;)+

        /// Every scene format, in the order in which they are tried.
        pub const FORMATS: &[Format] = &[$($name::FORMAT),+];
    };
}

formats! { ply }

/// A scene format.
pub struct Format {
    /// Its name in messages.
    pub name: &'static str,
    /// Its extensions without dot, lower case, the one for new files first.
    pub extensions: &'static [&'static str],
    /// What it is, in one line.
    pub about: &'static str,
    /// Whether the first bytes of a file are of this format; at most [`SNIFFED`] of them are given.
    sniff: fn(&[u8]) -> bool,
    read: fn(&mut Source) -> Result<Scene, FormatError>,
    write: fn(&mut dyn Write, &Scene) -> Result<(), Problem>,
}

/// Bytes at the start of a file that tell its format.
pub const SNIFFED: usize = 64;

/// What to read beside the splats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// The TOML file of metadata beside the scene file.
    pub sidecar: Sidecar,
    /// The cameras in the folder of a training.
    pub views: Views,
}

/// Whether the TOML file beside a scene file counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sidecar {
    /// Its values win over those in the scene file, key by key.
    #[default]
    Merge,
    /// It is not looked at.
    Ignore,
}

/// Whether the cameras in the folder of a training, or beside a scene file, are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Views {
    /// They are, if they are there.
    #[default]
    Read,
    /// They are not looked at.
    Ignore,
}

/// Reads a scene: a file of any format in [`FORMATS`], or the folder of a 3DGS training.
///
/// # Errors
/// [`FormatError`] if the path, the content, the sidecar or the cameras cannot be used.
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<Scene, FormatError> {
    // What is small and may be wrong comes before what is large.
    let file = folder::scene_file(path)?;
    let sidecar = match options.sidecar {
        Sidecar::Merge => sidecar::read(&file)?,
        Sidecar::Ignore => None,
    };
    let views = match options.views {
        Views::Read if file != path => folder::read_views(path)?,
        Views::Read => folder::read_cameras(&folder::cameras_path(&file))?,
        Views::Ignore => Vec::new(),
    };
    let mut scene = read_source(&mut Source::open(&file)?)?;
    scene.metadata = sidecar.unwrap_or_default().or(scene.metadata);
    scene.views.extend(views);
    Ok(scene)
}

/// Reads a scene from a stream: bytes in memory, a pipe. `name` is its name in messages, `length` its
/// bytes in all; with it, a count in a header can be checked before memory is taken.
///
/// # Errors
/// [`FormatError`] if the content cannot be used.
pub fn read_scene_from(name: &Path, reader: impl Read, length: Option<u64>) -> Result<Scene, FormatError> {
    read_source(&mut Source::new(name, Box::new(reader), length))
}

fn read_source(source: &mut Source) -> Result<Scene, FormatError> {
    source.fill(SNIFFED)?;
    let start = &source.bytes()[..source.bytes().len().min(SNIFFED)];
    if start.is_empty() {
        return Err(source.whole(Problem::Empty));
    }
    let Some(format) = FORMATS.iter().find(|format| (format.sniff)(start)) else {
        return Err(source.whole(unknown_format(source.path(), start)));
    };
    (format.read)(source)
}

/// Writes a scene in the format of the extension of `path`, whole or not at all.
///
/// What a format has no room for is left out: a PLY keeps no views ([`folder::write_cameras`] puts them
/// beside it). A sidecar beside `path` is left
/// as it is, and wins when the scene is read.
///
/// # Errors
/// [`FormatError`] if no format has the extension, the scene cannot be stored, or the output cannot
/// be written; then `path` is as it was.
pub fn write_scene(path: &Path, scene: &Scene) -> Result<(), FormatError> {
    let format = format_for(path)?;
    write_atomically(path, |out| (format.write)(out, scene))
}

/// The format that a file with the name `path` is written in: that of its extension.
///
/// # Errors
/// [`FormatError`] if no format has the extension.
pub fn format_for(path: &Path) -> Result<&'static Format, FormatError> {
    by_extension(path).ok_or_else(|| {
        let extension = path.extension().map(|e| format!(".{}", excerpt(e.as_encoded_bytes())));
        let known: Vec<String> = FORMATS.iter().map(|f| format!(".{}", f.extensions[0])).collect();
        let problem =
            Problem::UnknownExtension { extension: extension.unwrap_or_default(), known: known.join(", ") };
        FormatError::whole(path, problem)
    })
}

fn by_extension(path: &Path) -> Option<&'static Format> {
    let extension = path.extension()?;
    FORMATS.iter().find(|f| f.extensions.iter().any(|e| extension.eq_ignore_ascii_case(e)))
}

/// What to say of content that no format knows.
fn unknown_format(path: &Path, start: &[u8]) -> Problem {
    let claim = match by_extension(path) {
        Some(format) => format!("no {} file, although its name says so", format.name),
        None => {
            let names: Vec<&str> = FORMATS.iter().map(|f| f.name).collect();
            format!("of none of the formats that are read ({})", names.join(", "))
        }
    };
    let advice = if start.starts_with(b"version https://git-lfs") {
        "this is a Git LFS pointer, get the file itself with `git lfs pull`"
    } else if start.trim_ascii_start().starts_with(b"<") {
        "this looks like a web page, download the file itself"
    } else {
        "convert or export the scene again"
    };
    let start = excerpt(&start[..start.len().min(16)]);
    Problem::UnknownFormat { found: format!("{claim}: it begins with \"{start}\""), advice }
}

#[cfg(test)]
mod tests;
