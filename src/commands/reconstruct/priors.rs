//! What is believed of the photos before a training: from a folder, or found out now.

use super::ReconstructArgs;
use super::data::Data;
use super::folder::RunFolder;
use crate::commands::stereo::{self, FOLDER};
use crate::interrupt::Interrupted;
use anyhow::{Result, bail};
use std::path::Path;
use wm_train::priors::Priors;
use wm_train::priors::stereo::StereoOptions;

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
    let mut places = data.teaching.clone();
    if places.len() > MOST_BY_ITSELF && args.geometry.priors.is_none() {
        eprintln!(
            "geometry: {} photos are more than depth is found out from unasked ({MOST_BY_ITSELF}); \
             --priors photos does it, about a second a photo, or `weather-magician priors` once for all",
            places.len()
        );
        return Ok(None);
    }
    if args.photos.set.skip_bad {
        // The training names them when it meets them. Stereo takes them from the cache in this size.
        let level = wm_train::priors::stereo::level(&data.photos, &places, &StereoOptions::default());
        places.retain(|place| data.photos.get(*place, level).is_ok());
    }
    let written = stereo::write(&data.capture, &data.photos, &places, args.run.threads, &made)?;
    let Some(index) = written else { return Err(Interrupted("no step is done yet".into()).into()) };
    eprintln!("geometry: {}", stereo::known(&index));
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
