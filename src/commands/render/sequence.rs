//! Frames over time: into a video, or into a folder that a later run can go on with.

use super::{RenderArgs, Take};
use crate::interrupt::Interrupted;
use crate::progress::Reporter;
use anyhow::{Context, Result, bail};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;
use weather_magician::Picture;
use weather_magician::output::{ExtraPicture, LayerPlacement, PictureStyle};
use weather_magician::sequence::render_and_write;
use wm_media::{Size, png::DepthScale, video};
use wm_scene::files::write_atomically;

/// The file in a folder of frames that says what they are frames of.
const MANIFEST: &str = "render.json";

/// Renders the frames of the numbers `wanted`, which are not none, into an MP4.
pub fn video(take: &mut Take, wanted: &[u32], path: &Path, args: &RenderArgs) -> Result<()> {
    if !args.output.also.is_empty() {
        bail!("--also is for pictures and folders of frames: give --out a folder");
    }
    let start = take.shot.time(wanted[0]);
    let camera = take.shot.camera(start);
    let mut settings = video::VideoSettings::new(Size::new(camera.width, camera.height), take.shot.rate);
    settings.encoder = args.output.encoder.into();
    settings.bitrate = args.output.bitrate;
    settings.dither = args.output.dither.into();
    settings.tags = take.style(args, DepthScale::Auto, start).tags;
    let mut sink = video::create_video(path, settings)?;

    let started = Instant::now();
    let all = wanted.len() as u32;
    let written = render_and_write(
        wanted,
        &mut renderer(take),
        &mut |_, picture| Ok(sink.frame(&picture.frame.rgb)?),
        &mut Reporter::default(),
    )?;
    if written < all {
        let advice = "nothing is written; a folder of frames (--out FOLDER) can be gone on with";
        return Err(Interrupted(format!("{written} of {all} frames were done, {advice}")).into());
    }
    let report = sink.finish()?;
    println!(
        "{}: {}x{}, {} frames, {:.1} s, {:.1} MB, {}, {:.1} frames a second ({})",
        path.display(),
        camera.width,
        camera.height,
        report.frames,
        report.seconds,
        report.bytes as f64 * 1e-6,
        take.weather.name,
        f64::from(all) / started.elapsed().as_secs_f64(),
        take.renderer.describe()
    );
    Ok(())
}

/// Renders the frames of the numbers `wanted` into a folder, one picture a frame; frames that are there already are
/// kept.
pub fn folder(take: &mut Take, wanted: &[u32], folder: &Path, args: &RenderArgs) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let manifest = manifest(take, args)?;
    let manifest_path = folder.join(MANIFEST);
    if manifest_path.exists() {
        let text = std::fs::read_to_string(&manifest_path);
        let text = text.with_context(|| format!("cannot read {}", manifest_path.display()))?;
        if serde_json::from_str::<Value>(&text).ok().as_ref() != Some(&manifest) {
            bail!("{}: holds frames of another render; empty it, or give another folder", folder.display());
        }
    } else {
        let text = serde_json::to_string_pretty(&manifest)?;
        write_atomically(&manifest_path, |out| Ok(writeln!(out, "{text}")?))?;
    }
    let extension = args.output.frame_format.extension();
    let name = |index: u32| folder.join(format!("{index:05}.{extension}"));
    // The colour is written first and the rest beside it, so the last of them tells.
    let place = if args.output.layers { LayerPlacement::Layers } else { LayerPlacement::Beside };
    let is_layer = |also: &ExtraPicture| place.is_layer(*also, args.output.frame_format);
    let last = |index: u32| match args.output.also.iter().rev().find(|also| !is_layer(also)) {
        Some(also) => PictureStyle::path_of(*also, args.output.frame_format, &name(index)),
        None => name(index),
    };
    let all = wanted.len() as u32;
    let is_there = |index: u32| name(index).exists() && last(index).exists();
    let missing: Vec<u32> = wanted.iter().copied().filter(|index| !is_there(*index)).collect();
    let kept = all - missing.len() as u32;
    if kept > 0 {
        eprintln!("{}: {kept} of {all} frames are there, going on with the others", folder.display());
    }

    let started = Instant::now();
    let styles: Vec<PictureStyle> = missing
        .iter()
        .map(|index| take.style(args, DepthScale::reaching(take.place.site().far), take.shot.time(*index)))
        .collect();
    let (mut position, mut beside) = (0, Vec::new());
    let mut write = |index: u32, picture: &Picture| -> Result<()> {
        beside = styles[position].write(picture, &name(index))?;
        position += 1;
        Ok(())
    };
    let written = render_and_write(&missing, &mut renderer(take), &mut write, &mut Reporter::default())?;
    if (written as usize) < missing.len() {
        let done = kept + written;
        let advice = "the same command goes on with the others";
        return Err(
            Interrupted(format!("{done} of {all} frames are in {}, {advice}", folder.display())).into()
        );
    }
    println!(
        "{}: {written} frames written, {kept} kept, {}, {:.1} frames a second ({})",
        folder.display(),
        take.weather.name,
        f64::from(written) / started.elapsed().as_secs_f64().max(1e-9),
        take.renderer.describe()
    );
    for line in beside {
        println!("beside each frame, as {line}");
    }
    Ok(())
}

/// Renders the frame of an index.
fn renderer(take: &mut Take) -> impl FnMut(u32, &mut Picture) -> Result<()> {
    |index, picture| take.render(take.shot.time(index), picture).map(drop)
}

/// What the frames of a folder depend on: the whole sequence, whichever of its frames are asked for, so that several
/// runs may fill one folder.
fn manifest(take: &Take, args: &RenderArgs) -> Result<Value> {
    let scene = &args.scene.scene;
    let about = std::fs::metadata(scene).with_context(|| format!("cannot read {}", scene.display()))?;
    let changed = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(json!({
        "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
        "scene": scene.display().to_string(),
        "scene_bytes": about.len(),
        "scene_changed": changed.map(|t| t.as_secs()),
        "weather": format!("{:?}", take.weather),
        "site": format!("{:?}", take.place.site()),
        "camera": take.shot.fingerprint(),
        "config": format!("{:?}", take.place.config),
        "start": args.output.time,
        "fps": take.shot.rate.to_string(),
        "frames": take.shot.frames,
        "format": args.output.frame_format.extension(),
        "also": format!("{:?}", args.output.also),
        "layers": args.output.layers,
        "dither": format!("{:?}", args.output.dither),
        "simd": take.renderer.backend().path().to_string(),
        "device": take.renderer.backend().arithmetic(),
    }))
}
