//! Captures: photographed views from a folder, one module a format, one line a format in the list
//! below.
//!
//! A format looks whether a folder is one of its own and gives its [`View`]s, with OpenCV axes and
//! without distortion. To add one: a module with a `FORMAT`, and its name in the list.

use crate::{FormatError, Problem, View};
use std::{fs, path::Path};

macro_rules! captures {
    ($($name:ident),+ $(,)?) => {
        $(pub mod $name;)+

        /// Every capture format, in the order in which they are tried.
        pub const FORMATS: &[Format] = &[$($name::FORMAT),+];
    };
}

captures! { colmap }

/// A capture format.
pub struct Format {
    /// Its name in messages.
    pub name: &'static str,
    /// What it is, in one line.
    pub about: &'static str,
    /// The views of a folder; `None` if it is no folder of this format.
    read: fn(&Path) -> Result<Option<Vec<View>>, FormatError>,
}

/// Reads the views of a capture, sorted by name.
///
/// # Errors
/// [`FormatError`] if the folder is missing, of no known format, or broken.
pub fn read_views(folder: &Path) -> Result<Vec<View>, FormatError> {
    let about = fs::metadata(folder).map_err(|e| FormatError::reading(folder, e))?;
    if !about.is_dir() {
        return Err(FormatError::whole(folder, Problem::NoCapture));
    }
    for format in FORMATS {
        if let Some(mut views) = (format.read)(folder)? {
            views.sort_by(|a, b| a.name.cmp(&b.name));
            return Ok(views);
        }
    }
    Err(FormatError::whole(folder, Problem::NoCapture))
}
