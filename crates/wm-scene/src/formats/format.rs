//! A scene format, and the options of reading and writing.

use super::axes::Axes;
use super::loss::FormatLosses;
use crate::Scene;
use std::io::Write;
use std::path::Path;
use wm_base::error::{FormatError, Problem};
use wm_base::files::TempFile;
use wm_base::source::Source;

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
    pub(super) axes: Axes,
    /// The parts of a scene that it loses.
    pub loses: FormatLosses,
    /// Recognises a file of this format by its first bytes.
    pub(super) sniff: fn(&Start) -> bool,
    pub(super) read: fn(&mut Source, &ReadOptions) -> Result<Scene, FormatError>,
    pub(super) write: Writer,
}

/// The writer of a format. Writers get the scene in the axes of a PLY, and turn what they write.
pub(super) enum Writer {
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
    /// First bytes, at most [`SNIFFED_BYTES`].
    pub(crate) bytes: &'a [u8],
    /// Name, or that of the stream.
    pub(crate) path: &'a Path,
}

/// Bytes at the start of a file that tell its format.
pub(crate) const SNIFFED_BYTES: usize = 4096;

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
