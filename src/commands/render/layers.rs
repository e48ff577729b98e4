//! Layers beside a picture that are drawn after it: optical flow and labels.

use crate::progress::Reporter;
use anyhow::{Result, bail};
use std::path::Path;
use weather_magician::camera_model::CameraModel;
use weather_magician::output::{ExtraPicture, asked_labels, asks_for_flow, asks_for_particle_flow};
use weather_magician::{FrameOptions, LensView, Picture, PreparedPlace, Renderer};
use wm_weather::{Fidelity, Weather};

/// The layers that are asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LaterLayers {
    /// The flow to the next frame.
    flow: bool,
    /// The flow of what falls.
    particle_flow: bool,
    /// Labels of splats.
    labels: bool,
}

impl LaterLayers {
    /// Those of `--also`, which a camera and a weather must be able to have.
    pub fn of(also: &[ExtraPicture], model: &CameraModel, weather: &Weather) -> Result<Self> {
        let layers = Self {
            flow: asks_for_flow(also),
            particle_flow: asks_for_particle_flow(also),
            labels: !asked_labels(also).is_empty(),
        };
        if layers.particle_flow && model.lens.is_some() {
            bail!("--also particle-flow: is of pinholes alone; leave out the lens or the layer");
        }
        if layers.particle_flow && weather.fidelity == Fidelity::Paper {
            bail!(
                "--also particle-flow: rain and snow of fidelity paper have none; use --set fidelity=physical"
            );
        }
        if (layers.flow || layers.particle_flow || layers.labels) && !model.shutter.is_instant() {
            bail!("--also flow and labels are those of one instant: use no exposure time and no readout");
        }
        Ok(layers)
    }

    /// Returns an error if the splats of a place lack the labels of `--also`.
    pub fn check_labels(also: &[ExtraPicture], place: &PreparedPlace, scene: &Path) -> Result<()> {
        if let Some(kind) = asked_labels(also).iter().find(|kind| place.labels(**kind).is_empty()) {
            bail!(
                "--also {}: the splats of {} have none; `weather-magician label` gives them by masks of the photos",
                kind.name(),
                scene.display()
            );
        }
        Ok(())
    }

    /// Draws them for a frame and the one after it.
    pub fn render(
        self,
        renderer: &mut Renderer,
        (place, weather): (&mut PreparedPlace, &Weather),
        lens: Option<&LensView>,
        [frame, next]: [&FrameOptions<'_>; 2],
        picture: &mut Picture,
    ) -> Result<()> {
        let progress = &mut Reporter::default();
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
