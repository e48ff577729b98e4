//! `inspect`: the content of a scene, a capture, a driving log or a weather, and every doubt about
//! it.

mod findings;
mod inputs;
mod levels;
mod light;

use crate::output::print_json;
use crate::overwrite::OverwriteArgs;
use crate::scene::{FactArgs, count_of, read_options};
use anyhow::{Result, bail};
use clap::Args;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::PathBuf;
use weather_magician::Metadata;
use weather_magician::formats::{SceneFormat, read_scene_and_format, write_sidecar};
use wm_base::files::check_writable;
use wm_scene::health::{Bounds, Health, Histogram};
use wm_scene::levels::LevelIndex;
use wm_scene::posts::{Post, find_posts};
use wm_scene::survey::{Sourced, Survey, label_sky};
use wm_scene::{Group, Remark, Severity};

/// Options of `inspect`.
#[derive(Args, Debug)]
pub(crate) struct InspectArgs {
    /// The scene: a PLY, SPZ, SOG, glTF, .splat or .ksplat, or the folder of a 3DGS training or a
    /// SOG; or a capture, a driving log, a weather file or a weather report
    scene: PathBuf,
    /// Level of a scene with several levels of detail; 0 is the finest
    #[arg(long, value_name = "N")]
    level: Option<u32>,
    #[command(flatten)]
    facts: FactArgs,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
    /// Fail if there is any doubt: the exit code is 1. Notes are no doubts
    #[arg(long)]
    strict: bool,
    /// Split the light of the photos into sun and sky, as weather with `light` does, and report it;
    /// takes seconds
    #[arg(long)]
    light: bool,
    /// Draw it too, as a PNG: the place as captured and under clouds, what is in the sun, and what
    /// is open to the sky
    #[arg(long, value_name = "PATH", requires = "light")]
    light_picture: Option<PathBuf>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Write up, ground, scale and airlight into a TOML file beside the scene, from which all
    /// commands read them
    #[arg(long)]
    save_metadata: bool,
}

/// Runs the command.
pub(crate) fn run(args: &InspectArgs) -> Result<()> {
    let given = args.facts.metadata()?;
    if let Some(path) = &args.light_picture {
        args.overwrite.check_report(path, &[&args.scene])?;
        check_writable(path)?;
    }
    if let Some(input) = inputs::read(&args.scene)? {
        if args.light || args.save_metadata {
            bail!("{}: --light and --save-metadata need a scene", args.scene.display());
        }
        if args.json {
            let mut report = input.report(&args.scene);
            report["findings"] = json!(input.findings);
            print_json(&report)?;
        } else {
            input.print(&args.scene);
            findings::print(&input.findings);
        }
        return judge(args, &input.findings);
    }
    let (mut scene, format) = read_scene_and_format(&args.scene, &read_options(args.level))?;
    let labelled = scene.splats.groups.contains(&Group::Sky);
    label_sky(&mut scene.splats);
    let mut health = Health::of(&scene.splats);
    // People are told coordinates of the world.
    let origin = scene.metadata.origin_or_zero().to_array();
    for bounds in [&mut health.bounds, &mut health.robust_bounds].into_iter().flatten() {
        for (axis, origin) in origin.into_iter().enumerate() {
            bounds.min[axis] += origin;
            bounds.max[axis] += origin;
        }
    }
    let survey = Survey::of(&scene, &given);
    let levels = LevelIndex::of_scene(&args.scene)?;
    let findings = findings::of_scene(&scene, &health, &survey);
    if args.json {
        let mut report = report(args, format, &scene, &health, &survey);
        report["findings"] = json!(findings);
        if let Some(levels) = &levels {
            report["levels"] = levels::report(levels);
        }
        print_json(&report)?;
    } else {
        print(args, format, &scene, &health, &survey, labelled);
        findings::print(&findings);
        levels.iter().for_each(levels::print);
    }
    if args.light {
        light::show(&args.scene, scene.clone(), given, args.light_picture.as_deref())?;
    }
    if args.save_metadata {
        let file = weather_magician::formats::folder::scene_file(&args.scene)?;
        let metadata = scene.metadata_beside_file(survey.metadata().or(scene.metadata.clone()));
        write_sidecar(&file, &metadata)?;
        eprintln!("{}: written", weather_magician::formats::sidecar_path(&file).display());
    }
    judge(args, &findings)
}

/// Elevation of the low sun that is told of, degrees.
const LOW_SUN: f64 = 8.0;

/// Fails if there is a doubt and `--strict` is given.
fn judge(args: &InspectArgs, findings: &[Remark]) -> Result<()> {
    let doubts = findings.iter().filter(|finding| finding.severity == Severity::Doubt).count();
    if args.strict && doubts > 0 {
        bail!("{}: {}; --strict allows none", args.scene.display(), count_of(doubts, "doubt"));
    }
    Ok(())
}

fn report(
    args: &InspectArgs,
    format: &SceneFormat,
    scene: &wm_scene::Scene,
    health: &Health,
    survey: &Survey,
) -> serde_json::Value {
    fn sourced<T: serde::Serialize>(value: &Sourced<T>) -> serde_json::Value {
        json!({
            "value": &value.value,
            "source": value.source.to_string(),
            "confidence": value.confidence,
        })
    }
    json!({
        "scene": args.scene.display().to_string(),
        "format": { "name": format.name, "loses": format.loses.lines() },
        "health": health,
        "views": scene.views.len(),
        "survey": {
            "up": sourced(&survey.up),
            "up_source": survey.up_source,
            "ground": sourced(&Sourced { value: survey.world_ground(), ..survey.ground }),
            "metres_per_unit": sourced(&survey.metres_per_unit),
            "scale_source": survey.scale_source,
            "north": survey.north,
            "north_source": survey.north_source,
            "sun": survey.sun.as_ref().map(|sun| json!({
                "direction": sun.direction,
                "azimuth_degrees": sun.azimuth.map(f64::to_degrees),
                "elevation_degrees": sun.elevation.to_degrees(),
                "source": sun.source,
                "confidence": sun.confidence,
            })),
            "low_sun": survey.sunny_side.towards(LOW_SUN).map(|(towards, lit)| json!({
                "elevation_degrees": LOW_SUN,
                "towards": towards,
                "lit": lit,
            })),
            "no_sun": survey.sun_fault.map(|fault| fault.to_string()),
            "airlight": sourced(&survey.airlight),
            "origin": survey.origin,
            "center": survey.center + survey.origin,
            "radius": survey.radius,
            "extent": survey.extent,
            "sky_splats": survey.sky_splats,
        },
        "metadata": scene.metadata,
    })
}

fn print(
    args: &InspectArgs,
    format: &SceneFormat,
    scene: &wm_scene::Scene,
    health: &Health,
    survey: &Survey,
    labelled: bool,
) {
    println!("{}", args.scene.display());
    println!("  format: {} ({})", format.name, format.about);
    for line in format.loses.lines() {
        println!("  not in it: {line}");
    }
    println!("  splats: {}, SH degree {}", health.splats, health.sh_degree);
    let how = if labelled { "labelled in the file" } else { "found" };
    for (group, count) in health.groups.iter().filter(|(group, _)| **group != Group::Scene) {
        println!("  group {}: {count} ({how})", group.name());
    }
    if !scene.views.is_empty() {
        println!("  views of photos: {}", scene.views.len());
    }
    let show = |name: &str, bounds: &Option<Bounds>| {
        if let Some(Bounds { min, max }) = bounds {
            let range = |k: usize| format!("{:.2} .. {:.2}", min[k], max[k]);
            println!("  {name}: x {}, y {}, z {}", range(0), range(1), range(2));
        }
    };
    show("bounds", &health.bounds);
    show("1 % to 99 %", &health.robust_bounds);
    println!("The place");
    for line in survey.lines() {
        println!("  {line}");
    }
    if let Some((towards, lit)) = survey.sunny_side.towards(LOW_SUN) {
        let [x, y, z] = towards.to_array();
        let share = 100.0 * lit;
        println!(
            "  low sun: lights most from {x:.2}, {y:.2}, {z:.2}: {share:.0} % of what is near the ground at {LOW_SUN} degrees"
        );
    }
    if let Some(range) = scene.metadata.haze() {
        println!("  haze: the photos were taken in haze of {range} (taken out)");
    }
    if let Some(outlines) = &scene.metadata.water {
        println!("  water: {} in the metadata", count_of(outlines.len(), "outline"));
    }
    if let Some(labels) = &scene.metadata.water_labels {
        let is_water = |label: &&u16| labels.contains(label);
        let count = scene.splats.labels.iter().filter(is_water).count();
        println!("  water: {} of {}", count_of(count, "splat"), count_of(labels.len(), "label"));
    }
    let Metadata { lamps, windows, .. } = &scene.metadata;
    if lamps.is_none() {
        let posts = find_posts(&scene.splats, survey);
        println!("  posts that may carry lamps: {}", posts.len());
        for Post { head, height } in posts {
            let [x, y, z] = (head + survey.origin).to_array();
            println!("    {x:.2}, {y:.2}, {z:.2}: {height:.1} m high");
        }
    }
    if let Some(lamps) = lamps {
        let windows = windows.as_ref().map_or(0, Vec::len);
        println!("  lamps: {}, {}", count_of(lamps.len(), "lamp"), count_of(windows, "lit window"));
    }
    if let Some(entries) = &scene.metadata.reflectances {
        let labels: BTreeSet<u16> = entries.iter().map(|entry| entry.label).collect();
        println!("  reflectances: of {}", count_of(labels.len(), "label"));
    }
    println!("Opacity");
    histogram(&health.opacity, |v| format!("{v:.2}"));
    println!("Largest standard deviation, units");
    histogram(&health.log10_scale, |v| format!("{:.1e}", 10f64.powf(v)));
}

/// Prints bins that hold something as bars.
fn histogram(histogram: &Histogram, name: impl Fn(f64) -> String) {
    const MAX_BAR_LENGTH: f64 = 40.0;
    let most = histogram.counts.iter().copied().max().unwrap_or(0).max(1) as f64;
    let width = (histogram.max - histogram.min) / histogram.counts.len() as f64;
    let first = histogram.counts.iter().position(|c| *c > 0).unwrap_or(0);
    let last = histogram.counts.iter().rposition(|c| *c > 0).unwrap_or(0);
    for (i, count) in histogram.counts.iter().enumerate().take(last + 1).skip(first) {
        let low = histogram.min + width * i as f64;
        let bar = "#".repeat((MAX_BAR_LENGTH * *count as f64 / most).ceil() as usize);
        println!("  {:>8} .. {:<8} {count:>9} {bar}", name(low), name(low + width));
    }
    if histogram.below + histogram.above > 0 {
        println!("  below: {}, above: {}", histogram.below, histogram.above);
    }
}
