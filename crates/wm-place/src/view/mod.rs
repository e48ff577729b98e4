//! Cameras: their text form, paths through time, and a good view of a scene
//! if none is given.
//!
//! - [`spec`]: `--camera` and the options beside it.
//! - [`path`]: a camera as a function of time, from a file of keyframes.
//! - [`moves`]: the built-in paths: orbit, dolly, along the photos.
//! - [`choose`]: a good view of any scene. It tests free space (`space`) and rates small
//!   renders (`rate`).

pub(crate) mod candidates;
pub mod choose;
mod foreign;
mod json;
pub mod moves;
pub mod path;
mod rate;
pub(crate) mod space;
pub mod spec;
#[cfg(test)]
mod testing;

use glam::DVec3;
use thiserror::Error;
use wm_base::FormatError;
use wm_base::error::escaped;
use wm_render::{
    DrawPass, Frame, Geometry, Outputs, RenderBackend, RenderConfig, RenderError, SetId, SetView,
};
use wm_scene::{Camera, CameraError, Scene, survey::Survey};

/// Default vertical field of view, degrees.
pub const DEFAULT_FOV: f64 = 50.0;

/// Default picture size, px.
pub const DEFAULT_SIZE: (u32, u32) = (1280, 720);

/// Camera settings that win over those of files and photos.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewOptions {
    /// Up in world axes, of any length but 0; else the survey's.
    pub up: Option<DVec3>,
    /// Vertical field of view, degrees; else that of the photo or file, or [`DEFAULT_FOV`].
    pub fov: Option<f64>,
    /// Near plane, scene units; else the file's, or what suits the scene's size.
    pub near: Option<f64>,
    /// Picture width and height, px; else the photo's, or [`DEFAULT_SIZE`].
    pub size: Option<(u32, u32)>,
}

impl ViewError {
    /// A text that cannot be understood, on one line.
    fn text(what: &'static str, text: &str, problem: impl Into<String>) -> Self {
        // The problem may quote the text.
        Self::Text { what, text: escaped(text), problem: escaped(&problem.into()) }
    }
}

impl ViewOptions {
    /// Up in world axes, length 1.
    #[must_use]
    pub fn up(&self, survey: &Survey) -> DVec3 {
        self.up.and_then(DVec3::try_normalize).unwrap_or(survey.up.value)
    }

    /// Near plane, scene units: that of the reference 3DGS viewers, less in small scenes.
    #[must_use]
    pub fn near(&self, survey: &Survey) -> f64 {
        let usual = Camera::DEFAULT_NEAR;
        let suits = if survey.radius > 0.0 { usual.min(0.01 * survey.radius) } else { usual };
        self.near.unwrap_or(suits)
    }

    /// Picture width and height, px.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        self.size.unwrap_or(DEFAULT_SIZE)
    }
}

/// A scene to look for views in: its splats in a renderer, and its survey.
pub struct ViewSearch<'a> {
    /// The renderer that holds the splats.
    pub renderer: &'a mut dyn RenderBackend,
    /// The handle of the splats.
    pub set: SetId,
    /// The scene; its sky should be labelled.
    pub scene: &'a Scene,
    /// The survey of the scene.
    pub survey: &'a Survey,
    /// The camera settings.
    pub options: ViewOptions,
}

impl ViewSearch<'_> {
    /// Renders colour before black, alpha and depth of a set of the scene's splats.
    fn look(&mut self, set: SetId, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        let outputs = Outputs { geometry: Geometry::Depth, ..Outputs::default() };
        let rasterization = self.scene.metadata.rasterization.unwrap_or_default();
        let config = RenderConfig { outputs, rasterization, ..RenderConfig::default() };
        let sets = [SetView::plain(set)];
        let job = DrawPass::new(&sets, camera, &config);
        self.renderer.render(&job, frame)?;
        Ok(())
    }
}

/// The error of a camera or path that cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewError {
    /// A text on the command line cannot be understood.
    #[error("{what} \"{text}\": {problem}")]
    Text {
        /// The name of the option.
        what: &'static str,
        /// The text of it.
        text: String,
        /// The problem and the expected form.
        problem: String,
    },
    /// A camera file cannot be read or written.
    #[error(transparent)]
    File(#[from] FormatError),
    /// Keyframes that make no path.
    #[error("camera path: {0}")]
    Path(String),
    /// Numbers that make no camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The views to choose from could not be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The scene has no such camera or path.
    #[error("{0}")]
    Scene(String),
}
