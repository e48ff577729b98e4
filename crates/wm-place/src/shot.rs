//! One pinhole picture of one instant: the unit that frames of all cameras consist of.

use crate::{Error, Result};
use wm_render::Outputs;
use wm_render::parts::PicturePart;
use wm_scene::Camera;
use wm_weather::Weather;

/// Fastest camera, m/s: the streaks of what falls, and the volume that they are drawn from, grow
/// with the speed.
const MAX_SPEED: f64 = 1000.0;

/// A camera and its motion.
#[derive(Clone, Copy, Debug)]
pub struct MovingCamera {
    /// The camera.
    pub camera: Camera,
    /// Velocity, m/s, world axes. Falling particles are streaked by it.
    pub velocity: [f64; 3],
}

impl MovingCamera {
    /// Checks that what falls can be drawn in front of the camera.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if it is faster than 1000 m/s.
    pub fn check_speed(&self) -> Result<()> {
        let speed = glam::DVec3::from_array(self.velocity).length();
        if speed <= MAX_SPEED {
            return Ok(());
        }
        Err(Error::Unsupported(format!(
            "the camera moves at {speed:.4e} m/s: rain and snow can be drawn up to {MAX_SPEED} m/s; check the times of the path \
             and the metres per unit"
        )))
    }
}

impl From<Camera> for MovingCamera {
    /// A camera at rest.
    fn from(camera: Camera) -> Self {
        Self { camera, velocity: [0.0; 3] }
    }
}

/// The treatment of assets that are not made yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Patience {
    /// Every frame is complete: what is missing is made first.
    #[default]
    Whole,
    /// Frames are drawn with what there is, for a camera that moves: snow may be missing or of
    /// another instant, and roofs may not stop the rain.
    Draft,
}

/// The passes of a pinhole picture that are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PinholeContent {
    /// The whole picture.
    #[default]
    Picture,
    /// Coverage, expected and median depth alone, whatever outputs are set: of the scene, of what
    /// lies on it and of water. There is no air, nothing falls, and the colours are those of no
    /// weather.
    Geometry,
    /// No picture: the falling particles that it would show.
    Particles,
}

/// A pinhole picture of one instant: the unit that frames of all cameras consist of.
#[derive(Clone, Copy)]
pub(crate) struct PinholeShot<'a> {
    pub weather: &'a Weather,
    /// s.
    pub time: f64,
    pub camera: MovingCamera,
    /// The camera of the whole picture, where the camera shows a part of it: large splats are drawn
    /// as they are there.
    pub whole: Option<Camera>,
    pub outputs: Outputs,
    /// Parts of the picture that are rendered with it.
    pub parts: &'a [PicturePart],
    /// Keep the steps of the paper's rain and snow.
    pub stages: bool,
    pub patience: Patience,
    pub content: PinholeContent,
}
