//! Scene files: one module a format, one line a format in the list below.
//!
//! Readers recognise a format by the first bytes of a file, and by its name where it has no mark of
//! its own; writers choose it by the name alone. A format converts activations and quantisation
//! itself and says which [`Axes`] it has, so that a [`Scene`] is the same whatever it came from. To
//! add one: a module with a `FORMAT`, and its name in the list.
//!
//! [`SceneFormat::loses`] states the losses of a format; metadata for which it has no room is put
//! beside it.
//!
//! A scene may also be a folder that a 3DGS training wrote, or of SOG images ([`folder`]), and any
//! scene file may have a TOML file of metadata beside it ([`sidecar`]) and the photographed views
//! in a JSON file. Where a scene file is a symbolic link, files beside it are looked for beside the
//! link, then beside the file that it leads to.
//!
//! # Memory
//! A reader allocates by what it has read, or by a count that the length of the file has confirmed.
//! What is packed may unpack to a hundred times its length at most.

mod axes;
mod beside;
mod bytes;
pub mod folder;
mod loss;
mod pack;
pub mod sidecar;

use crate::{Scene, origin};
use wm_base::{
    error::{FormatError, Problem, excerpt},
    files::{self, TempFile, write_atomically},
    source::Source,
};
#[cfg(test)]
mod fetched_tests;

pub use axes::Axes;
use loss::ANY_SCALE;
pub use loss::{FormatLosses, Retention, lost};
pub use ply::read_points;
pub use sidecar::{sidecar_path, write_sidecar};
use std::{
    io::{Read, Write},
    path::Path,
};

macro_rules! formats {
    ($($($name:ident)::+),+ $(,)?) => {
        /// Every scene format, in the order in which they are tried.
        pub const FORMATS: &[SceneFormat] = &[$($($name)::+::FORMAT),+];
    };
}

mod gltf;
mod ksplat;
pub(crate) mod ply;
pub(crate) mod sog;
mod splat;
mod spz;

formats! { ply, ply::compressed, spz, sog::bundle, sog::folder, sog::levels, gltf, splat, ksplat }

/// A scene format.
pub struct SceneFormat {
    /// Name in messages.
    pub name: &'static str,
    /// The extensions of its files, without dot, lower case, that of new files first. An extension
    /// that is a whole name, such as `meta.json`, names a folder's main file.
    pub extensions: &'static [&'static str],
    /// A description in one line.
    pub about: &'static str,
    /// The axes of its files.
    axes: Axes,
    /// The parts of a scene that it loses.
    pub loses: FormatLosses,
    /// Recognises a file of this format by its first bytes.
    sniff: fn(&Start) -> bool,
    read: fn(&mut Source, &ReadOptions) -> Result<Scene, FormatError>,
    write: Writer,
}

impl SceneFormat {
    /// The parts of a scene that it loses if it is written with `options`.
    #[must_use]
    pub fn loses_with(&self, options: &WriteOptions) -> FormatLosses {
        match options.gltf {
            GltfSplats::Spz if self.name == gltf::FORMAT.name => gltf::PACKED_LOSES,
            GltfSplats::SpzCesium if self.name == gltf::FORMAT.name => {
                FormatLosses { groups: Retention::Not, ..gltf::PACKED_LOSES }
            }
            _ => self.loses,
        }
    }
}

/// The writer of a format. Writers get the scene in the axes of a PLY, and turn what they write.
enum Writer {
    /// Into one file.
    Stream(fn(&mut dyn Write, &Scene, &WriteOptions) -> Result<(), Problem>),
    /// Into several, beside each other; the one that is named comes last.
    Files(fn(&Scene, &mut FileSink) -> Result<(), Problem>),
    /// Not at all.
    Nothing,
}

/// A file of a scene that has several.
pub(crate) struct NamedFile {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
}

/// The receiver of such files, one after the other.
pub(crate) type FileSink<'a> = dyn FnMut(NamedFile) -> Result<(), Problem> + 'a;

/// The facts about a file by which its format is recognised.
pub(crate) struct Start<'a> {
    /// First bytes, at most [`SNIFFED`].
    pub(crate) bytes: &'a [u8],
    /// Name, or that of the stream.
    pub(crate) path: &'a Path,
}

/// Bytes at the start of a file that tell its format.
pub(crate) const SNIFFED: usize = 4096;

/// Options of reading a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// The cameras in the folder of a training.
    pub views: Views,
    /// The level of detail, where a scene has several.
    pub level: DetailLevel,
}

/// A level of detail of a scene that has several; scenes with one ignore it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DetailLevel {
    /// All splats.
    #[default]
    Finest,
    /// Level n; 0 is the finest.
    Number(u32),
    /// The finest with no more splats than this; the coarsest if all have more.
    Budget(u64),
}

/// Options of writing a scene, where a format leaves a choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    /// The version of SPZ.
    pub spz: SpzVersion,
    /// The encoding of splats in a glTF.
    pub gltf: GltfSplats,
}

/// A version of SPZ that is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpzVersion {
    /// 3, gzip: what most programs read.
    #[default]
    V3,
    /// 4, Zstandard.
    V4,
}

/// The encoding of splats in a glTF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GltfSplats {
    /// As floats: nothing is lost.
    #[default]
    Floats,
    /// As SPZ in `KHR_gaussian_splatting_compression_spz_2`.
    Spz,
    /// As SPZ in the way that CesiumJS reads it (1.140): its numbers are in the axes of glTF, where
    /// the draft asks for those of SPZ. Such files state no kernel and no colour space, by which
    /// they are told.
    SpzCesium,
}

/// The treatment of the cameras in the folder of a training, or beside a scene file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Views {
    /// Reads them if there are any.
    #[default]
    Read,
    /// Ignores them.
    Ignore,
}

/// Reads a scene: a file of any format in [`FORMATS`], or the folder of a 3DGS training. Values of a
/// sidecar win over those in the scene file, key by key.
///
/// # Errors
/// [`FormatError`] if the path, the content, the sidecar or the cameras cannot be used.
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<Scene, FormatError> {
    Ok(read_scene_and_format(path, options)?.0)
}

/// Reads a scene and tells its format.
///
/// # Errors
/// [`FormatError`] if the path, the content, the sidecar or the cameras cannot be used.
pub fn read_scene_and_format(
    path: &Path,
    options: &ReadOptions,
) -> Result<(Scene, &'static SceneFormat), FormatError> {
    // What is small and may be wrong comes before what is large.
    let file = folder::scene_file(path)?;
    let sidecar = sidecar::read(&file)?;
    let views = match options.views {
        Views::Read => folder::views_of(path, &file)?,
        Views::Ignore => Vec::new(),
    };
    let (mut scene, format) = read_source(&mut Source::open(&file)?, options)?;
    scene.metadata = sidecar.unwrap_or_default().or(scene.metadata);
    scene.views.extend(views);
    origin::settle(&mut scene);
    Ok((scene, format))
}

/// Reads a scene from a stream: bytes in memory, a pipe. `name` is its name in messages, `length`
/// its bytes in all; with it, a count in a header can be checked before memory is taken.
///
/// # Errors
/// [`FormatError`] if the content cannot be used.
pub fn read_scene_from(name: &Path, reader: impl Read, length: Option<u64>) -> Result<Scene, FormatError> {
    let (mut scene, _) =
        read_source(&mut Source::new(name, Box::new(reader), length), &ReadOptions::default())?;
    origin::settle(&mut scene);
    Ok(scene)
}

/// Reads what a file has, in the axes of a PLY; [`origin::settle`] comes after.
fn read_source(
    source: &mut Source,
    options: &ReadOptions,
) -> Result<(Scene, &'static SceneFormat), FormatError> {
    let format = sniff(source)?;
    let mut scene = (format.read)(source, options)?;
    if scene.splats.is_empty() {
        return Err(source.whole(Problem::NoSplats));
    }
    format.axes.turn(&mut scene);
    Ok((scene, format))
}

fn sniff(source: &mut Source) -> Result<&'static SceneFormat, FormatError> {
    source.fill(SNIFFED)?;
    let bytes = &source.bytes()[..source.bytes().len().min(SNIFFED)];
    if bytes.is_empty() {
        return Err(source.whole(Problem::Empty));
    }
    let start = Start { bytes, path: source.path() };
    // Formats without a mark are known by the name alone, which pointers and pages that were saved
    // for a file have too.
    let format = FORMATS.iter().find(|format| (format.sniff)(&start)).filter(|_| !is_stand_in(bytes));
    format.ok_or_else(|| source.whole(unknown_format(source.path(), bytes)))
}

/// Writes a scene with the default options; see [`write_scene_with`].
///
/// # Errors
/// [`FormatError`] if no format has the extension, the scene cannot be stored, or the output cannot
/// be written; then `path` is as it was.
pub fn write_scene(path: &Path, scene: &Scene) -> Result<(), FormatError> {
    write_scene_with(path, scene, &WriteOptions::default())
}

/// Writes a scene in the format of the name of `path`, whole or not at all.
///
/// Metadata for which the format has no room goes into a sidecar beside it; otherwise a sidecar
/// beside `path` is left as it is, and wins when the scene is read. Views have no room in any
/// format ([`folder::write_cameras`] puts them beside it).
///
/// # Errors
/// [`FormatError`] if no format has the extension, the scene cannot be stored, or the output cannot
/// be written; then `path` is as it was.
pub fn write_scene_with(path: &Path, scene: &Scene, options: &WriteOptions) -> Result<(), FormatError> {
    let format = format_for(path)?;
    let fault = |problem| FormatError::whole(path, problem);
    scene.splats.check().map_err(|error| fault(error.into()))?;
    if scene.splats.is_empty() {
        return Err(fault(Problem::NoSplats));
    }
    match format.write {
        Writer::Stream(write) => write_atomically(path, |out| write(out, scene, options))?,
        // No name leads here: such a format has no extension.
        Writer::Nothing => {}
        Writer::Files(write) => write_files(path, |sink| write(scene, sink))?,
    }
    if format.loses.metadata == Retention::Beside && scene.metadata != Default::default() {
        write_sidecar(path, &scene.metadata)?;
    }
    Ok(())
}

/// Writes the files of a scene beside each other in the folder of `path`, which is made if it is
/// not there.
///
/// # Errors
/// [`FormatError`] if `write` fails or the system refuses.
pub(crate) fn write_files(
    path: &Path,
    write: impl FnOnce(&mut FileSink) -> Result<(), Problem>,
) -> Result<(), FormatError> {
    let fault = |problem| FormatError::whole(path, problem);
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|error| fault(error.into()))?;
    }
    // All files are complete before the first gets its name: one scene is not mixed with another.
    let mut complete = Vec::new();
    let mut sink = |file: NamedFile| {
        let temporary = TempFile::beside(&path.with_file_name(file.name))?;
        (&temporary).write_all(&file.bytes)?;
        complete.push(temporary);
        Ok(())
    };
    write(&mut sink).map_err(fault)?;
    for file in complete {
        file.persist().map_err(|refusal| fault(refusal.into()))?;
    }
    Ok(())
}

/// The format that a file with the name `path` is written in: that of its extension.
///
/// # Errors
/// [`FormatError`] if no format has the extension.
pub fn format_for(path: &Path) -> Result<&'static SceneFormat, FormatError> {
    by_extension(path).ok_or_else(|| {
        let extension = path.extension().map(|e| format!(".{}", excerpt(e.as_encoded_bytes())));
        let problem =
            Problem::UnknownExtension { extension: extension.unwrap_or_default(), known: endings() };
        FormatError::whole(path, problem)
    })
}

/// The ending for new files of each format, for messages and help.
#[must_use]
pub(crate) fn endings() -> String {
    let written = |f: &SceneFormat| {
        let ending = f.extensions.first()?;
        Some(if ending.contains(".json") { (*ending).to_owned() } else { format!(".{ending}") })
    };
    FORMATS.iter().filter_map(written).collect::<Vec<_>>().join(", ")
}

/// The format whose ending the name of `path` has; of several the longest, so that
/// `a.compressed.ply` is no plain PLY.
fn by_extension(path: &Path) -> Option<&'static SceneFormat> {
    let endings = FORMATS.iter().flat_map(|f| f.extensions.iter().map(move |e| (f, *e)));
    let fitting = endings.filter(|(_, ending)| has_ending(path, ending));
    fitting.max_by_key(|(_, ending)| ending.len()).map(|(format, _)| format)
}

/// Returns true if the name of `path` ends in a dot and `ending`, or is `ending`.
pub(crate) fn has_ending(path: &Path, ending: &str) -> bool {
    let name = path.file_name().unwrap_or_default().as_encoded_bytes();
    let Some(at) = name.len().checked_sub(ending.len()) else { return false };
    let (before, end) = name.split_at(at);
    end.eq_ignore_ascii_case(ending.as_bytes())
        && if ending.contains(".json") {
            before.is_empty()
        } else {
            before.ends_with(b".") && before.len() > 1
        }
}

/// Returns true if these first bytes are those of a text that stands in for a file: a Git LFS
/// pointer or a web page.
fn is_stand_in(start: &[u8]) -> bool {
    let text = start.trim_ascii_start();
    let begins = |tag: &[u8]| text.get(..tag.len()).is_some_and(|found| found.eq_ignore_ascii_case(tag));
    files::is_lfs_pointer(start) || begins(b"<!doctype") || begins(b"<html")
}

/// The problem of content that no format recognises.
fn unknown_format(path: &Path, start: &[u8]) -> Problem {
    let claim = match by_extension(path) {
        Some(format) => format!("not a {} file, although its name says so", format.name),
        None => {
            let names: Vec<&str> = FORMATS.iter().map(|f| f.name).collect();
            format!("of none of the formats that are read ({})", names.join(", "))
        }
    };
    let advice = if files::is_lfs_pointer(start) {
        files::LFS_REFUSED
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
