//! The files of a site's page.

use super::output::write;
use super::single_file::{STARTER, with_policy};
use anyhow::Result;
use std::path::Path;
use weather_magician::{Camera, Weather};
use wm_viewer::page::{PageKind, files_of};
use wm_viewer::state::{Follow, Pose, ViewOutput, ViewState, weather_to_json};

/// JPEG quality of pictures that a viewer sends, which a page that renders for itself does not use.
const QUALITY: u8 = 90;

/// Returns the initial state of a page.
pub(crate) fn start(camera: &Camera, weather: &Weather, time: f64) -> ViewState {
    ViewState {
        camera: Pose::of(camera),
        path: Vec::new(),
        follow: Follow::Camera,
        weather: weather_to_json(weather),
        time,
        output: ViewOutput::Rgb,
        size: [camera.width, camera.height],
        quality: QUALITY,
        divider: None,
        lidar: None,
    }
}

/// The content policy: a page loads its own files, compiles its module, and shows pictures from
/// memory.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; \
                      style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; media-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'";

/// Writes the files of the page into a site, with the starter of a single file or without.
pub(crate) fn write_page(folder: &Path, is_single: bool) -> Result<()> {
    for file in files_of(PageKind::Static).filter(|file| is_single || file.path != STARTER) {
        let text = match file.path {
            "index.html" => with_policy(file.text, POLICY)?,
            _ => file.text.to_owned(),
        };
        write(&folder.join(file.path), text.as_bytes())?;
    }
    Ok(())
}
