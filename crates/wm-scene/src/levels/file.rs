//! One file of a scene in levels: the splats of many leaves at one level.

use crate::{
    Metadata, Remark, Splats,
    formats::sog::read::{SogPictures, read_pictures},
};
use std::path::{Path, PathBuf};
use wm_base::FormatError;

/// A decoded file of a [`super::LevelIndex`]: 28 bytes a splat, and its palette. Splats are made of
/// any run of it.
pub struct LevelFile {
    path: PathBuf,
    pictures: SogPictures,
}

impl LevelFile {
    /// Reads and decodes a folder by its `meta.json`, or a bundle.
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let pictures = read_pictures(path).map_err(|problem| FormatError::whole(path, problem))?;
        Ok(Self { path: path.into(), pictures })
    }

    /// Number of splats.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.pictures.len()
    }

    /// The facts that it states.
    #[must_use]
    pub fn metadata(&self) -> &Metadata {
        &self.pictures.metadata
    }

    /// Lines on what is odd in its `meta.json`.
    #[must_use]
    pub(crate) fn remarks(&self) -> &[Remark] {
        &self.pictures.remarks
    }

    /// The splats from `offset`, `count` of them.
    ///
    /// # Errors
    /// [`FormatError`] if there are fewer, or a value of theirs is not known.
    pub fn splats(&self, offset: u64, count: u64) -> Result<Splats, FormatError> {
        // Larger numbers than a computer counts are larger than the file.
        let [start, end] =
            [offset, offset.saturating_add(count)].map(|v| usize::try_from(v).unwrap_or(usize::MAX));
        self.pictures.splats(start..end).map_err(|problem| FormatError::whole(&self.path, problem))
    }
}
