//! The observer of an evaluation: progress, and the pictures of some photos for the page.

use super::args::EvaluateArgs;
use super::page::PhotoPanels;
use super::truth::explain;
use crate::dataset::Dataset;
use crate::interrupt;
use crate::scene::OpenScene;
use anyhow::{Result, anyhow};
use indicatif::ProgressBar;
use std::ops::ControlFlow;
use weather_magician::train::evaluation::{
    EvaluatedPhoto, Evaluation, EvaluationError, EvaluationObserver, EvaluationOptions, TruthMaps, evaluate,
};
use weather_magician::train::photos::PhotoError;
use weather_magician::train::session::ObserverError;
use wm_render::Geometry;

/// Measures the photos of `data`; also returns the panels of `pictures` photos for the report.
pub(crate) fn measure(
    loaded: OpenScene,
    data: &Dataset,
    truth: &TruthMaps,
    args: &EvaluateArgs,
    pictures: usize,
    bar: &ProgressBar,
) -> Result<(Evaluation, Vec<PhotoPanels>)> {
    let options = EvaluationOptions {
        exposure_fit: args.photos.exposure_fit,
        bad: args.photos.set.options().bad,
        air: args.photos.air,
        geometry: if pictures > 0 { Geometry::DepthNormal } else { Geometry::None },
    };
    let mut progress = ViewProgress {
        bar,
        chosen: evenly(data.places.len(), pictures),
        metres_per_unit: truth.metres_per_unit,
        shown: Vec::new(),
    };
    let OpenScene { mut renderer, place } = loaded;
    let (backend, set) = (renderer.backend_mut(), place.set());
    let evaluated = evaluate(backend, set, place.scene(), data, truth, &options, &mut progress);
    let evaluation = evaluated.map_err(|error| match error {
        EvaluationError::Stopped => interrupt::stopped("nothing was written"),
        EvaluationError::NoPhotos => {
            anyhow!("{}: no photo is left to compare with; copy them again", args.dataset().display())
        }
        EvaluationError::NothingSeen => anyhow!(
            "{}: no splat of it is seen by any camera of {}; give the data set that it was made from",
            args.scene().scene.display(),
            args.dataset().display()
        ),
        EvaluationError::Truth(error) => explain(error),
        EvaluationError::Observer(error) => anyhow::Error::from_boxed(error),
        error => error.into(),
    })?;
    Ok((evaluation, progress.shown))
}

/// Moves the progress bar and draws the pictures of the chosen photos.
struct ViewProgress<'a> {
    bar: &'a ProgressBar,
    chosen: Vec<usize>,
    metres_per_unit: f64,
    shown: Vec<PhotoPanels>,
}

impl EvaluationObserver for ViewProgress<'_> {
    fn proceed(&mut self) -> ControlFlow<()> {
        interrupt::flow()
    }

    fn on_left_out(&mut self, error: &PhotoError) {
        eprintln!("warning: {error}; it is left out");
    }

    fn on_photo(&mut self, photo: &EvaluatedPhoto<'_>) -> Result<(), ObserverError> {
        if self.chosen.contains(&photo.index) {
            self.shown.push(PhotoPanels::new(photo, self.metres_per_unit)?);
        }
        self.bar.inc(1);
        Ok(())
    }
}

/// Returns at most `most` indices below `count`, evenly spaced, the first and the last among them.
fn evenly(count: usize, most: usize) -> Vec<usize> {
    match most.min(count) {
        1 => vec![count / 2],
        most => (0..most).map(|index| index * (count - 1) / (most - 1)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_chosen_evenly() {
        assert_eq!(evenly(9, 3), [0, 4, 8]);
        assert_eq!(evenly(2, 8), [0, 1]);
        assert_eq!(evenly(5, 1), [2]);
        assert_eq!(evenly(5, 0), [0; 0]);
    }
}
