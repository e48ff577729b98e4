//! Errors and warnings of the library.

use crate::panorama_file::PanoramaFileError;
use crate::view::ViewError;
use thiserror::Error;
use wm_base::FormatError;
use wm_image::MediaError;
use wm_render::RenderError;
use wm_scene::CameraError;
use wm_scene::survey::AlignError;
use wm_sensors::SensorError;
use wm_weather::{Fidelity, Weather, WeatherError};

/// The errors of the library. Each message is one line that names the file, field or value.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A scene, capture or camera file cannot be read or written.
    #[error(transparent)]
    Format(Box<FormatError>),
    /// A weather or one of its parameters is wrong.
    #[error(transparent)]
    Weather(#[from] WeatherError),
    /// The picture of a sky cannot be read.
    #[error(transparent)]
    Panorama(#[from] PanoramaFileError),
    /// A camera cannot be rendered with.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A camera path or a view of the scene cannot be found.
    #[error(transparent)]
    View(Box<ViewError>),
    /// Facts that are set by hand cannot be used.
    #[error(transparent)]
    Align(#[from] AlignError),
    /// The renderer failed.
    #[error(transparent)]
    Render(Box<RenderError>),
    /// A picture or video cannot be written.
    #[error(transparent)]
    Media(#[from] MediaError),
    /// A lidar, a radar or a file of their points cannot be used.
    #[error(transparent)]
    Sensor(Box<SensorError>),
    /// Work of a crate that uses places failed, such as a data set.
    #[error(transparent)]
    Work(Box<dyn std::error::Error + Send + Sync>),
    /// The request cannot be carried out with this scene or weather.
    #[error("{0}")]
    Unsupported(String),
    /// The place was loaded by another renderer.
    #[error("this place was loaded by another renderer: load the scene with the renderer that draws it")]
    OtherRenderer,
    /// The caller stopped the work.
    #[error("stopped: nothing is written")]
    Stopped,
}

/// Boxes the large errors, so that results stay small.
macro_rules! boxed {
    ($($variant:ident($error:ty)),+ $(,)?) => {
        $(impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Self::$variant(Box::new(error))
            }
        })+
    };
}

boxed! {
    Format(FormatError), View(ViewError), Render(RenderError), Sensor(SensorError),
}

/// The result of this library's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Refuses the paper's weather, which has no physical units.
pub(crate) fn check_physical(weather: &Weather, kind: &str) -> Result<()> {
    match weather.fidelity {
        Fidelity::Physical => Ok(()),
        Fidelity::Paper => {
            let says = format!("a {kind} needs weather in physical units: use fidelity `physical`");
            Err(Error::Unsupported(says))
        }
    }
}
