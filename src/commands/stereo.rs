//! Priors from the photos themselves, as `priors` makes them and `reconstruct` where there are none.

use crate::interrupt;
use crate::progress;
use anyhow::Result;
use std::path::Path;
use wm_scene::capture::Capture;
use wm_train::photos::Photos;
use wm_train::priors::folder::{Entry, Index};
use wm_train::priors::stereo::StereoOptions;
use wm_train::priors::{PriorsWriter, photos};

/// The folder of priors in a data set, and in a run.
pub const FOLDER: &str = "priors";

/// Makes the priors of the photos `places` in a folder; `None` if Ctrl-C was pressed, and no index is there then.
pub fn write(
    capture: &Capture,
    opened: &Photos,
    places: &[usize],
    threads: Option<u16>,
    folder: &Path,
) -> Result<Option<Index>> {
    let bar = progress::bar(2 * places.len() as u64, "passes of stereo");
    let mut writer = PriorsWriter::new(folder, photos::SOURCE.into())?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.map_or(0, usize::from)).build()?;
    let told = |done: usize| {
        bar.set_position(done as u64);
        !interrupt::asked()
    };
    let options = StereoOptions::default();
    let written = pool.install(|| photos::write(capture, opened, places, &options, &mut writer, &told))?;
    bar.finish_and_clear();
    if written.is_none() {
        writer.abandon();
        return Ok(None);
    }
    Ok(Some(writer.finish()?))
}

/// How much is known, in a line.
pub fn known(index: &Index) -> String {
    let mean = |of: fn(&Entry) -> f32| {
        100.0 * index.photos.values().map(of).sum::<f32>() / index.photos.len().max(1) as f32
    };
    format!(
        "depth of {:.0} % of the pixels from {} photos, {:.0} % are sky",
        mean(|entry| entry.known),
        index.photos.len(),
        mean(|entry| entry.sky_share)
    )
}
