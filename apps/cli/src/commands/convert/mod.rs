//! `convert`: converts scenes to another format; rotates, scales, crops and reduces them.

pub(crate) mod levels;
mod tiles;

use crate::choices::{Choice, SKIES, one_of};
use crate::names::stem_of;
use crate::overwrite::OverwriteArgs;
use crate::progress::{self, Reporter};
use crate::scene::{RunArgs, change_sky, check, read_saying_remarks, save};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use glam::DVec3;
use levels::is_levels;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use weather_magician::formats::{
    DetailLevel, GltfSplats, ReadOptions, SpzVersion, WriteOptions, format_for, lost,
};
use weather_magician::view::spec;
use weather_magician::{CropBox, LengthScale, Metadata, Scene, SceneChange};
use wm_base::files::check_writable;
use wm_render::Differentiable;
use wm_scene::levels::MAX_LEVELS;
use wm_scene::survey::OwnSky;

/// Options of `convert`.
#[derive(Args, Debug)]
#[command(
    after_help = "Formats: .ply, .compressed.ply, .spz, .sog, FOLDER/meta.json (SOG), FOLDER/lod-meta.json (levels of detail), .glb, \
                        .splat, .ksplat; of a scene in levels of detail also FOLDER/tileset.json (3D Tiles). \
                        docs/guide/formats.md says what each loses.\n\n\
                        weather-magician convert garden.ply garden.spz\n\
                        weather-magician convert scans/*.ply --to sog --folder web/\n\
                        weather-magician convert town.sog small.glb --max-splats 500000 --up 0,1,0\n\
                        weather-magician convert town.ply town/lod-meta.json\n\
                        weather-magician convert city/lod-meta.json city-tiles/tileset.json"
)]
pub(crate) struct ConvertArgs {
    /// Input and output scene; with --to any number of input scenes
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// Convert every given scene to the format with this extension, such as spz
    #[arg(long, value_name = "ENDING")]
    to: Option<String>,
    /// Output folder, with --to; it is made if it is not there [default: beside each scene]
    #[arg(long, value_name = "FOLDER", requires = "to")]
    folder: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Remove splats that cannot be drawn (NaN, infinite or absurd numbers, rows of zeros), and
    /// continue
    #[arg(long)]
    repair: bool,
    /// Level of a scene with several levels of detail; 0 is the finest [default: the finest, or the
    /// finest that fits --max-splats]
    #[arg(long, value_name = "N")]
    level: Option<u32>,
    #[command(flatten)]
    change: ChangeArgs,
    /// Number of levels of a lod-meta.json, each with half the splats of the one before, or auto:
    /// down to a 128th, of large scenes a 512th
    #[arg(long, value_name = "N|auto", default_value = "auto", help_heading = "Format")]
    lod: LevelCount,
    /// Version of SPZ: 3 (gzip, read by most programs) or 4 (Zstandard)
    #[arg(long, value_name = "N", value_parser = one_of(SPZ_VERSIONS), default_value = "3", help_heading = "Format")]
    spz_version: SpzVersion,
    /// Encoding of splats in a glTF: floats or SPZ
    #[arg(long, value_name = "HOW", value_parser = one_of(GLTF_SPLATS), default_value = "floats", help_heading = "Format")]
    gltf: GltfSplats,
    #[command(flatten)]
    run: RunArgs,
}

/// Changes to apply, in this order.
#[derive(Args, Debug)]
#[command(next_help_heading = "Change")]
struct ChangeArgs {
    /// Keep only splats in this box, two corners in the axes of the input scene
    #[arg(long, value_name = "X,Y,Z:X,Y,Z", value_parser = parse_box, allow_hyphen_values = true)]
    crop: Option<CropBox>,
    /// Rotate the scene so that up becomes this direction, such as 0,1,0
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true)]
    up: Option<DVec3>,
    /// Up direction in the input scene, for --up [default: from the file, the photos or the splats]
    #[arg(long, value_name = "X,Y,Z", value_parser = spec::parse_direction, allow_hyphen_values = true)]
    up_now: Option<DVec3>,
    /// The scene's own sky: keep it, drop it, or rebuild it from what is far and above the horizon
    #[arg(long, value_name = "HOW", value_parser = one_of(SKIES), default_value = "keep")]
    sky: OwnSky,
    /// Multiply all lengths by this factor; `metres` makes a unit a metre if the scene's scale is
    /// known
    #[arg(long, value_name = "FACTOR", value_parser = parse_scale)]
    scale: Option<LengthScale>,
    /// Keep positions relative to this point of the world, or to none [default: the origin of the
    /// input scene; one is chosen if its coordinates are far from zero]
    #[arg(long, value_name = "X,Y,Z|none", allow_hyphen_values = true)]
    origin: Option<GivenOrigin>,
    /// Remove SH above this degree, 0 to 3
    #[arg(long, value_name = "D", value_parser = clap::value_parser!(u8).range(0..=3))]
    sh_degree: Option<u8>,
    /// Reduce to this many splats; keeps those that contribute most to views around the scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    max_splats: Option<u64>,
}

/// An origin as users give it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct GivenOrigin(DVec3);

impl FromStr for GivenOrigin {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let origin = if text == "none" { DVec3::ZERO } else { spec::parse_point(text)? };
        match (Metadata { origin: Some(origin), ..Metadata::default() }).fault() {
            None => Ok(Self(origin)),
            Some(fault) => Err(fault),
        }
    }
}

/// Number of levels of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LevelCount {
    Auto,
    Number(u32),
}

impl FromStr for LevelCount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let number = text.parse().ok().filter(|number| (1..=MAX_LEVELS).contains(number));
        number.map(Self::Number).ok_or_else(|| format!("give a number from 1 to {MAX_LEVELS}, or auto"))
    }
}

/// Versions of SPZ.
const SPZ_VERSIONS: &[Choice<SpzVersion>] = &[("3", "", SpzVersion::V3), ("4", "", SpzVersion::V4)];
/// Encodings of splats in a glTF.
const GLTF_SPLATS: &[Choice<GltfSplats>] =
    &[("floats", "", GltfSplats::Floats), ("spz", "", GltfSplats::Spz)];

/// Reads a box, as two opposite corners.
pub(crate) fn parse_box(text: &str) -> Result<CropBox, String> {
    let (a, b) = text.split_once(':').ok_or("write two corners, such as -5,-5,0:5,5,3")?;
    Ok(CropBox::between(spec::parse_point(a)?, spec::parse_point(b)?))
}

fn parse_scale(text: &str) -> Result<LengthScale, String> {
    if text == "metres" {
        return Ok(LengthScale::Metres);
    }
    let factor = text.parse().ok().filter(|f: &f64| f.is_finite() && *f > 0.0);
    factor.map(LengthScale::Factor).ok_or_else(|| "give a number above 0, or metres".into())
}

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

fn file_size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |about| about.len())
}

/// Returns the size of the JSON and the pictures of a SOG folder, bytes.
fn folder_size(main: &Path) -> u64 {
    let entries = main.parent().and_then(|folder| std::fs::read_dir(folder).ok());
    let paths = entries.into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    paths
        .filter(|path| path == main || path.extension().is_some_and(|e| e == "webp"))
        .map(|path| file_size(&path))
        .sum()
}

/// Changes a scene; returns notes to print.
fn apply(scene: &mut Scene, change: &ChangeArgs, run: &RunArgs) -> Result<Vec<String>> {
    let ChangeArgs { crop, up, up_now, scale, sh_degree, max_splats, sky: _, origin: _ } = *change;
    let change = SceneChange { crop, up, up_now, scale, sh_degree, max_splats };
    let renderer = || Ok(run.differentiable()? as Box<dyn Differentiable>);
    Ok(change.apply(scene, renderer, &mut Reporter::default())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_scales_are_read() {
        let kept = parse_box("1,2,3:-1,0,5").unwrap();
        assert!(
            kept.holds([0.0, 1.0, 4.0]) && !kept.holds([0.0, 1.0, 5.5]) && !kept.holds([f32::NAN, 1.0, 4.0])
        );
        for bad in ["", "1,2,3", "1,2:3,4", "a,b,c:1,2,3"] {
            assert!(parse_box(bad).is_err(), "{bad}");
        }
        assert_eq!("auto".parse(), Ok(LevelCount::Auto));
        assert_eq!("5".parse(), Ok(LevelCount::Number(5)));
        assert!(["0", "65", "-1", "all"].iter().all(|bad| bad.parse::<LevelCount>().is_err()));
        assert_eq!(parse_scale("metres"), Ok(LengthScale::Metres));
        assert!(parse_scale("0").is_err() && parse_scale("-1").is_err() && parse_scale("m").is_err());
    }
}
