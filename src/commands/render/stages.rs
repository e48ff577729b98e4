//! The steps of the paper's rain and snow, as pictures beside the last one.

use super::{Take, Target};
use crate::names::beside;
use crate::output::Style;
use crate::parts::Picture;
use anyhow::{Result, bail};
use std::path::Path;
use wm_media::{Size, png};
use wm_render::Stats;
use wm_weather::paper::Stages;
use wm_weather::{Fidelity, Weather};

/// Refuses what has no such steps.
pub fn check(weather: &Weather, target: &Target) -> Result<()> {
    if weather.fidelity != Fidelity::Paper || !weather.has_fall() {
        bail!(
            "--stages: shows the steps of the paper's rain and snow; add --set fidelity=paper and --set rain.rate=10, or \
             --set snowfall.rate=1"
        );
    }
    if !matches!(target, Target::Picture(_)) {
        bail!("--stages: is for a picture; give --out a .png, .exr or .npy");
    }
    Ok(())
}

/// Renders and writes the picture of the instant `time`, its steps and what else is asked for beside it; returns a line for
/// each file but the picture.
pub fn picture(
    take: &mut Take,
    style: &Style,
    path: &Path,
    time: f64,
    picture: &mut Picture,
) -> Result<(Stats, Vec<String>)> {
    let moving = take.shot.moving(time, take.studio.site.metres_per_unit);
    let mut stages = Stages::default();
    let stats = take.studio.render_stages(&take.weather, time, moving, (&mut picture.frame, &mut stages))?;
    let mut lines = style.write(picture, path)?;
    let frame = &picture.frame;
    let size = Size::new(frame.width, frame.height);
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
