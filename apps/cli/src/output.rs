//! Folders, texts, JSON, sheets of pictures and videos that commands write or print.

use crate::interrupt;
use crate::progress::Reporter;
use anyhow::{Context, Result};
use serde::Serialize;
use std::path::Path;
use weather_magician::sequence::render_and_write;
use weather_magician::video::{VideoReport, VideoSettings, create_video};
use weather_magician::{Picture, PictureSize};
use wm_base::files::write_atomically;
use wm_image::color::Dither;
use wm_image::png::write_rgb;
use wm_image::sheet::{SheetLayout, SheetPanel, sheet};

/// Makes a folder, with those that it lies in.
pub(crate) fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))
}

/// Writes a text in place of a file.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<()> {
    Ok(write_atomically(path, |out| Ok(out.write_all(text.as_bytes())?))?)
}

/// Returns a value as a JSON file for people.
pub(crate) fn json_text(value: &(impl Serialize + ?Sized)) -> Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

/// Prints a value as JSON.
pub(crate) fn print_json(value: &(impl Serialize + ?Sized)) -> Result<()> {
    print!("{}", json_text(value)?);
    Ok(())
}

/// Writes labelled pictures, each `[H, W, 3]` of the size `panel`, side by side in `columns` as a
/// PNG; returns its size.
pub(crate) fn write_sheet(
    path: &Path,
    panels: &[(Vec<f32>, impl AsRef<str>)],
    panel: PictureSize,
    columns: u32,
    dither: Dither,
    tags: &[(String, String)],
) -> Result<PictureSize> {
    let panels: Vec<SheetPanel<'_>> =
        panels.iter().map(|(rgb, label)| SheetPanel { rgb, label: label.as_ref() }).collect();
    let layout = SheetLayout::new(panel, panels.len() as u32, columns);
    write_rgb(path, &sheet(&layout, &panels), layout.size(), dither, tags)?;
    Ok(layout.size())
}

/// Renders the frames of a video while another thread writes them. If Ctrl-C stops it, no file is
/// left, and the error is the text that `stopped` makes of the number of frames that were done.
pub(crate) fn write_video(
    path: &Path,
    settings: VideoSettings,
    frames: &[u32],
    render: &mut dyn FnMut(u32, &mut Picture) -> Result<()>,
    stopped: impl FnOnce(u32) -> String,
) -> Result<VideoReport> {
    let mut sink = create_video(path, settings)?;
    let mut write = |_: u32, picture: &Picture| -> Result<()> { Ok(sink.frame(&picture.frame.rgb)?) };
    let written = render_and_write(frames, render, &mut write, &mut Reporter::default())?;
    if (written as usize) < frames.len() {
        return Err(interrupt::stopped(stopped(written)));
    }
    Ok(sink.finish()?)
}
