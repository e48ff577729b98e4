//! Makes the priors of photos one after the other: estimates, fits and writes them.

use super::args::PriorsArgs;
use super::preview;
use super::source::{PriorAnswer, PriorEstimator};
use crate::dataset::Dataset;
use crate::interrupt;
use crate::progress;
use anyhow::Result;
use indicatif::ProgressBar;
use rayon::prelude::*;
use std::time::{Duration, Instant};
use weather_magician::train::dataset::orientation;
use weather_magician::train::priors::fit::Fit;
use weather_magician::train::priors::folder::Index;
use weather_magician::train::priors::points::{placed, seen_points};
use weather_magician::train::priors::{Prior, PriorsWriter};
use wm_capture::CaptureUp;

/// Longest time between two updates of the index.
const INDEX_INTERVAL: Duration = Duration::from_secs(20);
/// Maximum number of photos for which the reason is printed why they are left out; the index has
/// all reasons.
const MAX_PRINTED_REASONS: usize = 10;

/// The result for a photo: a prior, or the reason why there is none.
pub(crate) type PriorResult = Result<(Prior, Option<Fit>), String>;

/// Makes the priors of all photos.
pub(crate) fn run(args: &PriorsArgs, data: &Dataset, source: &dyn PriorEstimator) -> Result<Index> {
    let name = format!(
        "{}, photos up to {} px, maps up to {} pixels",
        source.name(),
        args.photos.set.longest_side(),
        args.map_pixels
    );
    let mut writer = args.writer(name)?;
    let seen = seen_points(&data.capture, &data.photos, &data.places);
    let left: Vec<usize> =
        (0..data.places.len()).filter(|index| !writer.is_done(data.name(data.places[*index]))).collect();
    let bar = progress::bar(data.places.len() as u64, "photos");
    bar.set_position((data.places.len() - left.len()) as u64);
    bar.reset_eta();
    let (up, _) = orientation(&data.capture, &data.photos, None);
    let mut noted = Instant::now();
    for part in left.chunks(source.batch_size().max(1)) {
        if interrupt::asked() {
            bar.finish_and_clear();
            writer.pause()?;
            let done = writer.index().photos.len() + writer.index().left_out.len();
            let advice = "the same command with --resume continues";
            let all = data.places.len();
            return Err(interrupt::stopped(format!("{done} of {all} photos are done, {advice}")));
        }
        let made = |index: &usize| make(args, data, source, data.places[*index], up.as_ref(), &seen[*index]);
        let name = |index: &usize| data.name(data.places[*index]);
        if let Err(error) = make_part(part, &made, &name, &mut writer, &bar) {
            // The error is reported; finished priors are kept if possible.
            match writer.index().photos.is_empty() {
                true => writer.abandon(),
                false => drop(writer.pause()),
            }
            return Err(error);
        }
        if noted.elapsed() > INDEX_INTERVAL {
            writer.pause()?;
            noted = Instant::now();
        }
    }
    bar.finish_and_clear();
    finish(args, data, writer)
}

/// Makes the priors of some photos at once, and writes them in order.
pub(crate) fn make_part<'d>(
    part: &[usize],
    make: &(dyn Fn(&usize) -> Result<PriorResult> + Sync),
    name: &dyn Fn(&usize) -> &'d str,
    writer: &mut PriorsWriter,
    bar: &ProgressBar,
) -> Result<()> {
    let made: Vec<Result<PriorResult>> = part.par_iter().map(make).collect();
    for (photo, made) in part.iter().zip(made) {
        match made? {
            Ok((prior, fit)) => writer.add(name(photo), &prior, fit)?,
            Err(reason) => writer.leave_out(name(photo), reason),
        }
        bar.inc(1);
    }
    Ok(())
}

/// Makes the prior of a photo.
fn make(
    args: &PriorsArgs,
    data: &Dataset,
    source: &dyn PriorEstimator,
    place: usize,
    up: Option<&CaptureUp>,
    seen: &[u32],
) -> Result<PriorResult> {
    let photo = match data.photos.get(place, 0) {
        Ok(photo) => photo,
        Err(error) if args.photos.set.skip_bad => return Ok(Err(error.to_string())),
        Err(error) => return Err(error.into()),
    };
    let given = match source.estimate(data, place)? {
        PriorAnswer::Given(given) => given,
        PriorAnswer::Nothing(reason) => return Ok(Err(reason)),
    };
    let points = placed(&data.capture, &photo.camera, seen);
    Ok(given.prior(&photo, &points, up, data.photos.view(place) as u64).map_err(|reason| reason.to_string()))
}

fn finish(args: &PriorsArgs, data: &Dataset, writer: PriorsWriter) -> Result<Index> {
    let Index { photos, left_out, .. } = writer.index();
    for (name, reason) in left_out.iter().take(MAX_PRINTED_REASONS) {
        eprintln!("left out: {name}: {reason}");
    }
    if left_out.len() > MAX_PRINTED_REASONS {
        eprintln!("left out: {} more", left_out.len() - MAX_PRINTED_REASONS);
    }
    if photos.is_empty() {
        let (first, reason) = left_out.iter().next().unzip();
        let error = anyhow::anyhow!(
            "{}: none of {} photos has a prior; {}: {}",
            writer.folder().display(),
            left_out.len(),
            first.map_or("", String::as_str),
            reason.map_or("", String::as_str)
        );
        writer.abandon();
        return Err(error);
    }
    let index = writer.finish()?;
    preview::write(args, data)?;
    Ok(index)
}
