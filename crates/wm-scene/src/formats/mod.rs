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
pub(crate) mod format;
mod loss;
mod pack;
pub mod sidecar;

use crate::{Scene, origin};
use wm_base::{
    error::{FormatError, Problem, excerpt},
    files::{self, write_atomically},
    source::Source,
};
#[cfg(test)]
mod fetched_tests;

pub use axes::Axes;
use folder::{cameras_path, write_cameras};
pub use format::{DetailLevel, GltfSplats, ReadOptions, SceneFormat, SpzVersion, Views, WriteOptions};
use format::{SNIFFED_BYTES, Start, Writer, has_ending, write_files};
pub use loss::{FormatLosses, Retention, lost};
pub use ply::read_points;
pub use sidecar::{sidecar_path, write_sidecar};
use std::{io::Read, path::Path};

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
mod sog_levels;
mod splat;
mod spz;

formats! { ply, ply::compressed, spz, sog::bundle, sog::folder, sog_levels, gltf, splat, ksplat }

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

impl Scene {
    /// Reads a scene: a file of any of the [`crate::formats`], or the folder of a 3DGS training.
    ///
    /// [`read_scene`] has options, and also reads scenes with broken splats, which
    /// [`Scene::repaired`] removes.
    ///
    /// # Errors
    /// [`FormatError`] if the path, the content, the sidecar or the cameras cannot be used, or a
    /// splat holds a number that is not finite ([`Problem::NonFinite`]).
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let path = path.as_ref();
        let scene = read_scene(path, &ReadOptions::default())?;
        scene
            .splats
            .check_finite()
            .map_err(|e| FormatError::whole(path, Problem::NonFinite(e.to_string())))?;
        Ok(scene)
    }

    /// Writes the scene in the format that the name of `path` ends in, whole or not at all.
    ///
    /// Metadata goes into the file, or into a sidecar beside it if the format has no room. Views go
    /// into `<path>.cameras.json`, where [`Scene::open`] finds them.
    ///
    /// # Errors
    /// [`FormatError`] if no format has the extension, the scene cannot be stored, or the file
    /// cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FormatError> {
        let path = path.as_ref();
        write_scene(path, self)?;
        if self.views.is_empty() { Ok(()) } else { write_cameras(&cameras_path(path), &self.views) }
    }
}

/// Reads a scene: a file of any format in [`FORMATS`], or the folder of a 3DGS training. Values of
/// a sidecar win over those in the scene file, key by key.
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
    source.fill(SNIFFED_BYTES)?;
    let bytes = &source.bytes()[..source.bytes().len().min(SNIFFED_BYTES)];
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
