//! The steps of the paper's rain and snow, as pictures beside the final one.

use super::{OutputTarget, RenderJob};
use crate::progress::Reporter;
use anyhow::{Result, bail};
use std::path::Path;
use weather_magician::output::{PictureStyle, beside};
use weather_magician::{FrameOptions, Picture};
use wm_media::{PictureSize, png};
use wm_render::Stats;
use wm_weather::paper::PaperStages;
use wm_weather::{EffectRole, Fidelity, Weather};

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

/// Renders and writes the picture at `time`, its steps and the other pictures that are requested; returns a line for
/// each file but the picture.
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
    for (name, rgb) in [
        ("noise", &stages.noise),
        ("overlay", &stages.overlay),
        ("filtered", &stages.filtered),
        ("final", &frame.rgb),
    ] {
        let path = beside(path, name, "png");
        png::write_rgb(&path, rgb, size, style.dither, &style.tags)?;
        lines.push(path.display().to_string());
    }
    Ok((stats, lines))
}
