//! Layers beside a picture that are drawn after it: optical flow and labels.

use crate::camera_model::CameraModel;
use crate::output::{ExtraPicture, asked_labels, asks_for_flow, asks_for_particle_flow};
use crate::{Error, FrameOptions, LensView, Picture, PreparedPlace, Progress, Renderer, Result};
use wm_weather::{Fidelity, Weather};

/// The layers of a picture that are drawn after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaterLayers {
    /// The flow to the next frame.
    pub flow: bool,
    /// The flow of what falls.
    pub particle_flow: bool,
    /// Labels of splats.
    pub labels: bool,
}

impl LaterLayers {
    /// Those that `also` asks for.
    #[must_use]
    pub fn of(also: &[ExtraPicture]) -> Self {
        Self {
            flow: asks_for_flow(also),
            particle_flow: asks_for_particle_flow(also),
            labels: !asked_labels(also).is_empty(),
        }
    }

    /// Checks that a camera and a weather can have them.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the layer.
    pub fn check(self, model: &CameraModel, weather: &Weather) -> Result<()> {
        let fault = |says: &str| Err(Error::Unsupported(says.into()));
        if self.particle_flow && model.lens.is_some() {
            return fault("layer particle-flow: is of pinholes alone; leave out the lens or the layer");
        }
        if self.particle_flow && weather.fidelity == Fidelity::Paper {
            return fault(
                "layer particle-flow: rain and snow of fidelity paper have none; use fidelity physical",
            );
        }
        if (self.flow || self.particle_flow || self.labels) && !model.shutter.is_instant() {
            return fault(
                "layers flow and label are those of one instant: use no exposure time and no readout",
            );
        }
        Ok(())
    }

    /// Draws them for a frame and the one after it.
    ///
    /// # Errors
    /// As [`Renderer::render_flow`].
    pub fn render(
        self,
        renderer: &mut Renderer,
        (place, weather): (&mut PreparedPlace, &Weather),
        lens: Option<&LensView>,
        [frame, next]: [&FrameOptions<'_>; 2],
        picture: &mut Picture,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        if self.particle_flow {
            renderer.render_particle_flow(place, weather, [frame, next], picture, progress)?;
        }
        if self.flow {
            renderer.render_flow(place, weather, (lens, [frame, next]), picture, progress)?;
        }
        if self.labels {
            renderer.render_labels(place, (lens, &frame.camera.camera), picture)?;
        }
        Ok(())
    }
}
