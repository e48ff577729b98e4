//! Writing a scene in levels of detail.

use super::{ConvertArgs, LevelCount, file_size, folder_size};
use crate::progress::Reporter;
use anyhow::Result;
use std::path::Path;
use weather_magician::levels::{LevelBuilder, LevelOptions};
use wm_scene::Scene;
use wm_scene::levels::LevelIndex;
use wm_scene::survey::label_sky;

/// Writes `scene` with the index `out`; returns the lines to print.
pub(super) fn write(out: &Path, mut scene: Scene, notes: Vec<String>, args: &ConvertArgs) -> Result<String> {
    label_sky(&mut scene.splats);
    let options = LevelOptions {
        levels: match args.lod {
            LevelCount::Auto => None,
            LevelCount::Number(number) => Some(number),
        },
        rasterization: scene.metadata.rasterization,
        threads: args.run.threads.map(usize::from),
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
