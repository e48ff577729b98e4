//! The eye that sees a weather.

use crate::light::LampsOn;
use crate::shelter::Shelter;
use crate::splash::SplashGround;
use wm_scene::Camera;

/// The eye that sees a weather, and what is known about it.
#[derive(Clone, Copy, Debug)]
pub struct Observer<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Velocity of the camera, m/s, world axes: what falls is streaked by it.
    pub velocity: [f64; 3],
    /// The map of sheltered places; `None` where it is not known.
    pub shelter: Option<&'a Shelter>,
    /// The lamps that shine; `None` where there are none, or their shadows are not known.
    pub lamps: Option<&'a LampsOn<'a>>,
    /// The wet ground that rain splashes on; `None` where there is none.
    pub splashes: Option<&'a SplashGround<'a>>,
    /// True if what it sees is shown within another picture, with which it is graded.
    pub is_within: bool,
    /// Threads for what is made for the whole frame; `None` for those of the caller.
    pub pool: Option<&'a rayon::ThreadPool>,
}

impl<'a> Observer<'a> {
    /// An eye at a camera that stands still, in the open.
    #[must_use]
    pub fn at_rest(camera: &'a Camera) -> Self {
        Self {
            camera,
            velocity: [0.0; 3],
            shelter: None,
            lamps: None,
            splashes: None,
            is_within: false,
            pool: None,
        }
    }
}
