//! The built-in street as a scene.

use crate::interrupt;
use crate::progress;
use anyhow::Result;
use weather_magician::Scene;
use wm_street::{Lighting, Place, Street};

/// Builds the street in a light and samples it on `threads` (`None` for one per core).
///
/// # Errors
/// Ctrl-C was pressed, or threads cannot be started.
pub(crate) fn scene(detail: f64, light: Lighting, threads: Option<u16>) -> Result<Scene> {
    let spinner = progress::spinner("building the street");
    let street = in_light(Street::builtin(), light);
    let sampling = street.sampling(detail);
    spinner.finish_and_clear();

    let threads = crate::scene::threads(threads)?;
    let bar = progress::bar(sampling.len() as u64, "splats");
    let sampled = threads.install(|| {
        sampling.scene(&|done| {
            bar.inc(done as u64);
            !interrupt::asked()
        })
    });
    bar.finish_and_clear();
    sampled.ok_or_else(|| interrupt::stopped("nothing was written yet"))
}

/// Puts a place, which is sunny as it is built, into a light.
pub(super) fn in_light(place: Place, light: Lighting) -> Place {
    match light {
        Lighting::Sunny => place,
        light => place.in_light(light),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_do_not_change_the_scene() {
        let one = scene(0.1, Lighting::Sunny, Some(1)).unwrap();
        assert_eq!(one, scene(0.1, Lighting::Sunny, Some(3)).unwrap());
        assert_eq!(one.metadata.metres_per_unit, Some(1.0));
        assert_eq!(one.splats.check(), Ok(()));
    }
}
