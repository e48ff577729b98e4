//! `evaluate`: how near a scene is to the photos of a data set, and to the true depth, normals and sky where
//! there are maps of them.

mod page;
mod scores;
mod text;
mod truth;
mod views;

use crate::names::stem_of;
use crate::progress;
use crate::scene::{Loaded, RunArgs, SceneArgs};
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
use scores::Report;
use serde::Serialize;
use std::path::PathBuf;
use wm_scene::capture::{self, CaptureOptions};
use wm_scene::files::{check_writable, write_atomically};
use wm_train::photos::{BadPhotos, PhotoOptions, PhotoSize, Photos};

/// Options of `evaluate`.
#[derive(Args, Clone, Debug)]
pub struct EvaluateArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// The data set: a folder with a COLMAP model or a transforms.json, in the axes of the scene
    #[arg(short, long, value_name = "FOLDER")]
    dataset: PathBuf,
    #[command(flatten)]
    photos: PhotoArgs,
    #[command(flatten)]
    truth: truth::TruthArgs,
    /// Write all numbers to this JSON file (docs/evaluate.md says what they are)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Write a page to look at: numbers, and pictures of photo, render and error side by side, all in one HTML
    /// file
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    report: Option<PathBuf>,
    /// Most photos whose pictures are in the report, evenly chosen
    #[arg(long, value_name = "N", default_value_t = 8, requires = "report", help_heading = "Output")]
    report_photos: u32,
    #[command(flatten)]
    run: RunArgs,
}

/// Which photos, and how they are compared.
#[derive(Args, Clone, Debug)]
struct PhotoArgs {
    /// Take every N-th photo (in the order of names): those that `reconstruct` held out with the same number;
    /// 0 takes all of them, those that it learnt from included
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Photos")]
    eval_every: u32,
    /// The first photo that is taken, from 0
    #[arg(long, value_name = "K", default_value_t = 0, help_heading = "Photos")]
    eval_from: u32,
    /// What is undone before colours are compared: none, or affine (the change of colour, one for each
    /// photo, that brings the render nearest to it)
    #[arg(long, value_name = "FIT", default_value = "none", help_heading = "Photos")]
    exposure_fit: ExposureFit,
    /// Folder of the photos in the data set, such as images_4 [default: images, or another usual name]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    images: Option<PathBuf>,
    /// Folder of masks in the data set: what is black counts nowhere [default: masks, if it is there]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    masks: Option<PathBuf>,
    /// Folder of the COLMAP model in the data set [default: sparse/0, or another usual place]
    #[arg(long, value_name = "FOLDER", help_heading = "Photos")]
    model: Option<PathBuf>,
    /// Longest side that photos are used with, px; as in the training, for equal numbers
    #[arg(long, value_name = "PX", default_value_t = 1600, value_parser = clap::value_parser!(u32).range(16..=32768), help_heading = "Photos")]
    longest: u32,
    /// Leave out photos that are missing or damaged, and go on
    #[arg(long, help_heading = "Photos")]
    skip_bad: bool,
}

/// What is undone before colours are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum ExposureFit {
    /// Nothing.
    None,
    /// An affine change of colour a photo.
    Affine,
}

/// A data set's photos that are compared.
struct Data {
    capture: capture::Capture,
    photos: Photos,
    /// Places in `photos`.
    places: Vec<usize>,
}

impl Data {
    fn open(args: &EvaluateArgs) -> Result<Self> {
        let PhotoArgs { eval_every, eval_from, images, masks, model, longest, skip_bad, .. } = &args.photos;
        let options = CaptureOptions { images: images.clone(), model: model.clone(), masks: masks.clone() };
        let capture = capture::read(&args.dataset, &options)?;
        let dataset = args.dataset.display();
        if capture.views.is_empty() {
            bail!("{dataset}: there are no photos in it; choose another data set");
        }
        let photos = Photos::open(
            &capture,
            &PhotoOptions {
                size: PhotoSize::Longest(*longest),
                // Each is looked at once; the next is decoded meanwhile.
                cache_bytes: 256 << 20,
                bad: if *skip_bad { BadPhotos::Skip } else { BadPhotos::Refuse },
                ..PhotoOptions::default()
            },
        )?;
        for skipped in photos.skipped() {
            eprintln!("warning: {skipped}; it is left out");
        }
        // By their places in the capture, as `reconstruct` counts them.
        let is_taken = |place: &usize| {
            let view = photos.view(*place) as u32;
            *eval_every == 0 || view % eval_every == eval_from % eval_every
        };
        let places: Vec<usize> = (0..photos.len()).filter(is_taken).collect();
        if places.is_empty() {
            bail!(
                "{dataset}: --eval-every {eval_every} from {eval_from} takes none of {} photos; give smaller numbers",
                capture.views.len()
            );
        }
        Ok(Self { capture, photos, places })
    }

    /// The name of a photo.
    fn name(&self, place: usize) -> &str {
        &self.capture.views[self.photos.view(place)].name
    }
}

/// Runs the command.
pub fn run(args: &EvaluateArgs) -> Result<()> {
    for out in [&args.json, &args.report].into_iter().flatten() {
        check_writable(out)?;
    }
    let data = Data::open(args)?;
    let loaded = Loaded::new(&args.scene, &args.run, None)?;
    let truth = truth::Truth::open(&args.truth, &data, &loaded.survey)?;
    let pictures = if args.report.is_some() { args.report_photos as usize } else { 0 };
    let bar = progress::bar(data.places.len() as u64, "photos");
    let (views, floaters, shown) = views::measure(loaded, &data, &truth, args, pictures, &bar)?;
    bar.finish_and_clear();
    let report = Report::new(args, &data, truth, views, floaters);
    text::print(&report);
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&report.json())?;
        write_atomically(path, |out| Ok(writeln!(out, "{text}")?))?;
    }
    if let Some(path) = &args.report {
        let page = page::page(&report, &shown);
        write_atomically(path, |out| Ok(out.write_all(page.as_bytes())?))?;
        eprintln!("{}: {:.1} MB, for a browser", path.display(), page.len() as f64 * 1e-6);
    }
    Ok(())
}

/// What a scene or a data set is called in a report.
fn name_of(path: &std::path::Path) -> String {
    path.file_name().map_or_else(|| stem_of(path), |name| name.to_string_lossy().into_owned())
}
