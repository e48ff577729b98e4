//! Manifests: files that say what a folder of pictures was made from, so that a later run can
//! complete it.

use anyhow::{Context, Result, bail};
use serde_json::{Value as Json, json};
use std::path::Path;
use std::time::UNIX_EPOCH;
use wm_base::files::write_atomically;
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

/// Makes a folder and writes its manifest; returns an error if it has another one: that it `holds`
/// such files.
pub(crate) fn keep(folder: &Path, name: &str, manifest: &Json, holds: &str) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let path = folder.join(name);
    if path.exists() {
        let text = std::fs::read_to_string(&path);
        let text = text.with_context(|| format!("cannot read {}", path.display()))?;
        if serde_json::from_str::<Json>(&text).ok().as_ref() != Some(manifest) {
            bail!("{}: holds {holds}; empty it, or give another folder", folder.display());
        }
        return Ok(());
    }
    let text = serde_json::to_string_pretty(manifest)?;
    Ok(write_atomically(&path, |out| Ok(writeln!(out, "{text}")?))?)
}
