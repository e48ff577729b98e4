//! A lens in words: the text form that options and files name it by.

use super::view::LensView;
use crate::Result;
use std::path::PathBuf;
use std::str::FromStr;
use wm_scene::LensModel;

/// Default width and height of pictures through a fisheye, and of a panorama, px.
const FISHEYE_SIZE: (u32, u32) = (1024, 1024);
const PANORAMA_SIZE: (u32, u32) = (2048, 1024);
/// Default angle across a fisheye, degrees.
const FISHEYE_DEGREES: f64 = 180.0;

/// A lens in words: `fisheye`, `fisheye:DEGREES`, `equirectangular`, or the name of a `.toml` file
/// ([`LensModel::read`]).
#[derive(Clone, Debug, PartialEq)]
pub enum LensSpec {
    /// An equidistant fisheye, degrees across the shorter side of the picture.
    Fisheye(f64),
    /// A panorama.
    Equirectangular,
    /// A TOML file.
    File(PathBuf),
}

impl FromStr for LensSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':').unwrap_or((text, "")) {
            ("fisheye", "") => Ok(Self::Fisheye(FISHEYE_DEGREES)),
            ("fisheye", degrees) => match degrees.parse::<f64>() {
                Ok(degrees) if degrees > 0.0 && degrees <= 360.0 => Ok(Self::Fisheye(degrees)),
                _ => Err(format!("`{degrees}` is not an angle above 0 and up to 360 degrees")),
            },
            ("equirectangular", "") => Ok(Self::Equirectangular),
            _ if text.to_lowercase().ends_with(".toml") => Ok(Self::File(text.into())),
            _ => Err(format!(
                "`{text}` is not a lens: use fisheye, fisheye:DEGREES, equirectangular or a .toml file"
            )),
        }
    }
}

impl LensSpec {
    /// The lens in a picture of a size, px; with `None` in one of its own.
    ///
    /// # Errors
    /// As [`LensModel::read`] and [`LensView::new`].
    pub fn view(&self, size: Option<(u32, u32)>) -> Result<LensView> {
        let (lens, camera) = match self {
            Self::Fisheye(degrees) => LensModel::fisheye(size.unwrap_or(FISHEYE_SIZE), *degrees)?,
            Self::Equirectangular => {
                let (_, camera) = LensModel::fisheye(size.unwrap_or(PANORAMA_SIZE), FISHEYE_DEGREES)?;
                (LensModel::Equirectangular, camera)
            }
            Self::File(path) => {
                let (lens, camera) = LensModel::read(path)?;
                (lens, size.map_or(camera, |(width, height)| camera.resized(width, height)))
            }
        };
        LensView::new(lens, &camera)
    }
}
