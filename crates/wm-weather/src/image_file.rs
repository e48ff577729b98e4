//! Pictures that parameters name: a path from the start, pixels once somebody has read them.
//!
//! Nothing here knows file formats: whoever does reads the pictures of a weather once, before the
//! first frame ([`crate::Weather::load_images`]).

use crate::panorama::Panorama;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A picture that is read or still to be read.
#[derive(Clone, PartialEq)]
pub struct ImageFile {
    path: PathBuf,
    panorama: Option<Arc<Panorama>>,
}

impl ImageFile {
    /// The picture of a path, still to be read.
    #[must_use]
    pub fn at(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), panorama: None }
    }

    /// The path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The decoded panorama; `None` until it is read.
    #[must_use]
    pub fn panorama(&self) -> Option<&Arc<Panorama>> {
        self.panorama.as_ref()
    }

    /// Takes a relative path as from `folder`.
    pub(crate) fn move_to(&mut self, folder: &Path) {
        self.path = folder.join(&self.path);
    }

    /// Gives it its pixels.
    pub(crate) fn fill(&mut self, panorama: Arc<Panorama>) {
        self.panorama = Some(panorama);
    }
}

impl fmt::Debug for ImageFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} {:?}", self.path, self.panorama)
    }
}
