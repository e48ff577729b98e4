//! The steps of the paper's rain and snow, as pictures beside the final one.

use super::target::OutputTarget;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};
use weather_magician::output::{PictureStyle, beside};
use weather_magician::{Picture, PictureSize, Weather};
use wm_image::png;
use wm_weather::{EffectRole, Fidelity};

/// The names of the steps.
const NAMES: [&str; 4] = ["noise", "overlay", "filtered", "final"];

/// Returns the files of the steps beside the picture `path`.
pub(crate) fn paths(path: &Path) -> [PathBuf; 4] {
    NAMES.map(|name| beside(path, name, "png"))
}

/// Returns an error for weathers and outputs without such steps.
pub(crate) fn check(weather: &Weather, target: &OutputTarget) -> Result<()> {
    if weather.fidelity != Fidelity::Paper || !weather.has(EffectRole::Falls) {
        bail!(
            "--stages: shows the steps of the paper's rain and snow; add --set fidelity=paper and --set rain.rate=10, or \
             --set snowfall.rate=1"
        );
    }
    if !matches!(target, OutputTarget::Picture(_)) {
        bail!("--stages: is for a picture; give --out a .png, .exr or .npy");
    }
    Ok(())
}

/// Writes the steps of a picture; returns a line for each file.
pub(crate) fn write(picture: &Picture, style: &PictureStyle, path: &Path) -> Result<Vec<String>> {
    let (frame, stages) = (&picture.frame, &picture.stages);
    let size = PictureSize::new(frame.width, frame.height);
    let steps = [&stages.noise, &stages.overlay, &stages.filtered, &frame.rgb];
    let mut lines = Vec::new();
    for (path, rgb) in paths(path).into_iter().zip(steps) {
        png::write_rgb(&path, rgb, size, style.dither, &style.tags)?;
        lines.push(path.display().to_string());
    }
    Ok(lines)
}
