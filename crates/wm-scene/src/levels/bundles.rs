//! The files of a scene in levels as SOG bundles: one file in place of a folder, where each file is
//! a request.

use super::LevelIndex;
use super::writer::write_json;
use crate::formats::sog::read::{below, fault, is_bundle, parse, picture_names, read_file};
use crate::formats::sog::zip;
use serde_json::Value;
use std::path::Path;
use wm_base::{
    FormatError,
    files::{self, write_atomically},
};

/// The bundle that stands for the file of an index: that of its folder.
fn bundle_of(name: &str) -> String {
    match name.strip_suffix("/meta.json") {
        Some(folder) => format!("{folder}.sog"),
        None if name.ends_with(".sog") => name.to_owned(),
        None => format!("{name}.sog"),
    }
}

impl LevelIndex {
    /// Writes a file of [`Self::files`], or the environment, as a SOG bundle below `folder`, which
    /// gets the folders that its name has.
    ///
    /// # Errors
    /// [`FormatError`] if it or one of its pictures is not there, its `meta.json` is damaged, or
    /// the bundle cannot be written.
    pub fn write_bundle(&self, name: &str, folder: &Path) -> Result<(), FormatError> {
        let main = below(self.path(), name).map_err(|problem| FormatError::whole(self.path(), problem))?;
        let whole = |problem| FormatError::whole(&main, problem);
        let meta = read_file(&main).map_err(whole)?;
        // A name that does not lead out gives one that does not.
        let path = folder.join(bundle_of(name));
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|error| FormatError::whole(folder, error.into()))?;
        }
        if is_bundle(&meta) {
            return write_atomically(&path, |out| Ok(out.write_all(&meta)?));
        }
        let mut pictures = Vec::new();
        for name in picture_names(&meta).map_err(whole)? {
            let bytes = below(&main, &name).and_then(|path| read_file(&path)).map_err(whole)?;
            pictures.push((name, bytes));
        }
        write_atomically(&path, |out| {
            let mut archive = zip::Writer::new(out);
            archive.add("meta.json", &meta)?;
            pictures.iter().try_for_each(|(name, bytes)| archive.add(name, bytes))?;
            archive.finish()
        })
    }

    /// Writes this index to `main` with the names of the bundles in place of those of the files.
    /// All else of it stays as it is.
    ///
    /// # Errors
    /// [`FormatError`] if it cannot be read again or written.
    pub fn write_bundled(&self, main: &Path) -> Result<(), FormatError> {
        let text = files::read(self.path()).map_err(|error| FormatError::reading(self.path(), error))?;
        let whole = |problem| FormatError::whole(self.path(), problem);
        let mut index: Value = parse(&text, "lod-meta.json").map_err(whole)?;
        let fields = index.as_object_mut().ok_or_else(|| whole(fault("lod-meta.json is no object")))?;
        let names: Vec<String> = self.files.iter().map(|name| bundle_of(name)).collect();
        fields.insert("filenames".into(), names.into());
        if let Some(name) = &self.environment {
            fields.insert("environment".into(), bundle_of(name).into());
        }
        write_json(main, &index)
    }
}
