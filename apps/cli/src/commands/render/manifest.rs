//! Folders of pictures that a later run can complete: their manifests, which say what they were
//! made from, and the rendering of what they lack.

use crate::interrupt::stopped;
use crate::output::{json_text, make_folder, write_text};
use crate::progress::Reporter;
use anyhow::{Context, Result, bail};
use serde_json::{Value as Json, json};
use std::path::Path;
use std::time::{Instant, UNIX_EPOCH};
use weather_magician::sequence::render_and_write;
use weather_magician::{Layers, Picture, PreparedPlace};
use wm_weather::Site;

/// Size of a scene's file, bytes, and the time of its last change, s since 1970 where the system
/// knows it.
pub(crate) fn file_facts(scene: &Path) -> Result<(u64, Option<u64>)> {
    let about = std::fs::metadata(scene).with_context(|| format!("cannot read {}", scene.display()))?;
    let changed = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    Ok((about.len(), changed.map(|time| time.as_secs())))
}

/// A scene and the facts of its place.
pub(crate) fn scene_facts(scene: &Path, site: &Site) -> Result<Json> {
    let (bytes, changed) = file_facts(scene)?;
    Ok(json!({
        "path": scene.display().to_string(),
        "bytes": bytes,
        "changed": changed,
        "metres_per_unit": site.metres_per_unit,
        "up": site.up,
        "ground": site.ground,
        "airlight": site.airlight,
    }))
}

/// Returns what frames depend on beside weather and camera, as text for a manifest.
pub(crate) fn drawing_facts(place: &PreparedPlace, layers: Layers) -> String {
    format!("{layers:?} {:?} {:?}", place.background, place.rasterization)
}

/// Makes a folder and writes its manifest; returns an error if it has another one: that it `holds`
/// such files.
pub(crate) fn keep(folder: &Path, name: &str, manifest: &Json, holds: &str) -> Result<()> {
    make_folder(folder)?;
    let path = folder.join(name);
    if path.exists() {
        let text = std::fs::read_to_string(&path);
        let text = text.with_context(|| format!("cannot read {}", path.display()))?;
        if serde_json::from_str::<Json>(&text).ok().as_ref() != Some(manifest) {
            bail!("{}: holds {holds}; empty it, or give another folder", folder.display());
        }
        return Ok(());
    }
    write_text(&path, &json_text(manifest)?)
}

/// A picture, and how it is written.
#[derive(Default)]
pub(crate) struct StyledPicture<S> {
    /// The picture.
    pub(crate) picture: Picture,
    /// The style, or one for each of its files.
    pub(crate) style: S,
}

/// A folder that was completed.
pub(crate) struct CompletedFolder {
    /// Number of frames that were rendered and written.
    pub(crate) written: usize,
    /// Number of frames that were there.
    pub(crate) kept: usize,
    /// Duration of the work, s.
    pub(crate) seconds: f64,
}

/// Renders the `wanted` frames of a folder that are not there, while another thread writes them.
/// Messages call frames `what`.
pub(crate) fn complete<S: Default + Send>(
    folder: &Path,
    what: &str,
    wanted: &[u32],
    is_there: impl Fn(u32) -> bool,
    render: &mut dyn FnMut(u32, &mut StyledPicture<S>) -> Result<()>,
    write: &mut (dyn FnMut(u32, &StyledPicture<S>) -> Result<()> + Send),
) -> Result<CompletedFolder> {
    let missing: Vec<u32> = wanted.iter().copied().filter(|index| !is_there(*index)).collect();
    let (folder, all, kept) = (folder.display(), wanted.len(), wanted.len() - missing.len());
    if kept > 0 {
        eprintln!("{folder}: {kept} of {all} {what} exist, rendering the others");
    }
    let started = Instant::now();
    let written = render_and_write(&missing, render, write, &mut Reporter::default())? as usize;
    if written < missing.len() {
        let advice = "the same command continues with the others";
        return Err(stopped(format!("{} of {all} {what} are in {folder}, {advice}", kept + written)));
    }
    Ok(CompletedFolder { written, kept, seconds: started.elapsed().as_secs_f64() })
}
