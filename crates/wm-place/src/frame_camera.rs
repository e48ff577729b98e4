//! The camera of a frame: a pinhole, or a device.

use crate::camera_model::SensorCamera;
use crate::drawing::Drawing;
use crate::shot::{MovingCamera, PinholeShot};
use crate::view::ViewOptions;
use crate::{LensView, Picture, PreparedPlace, Result};
use wm_render::Stats;
use wm_scene::{Camera, LookAt};

/// The camera of a frame.
#[derive(Clone, Copy, Debug)]
pub enum FrameCamera<'a> {
    /// A pinhole.
    Pinhole(MovingCamera),
    /// A pinhole that looks at a point; the place decides where up is, and the near plane.
    LookAt(LookAt),
    /// A camera as a device, where its motion has it at the time of the frame.
    Device(&'a SensorCamera),
}

impl From<Camera> for FrameCamera<'_> {
    fn from(camera: Camera) -> Self {
        Self::Pinhole(camera.into())
    }
}

impl From<&Camera> for FrameCamera<'_> {
    fn from(camera: &Camera) -> Self {
        Self::from(*camera)
    }
}

impl From<MovingCamera> for FrameCamera<'_> {
    fn from(camera: MovingCamera) -> Self {
        Self::Pinhole(camera)
    }
}

impl From<LookAt> for FrameCamera<'_> {
    fn from(look: LookAt) -> Self {
        Self::LookAt(look)
    }
}

impl From<&LookAt> for FrameCamera<'_> {
    fn from(look: &LookAt) -> Self {
        Self::LookAt(*look)
    }
}

impl<'a> From<&'a SensorCamera> for FrameCamera<'a> {
    fn from(camera: &'a SensorCamera) -> Self {
        Self::Device(camera)
    }
}

impl FrameCamera<'_> {
    /// Returns the lens; `None` for a pinhole.
    pub(crate) fn lens(&self) -> Option<&LensView> {
        match self {
            Self::Device(camera) => camera.model.lens.as_ref(),
            Self::Pinhole(_) | Self::LookAt(_) => None,
        }
    }

    /// Returns the pose, the intrinsics and the velocity at a time (s) in a place.
    ///
    /// # Errors
    /// [`crate::Error::Camera`] if the numbers make no camera.
    pub fn at(&self, time: f64, place: &PreparedPlace) -> Result<MovingCamera> {
        match self {
            Self::Pinhole(camera) => Ok(*camera),
            Self::LookAt(look) => {
                let survey = place.survey();
                let near = ViewOptions::default().near(survey);
                Ok(look.camera(survey.up.value, near)?.into())
            }
            Self::Device(camera) => Ok(camera.motion().at(time, place.site().metres_per_unit)),
        }
    }
}

impl Drawing<'_> {
    /// Draws a picture of a frame's camera.
    pub(crate) async fn of_camera(
        &mut self,
        camera: FrameCamera<'_>,
        index: u32,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
    ) -> Result<Stats> {
        match camera {
            FrameCamera::Device(camera) => self.expose(camera, index, shot, picture).await,
            FrameCamera::Pinhole(_) | FrameCamera::LookAt(_) => self.pinhole(shot, picture).await,
        }
    }
}
