//! Writing a scene in levels of detail.

use super::sizes::{file_size, folder_size};
use crate::progress::Reporter;
use crate::scene::RunArgs;
use anyhow::Result;
use std::path::Path;
use weather_magician::Scene;
use weather_magician::levels::{LevelBuilder, LevelOptions};
use wm_scene::levels::{INDEX_NAME, LevelIndex};
use wm_scene::survey::label_sky;

/// Returns true if a path is that of a scene in levels of detail.
pub(crate) fn is_levels(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == INDEX_NAME)
}

/// Writes `scene` with the index `out`, with so many levels, or as many as suit its leaves; returns
/// the lines to print.
pub(crate) fn write(
    out: &Path,
    mut scene: Scene,
    notes: Vec<String>,
    levels: Option<u32>,
    run: &RunArgs,
) -> Result<String> {
    label_sky(&mut scene.splats);
    let options = LevelOptions {
        levels,
        rasterization: scene.metadata.rasterization,
        threads: run.threads.map(usize::from),
        ..LevelOptions::for_splats(scene.splats.len() as u64)
    };
    let mut builder = LevelBuilder::create(out, options)?;
    builder.add(&scene.splats, &mut Reporter::default())?;
    let summary = builder.finish(&scene.metadata, &mut Reporter::default())?;
    let index = LevelIndex::open(out)?;
    let files =
        index.files.iter().chain(&index.environment).map(|name| folder_size(&out.with_file_name(name)));
    let megabytes = (files.sum::<u64>() + file_size(out)) as f64 / 1e6;
    let counts: Vec<String> = summary.splats.iter().map(u64::to_string).collect();
    let mut lines = vec![format!(
        "{}: {} levels of {} splats, {} leaves, {megabytes:.1} MB",
        out.display(),
        counts.len(),
        counts.join(", "),
        summary.leaves
    )];
    if summary.environment > 0 {
        lines.push(format!("  {} splats of the sky are always drawn", summary.environment));
    }
    lines.extend(notes.into_iter().map(|note| format!("  {note}")));
    Ok(lines.join("\n"))
}
