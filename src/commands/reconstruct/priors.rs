//! What is believed of the photos before a training: from a folder, or found out now.

use super::ReconstructArgs;
use super::data::Data;
use super::folder::RunFolder;
use crate::interrupt::{self, Interrupted};
use crate::progress;
use anyhow::{Result, bail};
use std::path::Path;
use wm_train::priors::stereo::StereoOptions;
use wm_train::priors::{Priors, PriorsWriter, photos};

/// The folder of priors in a data set and in a run.
pub const FOLDER: &str = "priors";
/// Photos whose priors are made without being asked for: two minutes on two cores.
const MOST_BY_ITSELF: usize = 300;

/// Opens what is asked for, or makes it; `None` if nothing is to be believed.
pub fn open(args: &ReconstructArgs, data: &Data, folder: &RunFolder) -> Result<Option<Priors>> {
    let made = folder.path().join(FOLDER);
    match args.geometry.priors.as_deref() {
        Some(asked) if asked == Path::new("none") => return Ok(None),
        Some(asked) if asked == Path::new("photos") => {}
        Some(asked) => {
            let Some(priors) = Priors::open(asked)? else {
                bail!("{}: holds no priors; make them with `weather-magician priors`", asked.display());
            };
            check(&priors, data)?;
            return Ok(Some(priors));
        }
        None => {
            if let Some(priors) = Priors::open(&args.dataset.join(FOLDER))? {
                check(&priors, data)?;
                return Ok(Some(priors));
            }
        }
    }
    // A run that goes on believes what it believed.
    if args.resume
        && let Some(priors) = Priors::open(&made)?
    {
        return Ok(Some(priors));
    }
    let places = &data.teaching;
    if places.len() > MOST_BY_ITSELF && args.geometry.priors.is_none() {
        eprintln!(
            "geometry: {} photos are more than depth is found out from unasked ({MOST_BY_ITSELF}); \
             --priors photos does it, about a second a photo, or `weather-magician priors` once for all",
            places.len()
        );
        return Ok(None);
    }
    let bar = progress::bar(2 * places.len() as u64, "passes of stereo");
    let mut writer = PriorsWriter::new(&made, photos::SOURCE.into())?;
    let threads = args.run.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    let told = |done: usize| {
        bar.set_position(done as u64);
        !interrupt::asked()
    };
    let options = StereoOptions::default();
    let written =
        pool.install(|| photos::write(&data.capture, &data.photos, places, &options, &mut writer, &told))?;
    bar.finish_and_clear();
    if written.is_none() {
        return Err(Interrupted("no step is done yet".into()).into());
    }
    let index = writer.finish()?;
    let mean = |of: fn(&wm_train::priors::folder::Entry) -> f32| {
        100.0 * index.photos.values().map(of).sum::<f32>() / index.photos.len().max(1) as f32
    };
    eprintln!(
        "geometry: depth of {:.0} % of the pixels from {} photos, {:.0} % are sky",
        mean(|entry| entry.known),
        index.photos.len(),
        mean(|entry| entry.sky_share)
    );
    Ok(Priors::open(&made)?)
}

/// Every photo's maps must have its shape: said before the training.
fn check(priors: &Priors, data: &Data) -> Result<()> {
    let mut found = 0;
    for place in &data.teaching {
        found += usize::from(priors.index().photos.contains_key(data.name(*place)));
        priors.get(data.name(*place), &data.photos.camera(*place, 0))?;
    }
    if found == 0 {
        bail!(
            "{}: no prior is of a photo of this data set; make them with `weather-magician priors`",
            priors.folder().display()
        );
    }
    if found < data.teaching.len() {
        eprintln!("{}: {found} of {} photos have priors", priors.folder().display(), data.teaching.len());
    }
    Ok(())
}
