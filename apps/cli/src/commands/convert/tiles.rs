//! 3D Tiles of a scene in levels.

use super::args::ConvertArgs;
use crate::choices::first_given;
use crate::interrupt;
use crate::progress;
use crate::scene::threads;
use anyhow::{Result, bail};
use rayon::prelude::*;
use std::path::Path;
use wm_scene::levels::{LevelIndex, TilePlan};
use wm_scene::sh::MAX_DEGREE;

/// Tiles that are written one after the other on one thread, so that they share what is read for
/// them.
const TILES_AT_ONCE: usize = 16;

/// Returns true if a path names 3D Tiles.
pub(super) fn is_tileset(out: &Path) -> bool {
    out.file_name().is_some_and(|name| name.eq_ignore_ascii_case("tileset.json"))
}

/// Writes 3D Tiles of a scene in levels; returns the lines to print.
pub(super) fn write(path: &Path, out: &Path, args: &ConvertArgs) -> Result<String> {
    let Some(index) = LevelIndex::of_scene(path)? else {
        bail!(
            "{}: 3D Tiles are made of a scene in levels of detail; convert it to FOLDER/lod-meta.json first",
            path.display()
        );
    };
    let change = &args.change;
    let others = first_given([
        (change.crop.is_some(), "--crop"),
        (change.up.is_some(), "--up"),
        (change.scale.is_some(), "--scale"),
        (change.origin.is_some(), "--origin"),
        (change.max_splats.is_some(), "--max-splats"),
        (args.level.is_some(), "--level"),
    ]);
    if let Some(option) = others {
        bail!(
            "{option} does not go with 3D Tiles, which have all levels and splats; change the scene before"
        );
    }
    let plan = TilePlan::new(&index, out, change.sh_degree.unwrap_or(MAX_DEGREE))?;
    let bar = progress::bar(plan.len() as u64, "tiles");
    let starts: Vec<usize> = (0..plan.len()).step_by(TILES_AT_ONCE).collect();
    let written = || {
        starts.par_iter().try_for_each(|start| {
            interrupt::check(format!("{} of {} tiles are written", bar.position(), plan.len()))?;
            let tiles = *start..plan.len().min(start + TILES_AT_ONCE);
            let count = tiles.len() as u64;
            plan.write_tiles(tiles)?;
            bar.inc(count);
            anyhow::Ok(())
        })
    };
    threads(args.run.threads)?.install(written)?;
    bar.finish_and_clear();
    plan.write_tileset()?;
    let (tiles, finest) = (plan.len(), index.count_of_level(0));
    let mut lines = vec![format!("{}: {finest} splats in {tiles} tiles, 3D Tiles 1.1", out.display())];
    lines.extend(plan.notes().iter().map(|note| format!("  {note}")));
    Ok(lines.join("\n"))
}
