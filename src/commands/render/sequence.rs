//! Frames over time: into a video, or into a folder that a later run can go on with.

use super::{RenderArgs, Studio};
use crate::interrupt::{self, Interrupted};
use crate::media::{Size, png::DepthScale, video};
use crate::output::Style;
use crate::progress;
use anyhow::{Context, Result, anyhow, bail};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::mpsc::{channel, sync_channel};
use std::time::Instant;
use wm_render::{Frame, Renderer};
use wm_scene::files::write_atomically;

/// Frames between renderer and writer; more would only take memory.
const WAITING: usize = 2;
/// The file in a folder of frames that says what they are frames of.
const MANIFEST: &str = "render.json";

/// Renders into an MP4.
pub fn video(studio: &mut Studio, path: &Path, args: &RenderArgs) -> Result<()> {
    if !args.output.also.is_empty() {
        bail!("--also is for pictures and folders of frames: give --out a folder");
    }
    let camera = studio.shot.camera(studio.shot.time(0));
    let mut settings = video::VideoSettings::new(Size::new(camera.width, camera.height), studio.shot.rate);
    settings.encoder = args.output.encoder;
    settings.bitrate = args.output.bitrate;
    settings.dither = args.output.dither;
    settings.tags = studio.style(args, DepthScale::Auto, &camera, studio.shot.time(0)).tags;
    let mut sink = video::create_video(path, settings)?;

    let started = Instant::now();
    let all = studio.shot.frames;
    let written =
        pipeline(studio, &(0..all).collect::<Vec<_>>(), &mut |_, frame| Ok(sink.frame(&frame.rgb)?))?;
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
        studio.weather.name,
        f64::from(all) / started.elapsed().as_secs_f64(),
        studio.loaded.renderer.describe()
    );
    Ok(())
}

/// Renders into a folder, one picture a frame; frames that are there already are kept.
pub fn folder(studio: &mut Studio, folder: &Path, args: &RenderArgs) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let manifest = manifest(studio, args)?;
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
    let last = |index: u32| match args.output.also.last() {
        Some(also) => Style::path_of(*also, args.output.frame_format, &name(index)),
        None => name(index),
    };
    let all = studio.shot.frames;
    let missing: Vec<u32> =
        (0..all).filter(|index| !(name(*index).exists() && last(*index).exists())).collect();
    let kept = all - missing.len() as u32;
    if kept > 0 {
        eprintln!("{}: {kept} of {all} frames are there, going on with the others", folder.display());
    }

    let started = Instant::now();
    let styles: Vec<Style> = missing
        .iter()
        .map(|index| {
            let time = studio.shot.time(*index);
            studio.style(args, DepthScale::reaching(studio.site.far), &studio.shot.camera(time), time)
        })
        .collect();
    let (mut position, mut beside) = (0, Vec::new());
    let written = pipeline(studio, &missing, &mut |index, frame| {
        beside = styles[position].write(frame, &name(index))?;
        position += 1;
        Ok(())
    })?;
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
        studio.weather.name,
        f64::from(written) / started.elapsed().as_secs_f64().max(1e-9),
        studio.loaded.renderer.describe()
    );
    for line in beside {
        println!("beside each frame, as {line}");
    }
    Ok(())
}

/// Renders `frames` in order while another thread writes those before; returns how many were written.
/// Fewer than all means that Ctrl-C was pressed.
fn pipeline(
    studio: &mut Studio,
    frames: &[u32],
    write: &mut (dyn FnMut(u32, &Frame) -> Result<()> + Send),
) -> Result<u32> {
    let bar = progress::bar(frames.len() as u64, "frames");
    let outcome = std::thread::scope(|scope| {
        let (send, receive) = sync_channel::<(u32, Frame)>(WAITING);
        let (give_back, returned) = channel::<Frame>();
        let bar = &bar;
        let writer = scope.spawn(move || -> Result<u32> {
            let mut written = 0;
            for (index, frame) in receive {
                write(index, &frame)?;
                written += 1;
                bar.inc(1);
                // The renderer may be done and its end closed.
                let _ = give_back.send(frame);
            }
            Ok(written)
        });
        let mut fault = None;
        for index in frames {
            if interrupt::asked() {
                break;
            }
            let mut frame = returned.try_recv().unwrap_or_default();
            if let Err(error) = studio.render(studio.shot.time(*index), &mut frame) {
                fault = Some(error);
                break;
            }
            // A closed end means that the writer failed: its error is the one to tell.
            if send.send((*index, frame)).is_err() {
                break;
            }
        }
        drop(send);
        let written = writer.join().map_err(|_| anyhow!("the writer of frames failed"))??;
        match fault {
            Some(error) => Err(error),
            None => Ok(written),
        }
    });
    bar.finish_and_clear();
    outcome
}

/// What the frames of a folder depend on.
fn manifest(studio: &Studio, args: &RenderArgs) -> Result<Value> {
    let scene = &args.scene.scene;
    let about = std::fs::metadata(scene).with_context(|| format!("cannot read {}", scene.display()))?;
    let changed = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(json!({
        "program": concat!("weather-magician ", env!("CARGO_PKG_VERSION")),
        "scene": scene.display().to_string(),
        "scene_bytes": about.len(),
        "scene_changed": changed.map(|t| t.as_secs()),
        "weather": format!("{:?}", studio.weather),
        "site": format!("{:?}", studio.site),
        "camera": studio.shot.fingerprint(),
        "config": format!("{:?}", studio.config),
        "start": args.output.time,
        "fps": studio.shot.rate.to_string(),
        "frames": studio.shot.frames,
        "format": args.output.frame_format.extension(),
        "also": format!("{:?}", args.output.also),
        "dither": format!("{:?}", args.output.dither),
        "simd": studio.loaded.renderer.path().to_string(),
    }))
}
