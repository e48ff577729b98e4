//! The layout of pictures: a folder or an array of embeddings by itself, or a folder of a method
//! with weathers and scenes.

use super::cache::UNFINISHED;
use crate::names::stem_of;
use anyhow::{Context, Result, bail};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use weather_magician::train::photos::photos_in;

/// A class of weather: a column of the paper's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum WeatherClass {
    /// Fog, haze and smog.
    Fog,
    Rain,
    /// Falling and lying snow; photographs show both.
    Snow,
}

impl WeatherClass {
    pub(crate) const ALL: [Self; 3] = [Self::Fog, Self::Rain, Self::Snow];

    /// Returns the name of its folder and in files.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Fog => "fog",
            Self::Rain => "rain",
            Self::Snow => "snow",
        }
    }

    /// Returns the title of its column in the paper.
    pub(crate) const fn title(self) -> &'static str {
        match self {
            Self::Fog => "Fog / Haze / Smog",
            Self::Rain => "Rainfall",
            Self::Snow => "Snow",
        }
    }

    /// Returns the class for the name of a folder.
    pub(crate) fn of(name: &str) -> Option<Self> {
        match name.to_lowercase().as_str() {
            "fog" | "haze" | "smog" => Some(Self::Fog),
            "rain" | "rainfall" => Some(Self::Rain),
            "snow" | "snowfall" | "snow-cover" => Some(Self::Snow),
            _ => None,
        }
    }
}

/// A set of pictures that is compared as a whole.
#[derive(Clone, Debug)]
pub(crate) struct PictureSet {
    /// The name.
    pub(crate) name: String,
    /// The folder or the array.
    pub(crate) path: PathBuf,
    /// The path relative to the folder of its method, without extension.
    pub(crate) place: PathBuf,
    pub(crate) scene: Option<String>,
    pub(crate) source: PictureSource,
}

/// The content of a picture set.
#[derive(Clone, Debug)]
pub(crate) enum PictureSource {
    /// Picture files, sorted.
    Pictures(Vec<PathBuf>),
    /// An array of embeddings.
    Array,
}

/// Returns the name of a folder of pictures.
pub(crate) fn name_of(path: &Path) -> String {
    stem_of(path)
}

/// Returns true for a file of embeddings, except one of unfinished work.
fn is_array(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_whole = !name.ends_with(&format!(".{UNFINISHED}.npy"));
    name.ends_with(".npy") && is_whole && path.is_file()
}

impl PictureSet {
    /// Opens a folder with all pictures below it, or an array.
    pub(crate) fn whole(path: &Path) -> Result<Self> {
        let source = if is_array(path) {
            PictureSource::Array
        } else if path.is_file() {
            bail!(
                "{}: is a single file; give a folder of pictures, or an NPY file of embeddings",
                path.display()
            );
        } else {
            let (files, others) = photos_in(path)?;
            if files.is_empty() {
                let others = if others > 0 { format!(" among {others} files") } else { String::new() };
                bail!(
                    "{}: there is no picture (JPEG or PNG) in it{others}; name another folder",
                    path.display()
                );
            }
            PictureSource::Pictures(files)
        };
        let name = name_of(path);
        Ok(Self { place: PathBuf::from(&name), name, path: path.into(), scene: None, source })
    }
}

/// Returns the picture sets of a method's folder: `fog.npy`, or a folder `fog` with pictures, or
/// with one folder or array per scene.
pub(crate) fn parts(folder: &Path) -> Result<Vec<(WeatherClass, PictureSet)>> {
    let mut found = Vec::new();
    for path in entries(folder)? {
        let Some(weather) = path.file_stem().and_then(OsStr::to_str).and_then(WeatherClass::of) else {
            continue;
        };
        let place = |path: &Path| path.strip_prefix(folder).unwrap_or(path).with_extension("");
        if is_array(&path) {
            found.push((weather, PictureSet { place: place(&path), ..PictureSet::whole(&path)? }));
        } else if path.is_dir() {
            let inside = entries(&path)?;
            let before = found.len();
            let files: Vec<PathBuf> = photos_in(&path)?.0;
            let direct: Vec<PathBuf> =
                files.iter().filter(|file| file.parent() == Some(&path)).cloned().collect();
            if !direct.is_empty() {
                let (name, source) = (name_of(&path), PictureSource::Pictures(direct));
                found.push((
                    weather,
                    PictureSet { name, path: path.clone(), place: place(&path), scene: None, source },
                ));
            }
            let holds_pictures = |scene: &Path| files.iter().any(|file| file.starts_with(scene));
            for scene in
                inside.iter().filter(|scene| is_array(scene) || scene.is_dir() && holds_pictures(scene))
            {
                let part = PictureSet::whole(scene)?;
                // Names of folders may have dots in them.
                let inner = if scene.is_dir() {
                    scene.strip_prefix(folder).unwrap_or(scene).into()
                } else {
                    place(scene)
                };
                found.push((weather, PictureSet { place: inner, scene: Some(part.name.clone()), ..part }));
            }
            if found.len() == before {
                bail!(
                    "{}: there is no picture (JPEG or PNG) and no NPY file in it; put some there",
                    path.display()
                );
            }
        }
    }
    if found.is_empty() {
        bail!(
            "{}: there is no folder fog, rain or snow in it, nor an NPY file of one of these names; sort the pictures into \
             such folders",
            folder.display()
        );
    }
    Ok(found)
}

/// Returns the entries of a folder, by name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let listed = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    let mut listed: Vec<PathBuf> = listed.with_context(|| format!("{}: cannot be read", folder.display()))?;
    listed.sort();
    Ok(listed)
}
