//! `evaluate`: compares a scene with the photos of a data set, and with true depth, normals and sky
//! if there are maps of them; or pictures with photographs of real weather.

mod page;
mod realism;
mod scores;
mod text;
mod truth;
mod views;

use crate::choices::{Choice, one_of};
use crate::dataset::{Dataset, DatasetArgs, HeldOutArgs};
use crate::names::stem_of;
use crate::output::{json_text, write_text};
use crate::overwrite::OverwriteArgs;
use crate::progress;
use crate::scene::{OpenScene, RunArgs, SceneArgs};
use anyhow::{Result, bail};
use clap::Args;
use scores::EvaluationReport;
use std::path::{Path, PathBuf};
use weather_magician::train::evaluation::{EvaluationAir, ExposureFit};
use wm_base::files::check_writable;

/// Options of `evaluate`.
#[derive(Args, Clone, Debug)]
// The scene is optional, as pictures are compared without one; its group is needed to detect it,
// and derive leaves it empty.
#[command(mut_arg("scene", |scene| {
    scene.required(false).required_unless_present_any(["pictures", "paper"]).group("SceneArgs")
}))]
pub(crate) struct EvaluateArgs {
    #[command(flatten)]
    scene: Option<SceneArgs>,
    /// The data set: a folder with a COLMAP model or a transforms.json, in the axes of the scene
    #[arg(short, long, value_name = "FOLDER", required_unless_present_any = ["pictures", "paper"])]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    photos: PhotoArgs,
    #[command(flatten)]
    truth: truth::TruthArgs,
    #[command(flatten)]
    realism: realism::RealismArgs,
    /// Write all numbers to this JSON file (docs/guide/evaluate.md describes them)
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    json: Option<PathBuf>,
    /// Write an HTML report: numbers, and pictures of photo, render and error side by side, in one
    /// file
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    report: Option<PathBuf>,
    /// Maximum number of photos in the report, evenly spaced
    #[arg(long, value_name = "N", default_value_t = 8, requires = "report", help_heading = "Output")]
    report_photos: u32,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    #[command(flatten)]
    run: RunArgs,
}

impl EvaluateArgs {
    /// The scene that is compared.
    fn scene(&self) -> &SceneArgs {
        self.scene.as_ref().expect("required but for pictures, which are compared without")
    }

    /// Returns the data set that it is compared with.
    fn dataset(&self) -> &Path {
        self.dataset.as_deref().expect("required but for pictures, which are compared without")
    }
}

/// The photos and the comparison.
#[derive(Args, Clone, Debug)]
#[command(mut_arg("eval_every", |arg| {
    arg.help("Compare every N-th photo (in the order of names): those that `reconstruct` held out with the same number; \
              0 compares all photos, including those used for training")
}))]
#[command(mut_arg("eval_from", |arg| arg.help("The first photo that is compared, from 0")))]
struct PhotoArgs {
    #[command(flatten)]
    set: DatasetArgs,
    #[command(flatten)]
    held_out: HeldOutArgs,
    /// Correction of the render before colours are compared: none, or affine (the change of colour,
    /// one for each photo, that brings the render nearest to it)
    #[arg(long, value_name = "FIT", default_value = "none", value_parser = one_of(EXPOSURE_FITS), help_heading = "Photos")]
    exposure_fit: ExposureFit,
    /// Air between cameras and scene: photos (the haze in which the scene's own photos were taken,
    /// if any) or clear
    #[arg(long, value_name = "AIR", default_value = "photos", value_parser = one_of(AIRS), help_heading = "Photos")]
    air: EvaluationAir,
}

/// Air between cameras and scene.
const AIRS: &[Choice<EvaluationAir>] = &[
    ("photos", "The haze of the scene's photos", EvaluationAir::Photos),
    ("clear", "Clear air", EvaluationAir::Clear),
];
/// Corrections of the render before colours are compared.
const EXPOSURE_FITS: &[Choice<ExposureFit>] = &[
    ("none", "No correction", ExposureFit::None),
    ("affine", "An affine change of colour per photo", ExposureFit::Affine),
];

/// Opens the photos that are compared.
fn open(args: &EvaluateArgs) -> Result<Dataset> {
    let HeldOutArgs { eval_every: every, eval_from: from } = args.photos.held_out;
    let (capture, photos) = args.photos.set.open(args.dataset())?;
    let (held_out, others) = args.photos.held_out.held_out().split(&photos);
    let places = if every == 0 { others } else { held_out };
    if places.is_empty() {
        bail!(
            "{}: --eval-every {every} from {from} takes none of {} photos; give smaller numbers",
            args.dataset().display(),
            capture.views.len()
        );
    }
    Ok(Dataset { capture, photos, places })
}

/// Runs the command.
pub(crate) fn run(args: &EvaluateArgs) -> Result<()> {
    if args.realism.asked() {
        return realism::run(args);
    }
    args.realism.check_idle()?;
    for out in [&args.json, &args.report].into_iter().flatten() {
        check_writable(out)?;
    }
    let data = open(args)?;
    let photos = data.places.iter().filter_map(|place| data.capture.photo(data.photos.view(*place)));
    let inputs: Vec<PathBuf> = photos.chain([args.scene().scene.clone()]).collect();
    let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    for out in [&args.json, &args.report].into_iter().flatten() {
        args.overwrite.check_report(out, &inputs)?;
    }
    let loaded = OpenScene::new(args.scene(), &args.run, None)?;
    let truth = args.truth.open(&data, loaded.place.survey())?;
    let pictures = if args.report.is_some() { args.report_photos as usize } else { 0 };
    let bar = progress::bar(data.places.len() as u64, "photos");
    let (evaluation, shown) = views::measure(loaded, &data, &truth, args, pictures, &bar)?;
    bar.finish_and_clear();
    let report = EvaluationReport::new(args, &data, truth, evaluation);
    text::print(&report);
    if let Some(path) = &args.json {
        write_text(path, &json_text(&report.json())?)?;
    }
    if let Some(path) = &args.report {
        let page = page::page(&report, &shown);
        write_text(path, &page)?;
        eprintln!("{}: {:.1} MB, for a browser", path.display(), page.len() as f64 * 1e-6);
    }
    Ok(())
}

/// Returns the name of a scene or a data set in a report.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| stem_of(path), |name| name.to_string_lossy().into_owned())
}
