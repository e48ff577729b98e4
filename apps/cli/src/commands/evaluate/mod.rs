//! `evaluate`: compares a scene with the photos of a data set, and with true depth, normals and sky
//! if there are maps of them; or pictures with photographs of real weather.

mod args;
mod page;
mod realism;
mod scores;
mod text;
mod truth;
mod views;

pub(crate) use args::EvaluateArgs;

use crate::dataset::{Dataset, HeldOutArgs};
use crate::output::{json_text, write_text};
use crate::progress;
use crate::scene::OpenScene;
use anyhow::{Result, bail};
use scores::EvaluationReport;
use std::path::{Path, PathBuf};
use wm_base::files::check_writable;

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
