//! Layers of `--also` that are drawn after a picture.

use anyhow::{Context, Result, bail};
use std::path::Path;
use weather_magician::camera_model::CameraModel;
use weather_magician::output::{ExtraPicture, asked_labels};
use weather_magician::{LaterLayers, PreparedPlace};
use wm_weather::Weather;

/// Returns those that are asked for, which a camera and a weather must be able to have.
pub fn layers(also: &[ExtraPicture], model: &CameraModel, weather: &Weather) -> Result<LaterLayers> {
    let layers = LaterLayers::of(also);
    layers.check(model, weather).context("--also")?;
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
