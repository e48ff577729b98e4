//! Frames over time: a video, or a folder of frames that a later run can complete.

use super::args::RenderArgs;
use super::job::RenderJob;
use super::manifest::{self, CompletedFolder, StyledPicture};
use crate::output::write_video;
use anyhow::{Result, bail};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;
use weather_magician::output::{LayerFile, LayerPlacement, PictureStyle};
use weather_magician::{Picture, PictureSize, video};
use wm_image::png::DepthScale;

/// The file that describes the frames of a folder.
const MANIFEST: &str = "render.json";

/// Renders the frames with the numbers `wanted`, at least one, into an MP4.
pub(crate) fn video(job: &mut RenderJob, wanted: &[u32], path: &Path, args: &RenderArgs) -> Result<()> {
    if !args.output.also.is_empty() {
        bail!("--also is for pictures and folders of frames: give --out a folder");
    }
    let start = job.plan.time(wanted[0]);
    let camera = job.camera(start);
    let mut settings =
        video::VideoSettings::new(PictureSize::new(camera.width, camera.height), job.plan.rate);
    settings.encoder = args.output.encoder;
    settings.bitrate = args.output.bitrate;
    settings.dither = args.output.dither;
    settings.tags = job.style(args, DepthScale::Auto, start).tags;
    let (started, all) = (Instant::now(), wanted.len());
    let mut render = |index: u32, picture: &mut Picture| job.render(job.plan.time(index), picture).map(drop);
    let stopped = |written| {
        let advice = "nothing is written; a folder of frames (--out FOLDER) can be continued";
        format!("{written} of {all} frames were done, {advice}")
    };
    let report = write_video(path, settings, wanted, &mut render, stopped)?;
    println!(
        "{}: {}x{}, {} frames, {:.1} s, {:.1} MB, {}, {:.1} frames a second ({})",
        path.display(),
        camera.width,
        camera.height,
        report.frames,
        report.seconds,
        report.bytes as f64 * 1e-6,
        job.weather.name,
        all as f64 / started.elapsed().as_secs_f64(),
        job.renderer.describe()
    );
    Ok(())
}

/// Renders the frames with the numbers `wanted` into a folder, one picture per frame; frames that
/// exist already are kept.
pub(crate) fn folder(job: &mut RenderJob, wanted: &[u32], folder: &Path, args: &RenderArgs) -> Result<()> {
    manifest::keep(folder, MANIFEST, &about(job, args)?, "frames of another render")?;
    let extension = args.output.frame_format.extension();
    let name = |index: u32| folder.join(format!("{index:05}.{extension}"));
    // The colour is written first and the other pictures after it: a frame is complete if the last
    // one exists.
    let place = if args.output.layers { LayerPlacement::Layers } else { LayerPlacement::Beside };
    let is_layer = |also: &LayerFile| place.is_layer(*also, args.output.frame_format);
    let last = |index: u32| match args.output.also.iter().rev().find(|also| !is_layer(also)) {
        Some(also) => PictureStyle::path_of(*also, args.output.frame_format, &name(index)),
        None => name(index),
    };
    let is_there = |index: u32| name(index).exists() && last(index).exists();
    let depth_scale = DepthScale::reaching(job.place.site().far);
    let mut render = |index: u32, frame: &mut StyledPicture<PictureStyle>| {
        let time = job.plan.time(index);
        frame.style = job.style(args, depth_scale, time);
        job.render(time, &mut frame.picture).map(drop)
    };
    let mut beside = Vec::new();
    let mut write = |index: u32, frame: &StyledPicture<PictureStyle>| {
        beside = frame.style.write(&frame.picture, &name(index))?;
        Ok(())
    };
    let CompletedFolder { written, kept, seconds } =
        manifest::complete(folder, "frames", wanted, is_there, &mut render, &mut write)?;
    println!(
        "{}: {written} frames written, {kept} kept, {}, {:.1} frames a second ({})",
        folder.display(),
        job.weather.name,
        written as f64 / seconds.max(1e-9),
        job.renderer.describe()
    );
    for line in beside {
        println!("beside each frame, as {line}");
    }
    Ok(())
}

/// Returns everything that the frames of a folder depend on. It describes the whole sequence,
/// whichever frames are selected, so that several runs may fill one folder.
fn about(job: &RenderJob, args: &RenderArgs) -> Result<Value> {
    let scene = &args.scene.scene;
    let (bytes, changed) = manifest::file_facts(scene)?;
    let mut all = json!({
        "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
        "scene": scene.display().to_string(),
        "scene_bytes": bytes,
        "scene_changed": changed,
        "weather": format!("{:?}", job.weather),
        "site": format!("{:?}", job.place.site()),
        "camera": job.plan.motion.fingerprint(),
        "drawing": manifest::drawing_facts(&job.place, job.layers),
        "start": args.output.time(),
        "fps": job.plan.rate.to_string(),
        "frames": job.plan.frames,
        "format": args.output.frame_format.extension(),
        "also": format!("{:?}", args.output.also),
        "layers": args.output.layers,
        "dither": format!("{:?}", args.output.dither),
        "simd": job.renderer.backend().path().to_string(),
        "device": job.renderer.backend().arithmetic(),
    });
    let model = &job.camera.model;
    if let Some(lens) = &model.lens {
        all["lens"] = format!("{:?} {:?}", lens.lens(), lens.intrinsics()).into();
    }
    if let Some(settings) = model.settings() {
        all["camera_model"] = settings.into();
    }
    Ok(all)
}
