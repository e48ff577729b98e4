//! `convert`: converts scenes to another format; rotates, scales, crops and reduces them.

mod args;
pub(crate) mod levels;
mod sizes;
mod tiles;

pub(crate) use args::{ConvertArgs, parse_box};

use crate::names::stem_of;
use crate::progress::{self, Reporter};
use crate::scene::{RunArgs, change_sky, check, read_saying_remarks, save};
use anyhow::{Context, Result, anyhow, bail};
use args::{ChangeArgs, LevelCount};
use levels::is_levels;
use sizes::{file_size, folder_size};
use std::path::{Path, PathBuf};
use weather_magician::formats::{DetailLevel, ReadOptions, WriteOptions, format_for, lost};
use weather_magician::{Metadata, Scene, SceneChange};
use wm_base::files::check_writable;
use wm_render::Differentiable;

/// Runs the command.
pub(crate) fn run(args: &ConvertArgs) -> Result<()> {
    let jobs = jobs(args)?;
    if let Some(folder) = &args.folder {
        std::fs::create_dir_all(folder).map_err(|error| anyhow!("{}: {error}", folder.display()))?;
    }
    let inputs: Vec<&Path> = jobs.iter().map(|(scene, _)| *scene).collect();
    for (_, out) in &jobs {
        if !is_levels(out) && !tiles::is_tileset(out) {
            format_for(out)?;
        }
        // The folder for the files of a SOG is created; any other must exist.
        if out.extension().is_none_or(|extension| extension != "json") {
            check_writable(out)?;
        }
        args.overwrite.check(out, &inputs, "choose another name")?;
    }
    let bar = (jobs.len() > 1).then(|| progress::bar(jobs.len() as u64, "scenes"));
    // Ctrl-C ends it at once: scenes that are written stay, and no part is left of the one that is
    // not.
    for (scene, out) in &jobs {
        let line =
            if tiles::is_tileset(out) { tiles::write(scene, out, args)? } else { convert(scene, out, args)? };
        match &bar {
            Some(bar) => bar.suspend(|| println!("{line}")),
            None => println!("{line}"),
        }
        bar.iter().for_each(|bar| bar.inc(1));
    }
    Ok(())
}

/// Returns the output path of each scene.
fn jobs(args: &ConvertArgs) -> Result<Vec<(&Path, PathBuf)>> {
    let Some(ending) = &args.to else {
        let [scene, out] = &args.paths[..] else {
            bail!(
                "{} paths: give an input and an output scene, or --to and any number of input scenes",
                args.paths.len()
            );
        };
        return Ok(vec![(scene, out.clone())]);
    };
    let ending = ending.trim_start_matches('.');
    let mut jobs: Vec<(&Path, PathBuf)> = Vec::new();
    for scene in &args.paths {
        let beside = scene.parent().unwrap_or(Path::new(""));
        let folder = args.folder.as_deref().unwrap_or(beside);
        let stem = stem_of(scene);
        let out = if ending == "meta.json" || ending == "lod-meta.json" {
            folder.join(stem).join(ending)
        } else {
            folder.join(format!("{stem}.{ending}"))
        };
        if let Some((other, _)) = jobs.iter().find(|(_, other)| *other == out) {
            bail!("{} and {} would both be {}", other.display(), scene.display(), out.display());
        }
        let is_replaced = args.overwrite.overwrite;
        if !is_replaced && out.exists() && out.canonicalize().ok() == scene.canonicalize().ok() {
            bail!("{} has that ending already", scene.display());
        }
        jobs.push((scene, out));
    }
    Ok(jobs)
}

/// Converts one scene; returns the lines to print.
fn convert(path: &Path, out: &Path, args: &ConvertArgs) -> Result<String> {
    let change = &args.change;
    let level = match (args.level, change.max_splats) {
        (Some(level), _) => DetailLevel::Number(level),
        (None, Some(most)) => DetailLevel::Budget(most),
        (None, None) => DetailLevel::Finest,
    };
    let mut scene = read_saying_remarks(path, &ReadOptions { level, ..ReadOptions::default() })?;
    check(&mut scene, path, args.repair)?;
    let facts = Metadata { up: change.up_now, ..Metadata::default() };
    let mut notes: Vec<String> = change_sky(&mut scene, path, change.sky, &facts)?.into_iter().collect();
    notes.extend(apply(&mut scene, change, &args.run).with_context(|| path.display().to_string())?);
    if let Some(origin) = change.origin {
        scene.set_origin(origin.0);
    }
    if is_levels(out) {
        let levels = match args.lod {
            LevelCount::Auto => None,
            LevelCount::Number(number) => Some(number),
        };
        return levels::write(out, scene, notes, levels, &args.run);
    }
    let format = format_for(out)?;
    let options = WriteOptions { spz: args.spz_version, gltf: args.gltf };
    notes.extend(lost(&format.loses_with(&options), &scene).into_iter().map(|line| format!("lost: {line}")));
    save(out, &scene, &options)?;
    let bytes: u64 = if format.extensions[0] == "meta.json" { folder_size(out) } else { file_size(out) };
    let (count, megabytes) = (scene.splats.len(), bytes as f64 / 1e6);
    let mut lines = vec![format!("{}: {count} splats, {megabytes:.1} MB, {}", out.display(), format.name)];
    lines.extend(notes.into_iter().map(|note| format!("  {note}")));
    Ok(lines.join("\n"))
}

/// Changes a scene; returns notes to print.
fn apply(scene: &mut Scene, change: &ChangeArgs, run: &RunArgs) -> Result<Vec<String>> {
    let ChangeArgs { crop, up, up_now, scale, sh_degree, max_splats, sky: _, origin: _ } = *change;
    let change = SceneChange { crop, up, up_now, scale, sh_degree, max_splats };
    let renderer = || Ok(run.differentiable()? as Box<dyn Differentiable>);
    Ok(change.apply(scene, renderer, &mut Reporter::default())?)
}
