//! Errors of photos, in one line each.

use std::{fmt, path::PathBuf};
use thiserror::Error;
use wm_image::photo::{DecodeError, DecodeFault};

/// A photo that cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{}: {fault}", path.display())]
pub struct PhotoError {
    /// The file, or where it should be.
    pub path: PathBuf,
    /// The fault.
    pub fault: PhotoFault,
}

/// A fault of a photo.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum PhotoFault {
    /// There is no file.
    #[error("the photo is missing; --images names the folder of the photos")]
    Missing,
    /// It cannot be read, or is no JPEG or PNG.
    #[error("{0}")]
    Unreadable(String),
    /// The size is not that of the camera, nor that size scaled as a whole.
    #[error(
        "the photo is {width}x{height} px, its camera {camera_width}x{camera_height}; give the photos that the model was made from"
    )]
    Size {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// Width of the camera, px.
        camera_width: u32,
        /// Height of the camera, px.
        camera_height: u32,
    },
    /// It is too small to learn from.
    #[error(
        "the photo is {width}x{height} px, too small to learn from; give photos of at least {least} px a side"
    )]
    Small {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// The least side, px.
        least: u32,
    },
    /// The lens cannot be undone.
    #[error(
        "the distortion of its camera folds over within the photo; reconstruct the capture with another camera model"
    )]
    Lens,
    /// It does not decode.
    #[error("the photo is damaged ({0}); copy it again")]
    Damaged(String),
    /// The mask has another size than the photo.
    #[error(
        "the mask is {width}x{height} px, the photo {photo_width}x{photo_height}; make the mask as large as the photo"
    )]
    Mask {
        /// Width, px.
        width: u32,
        /// Height, px.
        height: u32,
        /// Width of the photo, px.
        photo_width: u32,
        /// Height of the photo, px.
        photo_height: u32,
    },
}

/// Photos that cannot be used, where none may be left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhotoErrors {
    /// At least one.
    pub errors: Vec<PhotoError>,
    /// Photos in all.
    pub photos: usize,
}

impl std::error::Error for PhotoErrors {}

impl fmt::Display for PhotoErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(first) = self.errors.first() else { return write!(f, "there are no photos") };
        write!(f, "{first}")?;
        match self.errors.len() {
            1 => write!(f, " (--skip-bad goes on without it)"),
            count if count == self.photos => write!(f, " (so are all {count} photos)"),
            count => {
                write!(f, " (and {} more of {}; --skip-bad goes on without them)", count - 1, self.photos)
            }
        }
    }
}

impl From<DecodeError> for PhotoError {
    fn from(DecodeError { path, fault }: DecodeError) -> Self {
        let fault = match fault {
            DecodeFault::Damaged(what) => PhotoFault::Damaged(what),
            other => PhotoFault::Unreadable(other.to_string()),
        };
        Self { path, fault }
    }
}
