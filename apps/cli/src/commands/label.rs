//! `label`: gives splats labels or instances by masks of the photos.

use crate::choices::{Choice, one_of};
use crate::overwrite::OverwriteArgs;
use crate::progress;
use crate::scene::{RunArgs, read_checked, save};
use anyhow::{Result, bail};
use clap::Args;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use weather_magician::formats::{Retention, WriteOptions, format_for};
use weather_magician::labels::{LabelKind, LabelVotes, VotedLabels};
use weather_magician::train::photos::PhotoSize;
use weather_magician::wm_image::maps::{Filter, MapFolder, read_map};
use weather_magician::{Camera, Scene};
use wm_base::files::check_writable;

/// Longest side of the pictures in which splats vote, px.
const MAX_PICTURE_SIDE_PX: u32 = 1280;

/// Options of `label`.
#[derive(Args, Debug)]
#[command(
    after_help = "A mask is grey: 8 or 16 bits a pixel as .png, or .npy, .tif or .exr; its number is the label, 0 is none. Its name is that \
                  of the photo with another ending, and it fits the photo without its lens. Each splat gets the label on whose \
                  pixels most of its weight lies.\n\n\
                  weather-magician label garden.ply --masks masks/ -o garden-labelled.ply\n\
                  weather-magician label garden.ply --views colmap/ --masks things/ --kind instance -o garden-things.ply\n\
                  weather-magician render garden-labelled.ply --weather heavy-rain --also label -o rain.png"
)]
pub(crate) struct LabelArgs {
    /// The scene: a PLY, SPZ, SOG, glTF, .splat or .ksplat, or the folder of a 3DGS training or a
    /// SOG
    scene: PathBuf,
    /// Folder of the masks
    #[arg(long, value_name = "FOLDER")]
    masks: PathBuf,
    /// COLMAP model or data set with the photos' cameras [default: those of the scene]
    #[arg(long, value_name = "FOLDER")]
    views: Option<PathBuf>,
    /// The meaning of the masks' numbers
    #[arg(long, value_name = "KIND", value_parser = one_of(KINDS), default_value = "label")]
    kind: LabelKind,
    /// Output scene, a .ply: no other format holds labels
    #[arg(short, long, value_name = "PATH")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Remove splats that cannot be drawn (NaN, infinite or absurd numbers, rows of zeros), and
    /// continue
    #[arg(long)]
    repair: bool,
    #[command(flatten)]
    run: RunArgs,
}

/// Meanings of the masks' numbers.
const KINDS: &[Choice<LabelKind>] = &[
    ("label", "Classes, such as road and building", LabelKind::Label),
    ("instance", "Single things", LabelKind::Instance),
];

/// Runs the command.
pub(crate) fn run(args: &LabelArgs) -> Result<()> {
    let out = &args.out;
    if format_for(out)?.loses.labels == Retention::Not {
        bail!("{}: this format has no room for labels; give a name that ends in .ply", out.display());
    }
    check_writable(out)?;
    args.overwrite.check(out, &[&args.scene], "give another name with --out")?;
    if !args.masks.is_dir() {
        bail!("--masks {}: there is no such folder", args.masks.display());
    }
    let mut scene = read_checked(&args.scene, None, args.views.as_ref(), args.repair)?;
    let masks = masks(&scene, args)?;
    let mut renderer = args.run.differentiable()?;
    let mut votes = LabelVotes::new(&scene.splats, scene.metadata.rasterization.unwrap_or_default());
    progress::for_each(masks.iter(), "masks", "nothing was written", |(camera, path), _| {
        let (width, height) = PhotoSize::Longest(MAX_PICTURE_SIDE_PX).reduced(camera.width, camera.height);
        let camera = camera.resized(width, height);
        Ok(votes.add(renderer.as_mut(), &camera, &read_mask(path, &camera)?)?)
    })?;
    let VotedLabels { labels, unseen, won } = votes.finish();
    let kind = args.kind;
    let count = labels.len();
    let mut shares: BTreeMap<u16, usize> = BTreeMap::new();
    labels.iter().for_each(|label| *shares.entry(*label).or_default() += 1);
    *scene.splats.names_mut(kind) = labels;
    save(out, &scene, &WriteOptions::default())?;
    let share = |part: usize| 100.0 * part as f64 / count.max(1) as f64;
    println!(
        "{}: {} {}s on {count} splats by {} masks; {:.1} % of the splats are in none",
        out.display(),
        won.len(),
        kind.name(),
        masks.len(),
        share(unseen)
    );
    if kind == LabelKind::Label {
        let parts: Vec<String> =
            shares.iter().map(|(label, count)| format!("{label}: {:.1} %", share(*count))).collect();
        println!("  {}", parts.join(", "));
    }
    Ok(())
}

/// Returns the cameras that have a mask, and its file.
fn masks(scene: &Scene, args: &LabelArgs) -> Result<Vec<(Camera, PathBuf)>> {
    if scene.views.is_empty() {
        bail!(
            "{}: the scene has no views of photos; name the folder of their COLMAP model with --views",
            args.scene.display()
        );
    }
    let folder = MapFolder::new(&args.masks);
    let mut masks = Vec::new();
    for view in &scene.views {
        if let Some(path) = folder.find(&view.name)? {
            masks.push((view.camera, path));
        }
    }
    if masks.is_empty() {
        bail!(
            "{}: no photo has a mask in it; call masks as the photos, such as {}",
            args.masks.display(),
            Path::new(&scene.views[0].name).with_extension("png").display()
        );
    }
    Ok(masks)
}

/// Reads a mask in the size of a camera.
fn read_mask(path: &Path, camera: &Camera) -> Result<Vec<u16>> {
    let map = read_map(path)?;
    if map.channels != 1 {
        bail!("{}: has {} channels; a mask is grey", path.display(), map.channels);
    }
    let is_label = |value: &f32| value.fract() == 0.0 && (0.0..=65535.0).contains(value);
    if let Some(bad) = map.values.iter().find(|value| !is_label(value)) {
        bail!(
            "{}: the number {bad} is not a label: it must be a whole number from 0 to 65535",
            path.display()
        );
    }
    let fitted = map.fitted(camera.width, camera.height, Filter::Nearest);
    let fitted = fitted.map_err(|fault| anyhow::anyhow!("{}: {fault}", path.display()))?;
    Ok(fitted.values.iter().map(|value| *value as u16).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_render::{CpuConfig, CpuDifferentiable};
    use wm_scene::Rasterization;
    use wm_street::{Label, Street};

    /// Labels that masks of rays through the street vote for are those of its surfaces.
    #[test]
    fn masks_of_the_street_give_back_its_labels() {
        let street = Street::builtin();
        let scene = street.sampling(0.25).scene(&|_| true).unwrap();
        let truth = &scene.splats.labels;
        let mut votes = LabelVotes::new(&scene.splats, Rasterization::default());
        let mut renderer = CpuDifferentiable::new(CpuConfig::default()).unwrap();
        let size = (320, 200);
        for step in 0..8 {
            let y = -12.0 + 4.0 * f64::from(step);
            let ahead = if step % 2 == 0 { DVec3::new(0.8, 3.0, -0.2) } else { DVec3::new(-0.8, 2.0, -0.2) };
            let eye = DVec3::new(0.0, y, 1.7);
            let camera = Camera::looking(size, 65.0, eye, eye + ahead, DVec3::Z).unwrap();
            let label = |i: u32| {
                let way = camera.ray(f64::from(i % size.0) + 0.5, f64::from(i / size.0) + 0.5);
                let hit = street.first(eye, way);
                let at = hit.and_then(|hit| Label::ALL.iter().position(|label| *label == hit.label));
                at.map_or(0, |at| at as u16 + 1)
            };
            let mask: Vec<u16> = (0..size.0 * size.1).map(label).collect();
            votes.add(&mut renderer, &camera, &mask).unwrap();
        }
        let weights = votes.weights();
        let voted = votes.finish();
        // Of splats that are seen well, for each label: in both, in one.
        let mut counts: BTreeMap<u16, [f64; 2]> = BTreeMap::new();
        let mut right = [0.0; 2];
        for ((voted, truth), weight) in voted.labels.iter().zip(truth).zip(weights) {
            if weight < 1.0 {
                continue;
            }
            let weight = f64::from(weight);
            right[1] += weight;
            if voted == truth {
                right[0] += weight;
                let both = counts.entry(*truth).or_default();
                (both[0], both[1]) = (both[0] + weight, both[1] + weight);
            } else {
                counts.entry(*truth).or_default()[1] += weight;
                counts.entry(*voted).or_default()[1] += weight;
            }
        }
        eprintln!(
            "{:.4} of all; IoU {:?}",
            right[0] / right[1],
            counts.iter().map(|(l, [a, b])| (l, a / b)).collect::<Vec<_>>()
        );
        assert!(right[0] > 0.93 * right[1], "{right:?}");
        // Path, building and sky, which are large.
        for label in [0, 2, 5] {
            let [both, either] = counts[&label];
            assert!(both > 0.9 * either, "{label}: {both} of {either}");
        }
    }
}
