//! The steps of the paper's rain and snow, as pictures beside the final one.

use super::{OutputTarget, RenderJob};
use crate::progress::Reporter;
use anyhow::{Result, bail};
use std::path::{Path, PathBuf};
use weather_magician::output::{PictureStyle, beside};
use weather_magician::{FrameOptions, Picture};
use wm_media::{PictureSize, png};
use wm_render::Stats;
use wm_weather::paper::PaperStages;
use wm_weather::{EffectRole, Fidelity, Weather};

/// The names of the steps.
const NAMES: [&str; 4] = ["noise", "overlay", "filtered", "final"];

/// Returns the files of the steps beside the picture `path`.
pub fn paths(path: &Path) -> [PathBuf; 4] {
    NAMES.map(|name| beside(path, name, "png"))
}

/// Returns an error for weathers and outputs without such steps.
pub fn check(weather: &Weather, target: &OutputTarget) -> Result<()> {
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

/// Renders and writes the picture at `time`, its steps and the other pictures that are requested;
/// returns a line for each file but the picture.
pub fn picture(
    job: &mut RenderJob,
    style: &PictureStyle,
    path: &Path,
    time: f64,
    picture: &mut Picture,
) -> Result<(Stats, Vec<String>)> {
    let camera = job.plan.moving(time, job.place.site().metres_per_unit);
    let (options, mut stages) = (FrameOptions::new(time, camera), PaperStages::default());
    let RenderJob { renderer, place, weather, .. } = job;
    let target = (&mut *picture, &mut stages);
    let stats = renderer.render_stages(place, weather, &options, target, &mut Reporter::default())?;
    let mut lines = style.write(picture, path)?;
    let frame = &picture.frame;
    let size = PictureSize::new(frame.width, frame.height);
    let steps = [&stages.noise, &stages.overlay, &stages.filtered, &frame.rgb];
    for (path, rgb) in paths(path).into_iter().zip(steps) {
        png::write_rgb(&path, rgb, size, style.dither, &style.tags)?;
        lines.push(path.display().to_string());
    }
    Ok((stats, lines))
}
