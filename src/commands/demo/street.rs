//! The built-in street as a scene.

use crate::interrupt::{self, Interrupted};
use crate::progress;
use anyhow::{Context, Result};
use rayon::prelude::*;
use wm_scene::splats::Splat;
use wm_scene::{Scene, Splats};
use wm_street::Street;

/// Splats that one thread makes at a time: enough to be worth the hand-over, few enough to stop soon.
const CHUNK: usize = 2048;

/// Builds the street and samples it on `threads` (`None` for one a core).
///
/// # Errors
/// Ctrl-C was pressed, or there are no threads to be had.
pub fn scene(detail: f64, threads: Option<usize>) -> Result<Scene> {
    let spinner = progress::spinner("building the street");
    let place = Street::builtin();
    let sampling = place.sampling(detail);
    spinner.finish_and_clear();

    let threads = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
    let threads = threads.context("cannot start threads")?;
    let bar = progress::bar(sampling.len() as u64, "splats");
    let parts: Vec<Vec<Splat>> = threads.install(|| {
        let chunks = (0..sampling.len().div_ceil(CHUNK)).into_par_iter();
        let parts = chunks.map(|chunk| {
            if interrupt::asked() {
                return Vec::new();
            }
            let range = chunk * CHUNK..(chunk + 1) * CHUNK;
            let part = range.filter_map(|index| sampling.splat(index)).collect();
            bar.inc(CHUNK as u64);
            part
        });
        parts.collect()
    });
    bar.finish_and_clear();
    if interrupt::asked() {
        return Err(Interrupted("nothing was written yet".into()).into());
    }
    let mut splats = Splats::with_capacity(parts.iter().map(Vec::len).sum(), 0);
    parts.iter().flatten().for_each(|splat| splats.push(splat));
    Ok(Scene { splats, metadata: place.metadata(), views: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_do_not_change_the_scene() {
        let one = scene(0.1, Some(1)).unwrap();
        assert_eq!(one, scene(0.1, Some(3)).unwrap());
        assert_eq!(one.metadata.metres_per_unit, Some(1.0));
        assert_eq!(one.splats.check(), Ok(()));
    }
}
