//! Errors of maps, in one line each.

use std::path::PathBuf;
use thiserror::Error;

/// A map that cannot be used.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{}: {fault}", path.display())]
pub struct MapError {
    /// The file, or the folder that it should be in.
    pub path: PathBuf,
    /// The fault.
    pub fault: MapFault,
}

/// A fault of a map.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MapFault {
    /// The system refuses it.
    #[error("cannot be read: {0}")]
    Unreadable(String),
    /// The first bytes are of no known format.
    #[error("no map: PNG, TIFF, EXR and NPY are read; convert it to one of them")]
    Unknown,
    /// It does not decode.
    #[error("the map is damaged ({0}); make or copy it again")]
    Damaged(String),
    /// It is a file of a known format that holds something else.
    #[error("{0}; save it again as float32, or as 16-bit PNG")]
    Unsupported(String),
    /// More than can be held.
    #[error("{0} are more than a map may have; make it smaller")]
    Large(String),
    /// Too few or too many numbers a pixel.
    #[error("{found} different channels, but {wanted} expected; choose another file or save it anew")]
    Channels {
        /// The number of channels.
        found: u32,
        /// The number that is needed.
        wanted: &'static str,
    },
    /// The aspect ratio is not that of the photo.
    #[error(
        "the map is {width}x{height} px, its photo {photo_width}x{photo_height}; make the map of the whole photo, of any \
         size but the same aspect ratio"
    )]
    Aspect {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// Width of the photo, px.
        photo_width: u32,
        /// Height of the photo, px.
        photo_height: u32,
    },
    /// Two files for one photo.
    #[error("{0}")]
    Ambiguous(String),
    /// Depth in steps of unknown length.
    #[error("holds whole numbers and does not say what one of them is; give the unit of depth, such as mm")]
    NoUnit,
    /// Normals that no camera could see.
    #[error(
        "{share:.0} % of its normals look away from the camera; they are in other axes, or turned inwards"
    )]
    Away {
        /// The share of the known normals, percent.
        share: f64,
    },
}
