//! The description of one frame.

use crate::frame_camera::FrameCamera;
use crate::layers::Layers;
use crate::shot::{MovingCamera, Patience};
use wm_scene::Camera;
use wm_weather::Weather;

/// The frame that optical flow leads to.
#[derive(Clone, Copy, Debug)]
pub struct NextFrame {
    /// The instant of the weather, s.
    pub time: f64,
    /// The camera; the lens is that of the request.
    pub camera: MovingCamera,
}

/// The description of one frame: what is rendered, from where, when, and what is wanted of it.
///
/// ```
/// use wm_place::{Camera, FrameRequest, Layers, PictureLayer, Renderer, Weather};
///
/// # let scene = wm_street::Street::builtin().sampling(0.1).scene(&|_| true).unwrap();
/// let mut renderer = Renderer::cpu()?;
/// let mut place = renderer.load(scene)?;
/// let weather = Weather::preset("fog")?;
/// let camera = Camera::look_at([4.0, -20.0, 1.8], [4.0, -30.0, 1.8]).size(96, 64);
/// let layers = Layers::COLOR | Layers::DEPTH;
/// let request = FrameRequest { layers, ..FrameRequest::new(&weather, camera, 0.0) };
/// let picture = renderer.render(&mut place, &request)?;
/// assert_eq!(picture.layer(PictureLayer::Depth).len(), 96 * 64); // metres
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    /// The weather.
    pub weather: &'a Weather,
    /// The camera.
    pub camera: FrameCamera<'a>,
    /// The instant of the weather, s: for a device the middle of the exposure of the first line.
    pub time: f64,
    /// The number of the frame: the noise of a device depends on it.
    pub index: u32,
    /// The layers of the picture.
    pub layers: Layers,
    /// The next frame, for the layers that lead to it.
    pub next: Option<NextFrame>,
    /// The camera of the frame before, for the layers that lead back to it; `None` in the first.
    pub previous: Option<Camera>,
    /// The treatment of assets that are not made yet.
    pub patience: Patience,
}

impl<'a> FrameRequest<'a> {
    /// A complete frame with the colour alone.
    pub fn new(weather: &'a Weather, camera: impl Into<FrameCamera<'a>>, time: f64) -> Self {
        Self {
            weather,
            camera: camera.into(),
            time,
            index: 0,
            layers: Layers::COLOR,
            next: None,
            previous: None,
            patience: Patience::Whole,
        }
    }
}
