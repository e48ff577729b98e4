//! Photos of a built-in place, and their reconstruction.

use super::street::in_light;
use crate::choices::Choice;
use crate::commands::reconstruct::{self, ReconstructArgs};
use crate::interrupt;
use crate::progress;
use crate::scene::{RunArgs, threads};
use anyhow::{Context, Result, bail};
use clap::{Parser, ValueEnum};
use std::path::{Path, PathBuf};
use wm_base::FormatError;
use wm_capture::Capture;
use wm_street::{
    Lighting, Park, Place, Street,
    capture::{self, CaptureSettings},
    dataset::{self, CameraRoute, DatasetOptions, GroundTruth},
};

/// The place that is photographed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum PlaceChoice {
    /// A village street.
    #[default]
    Street,
    /// A park with a hill and a pond.
    Park,
}

/// Lights that photos are taken in.
pub(crate) const LIGHTS: &[Choice<Lighting>] = &[
    ("sunny", "A summer sun with broken clouds", Lighting::Sunny),
    ("overcast", "The CIE's overcast sky: the truth for relit pictures", Lighting::Overcast),
];
/// Routes of the camera that takes photos.
pub(crate) const ROUTES: &[Choice<CameraRoute>] = &[
    ("walk", "Along the place's walk, at eye level", CameraRoute::Walk),
    ("orbit", "Around the place, from above", CameraRoute::Orbit),
];
/// Exact depth, normals and sky beside photos.
pub(crate) const TRUTHS: &[Choice<GroundTruth>] = &[
    ("write", "The maps are written", GroundTruth::Write),
    ("omit", "The maps are not written", GroundTruth::Omit),
];

/// Cameras of photos: exact ones along a route, or those of a capture like real ones.
#[derive(Clone, Debug)]
pub(crate) enum PhotoSet {
    /// Exact, in metres.
    Exact(DatasetOptions),
    /// With everything that goes wrong.
    Capture(CaptureSettings),
}

/// A set of photos of a place.
#[derive(Clone, Debug)]
pub(crate) struct PhotoSession {
    /// The place.
    pub(crate) place: PlaceChoice,
    /// The light over it.
    pub(crate) light: Lighting,
    /// The photos.
    pub(crate) set: PhotoSet,
}

impl PhotoSession {
    /// The number of photos.
    pub(crate) fn count(&self) -> u32 {
        match &self.set {
            PhotoSet::Exact(options) => options.count,
            PhotoSet::Capture(settings) => settings.flaws.few.unwrap_or(settings.count).min(settings.count),
        }
    }

    /// Width and height of each, px.
    pub(crate) fn size(&self) -> (u32, u32) {
        match &self.set {
            PhotoSet::Exact(options) => options.size,
            PhotoSet::Capture(settings) => settings.size,
        }
    }

    fn write(
        &self,
        place: &Place,
        folder: &Path,
        progress: &mut dyn FnMut(usize) -> bool,
    ) -> Result<Option<Capture>, FormatError> {
        match &self.set {
            PhotoSet::Exact(options) => dataset::write(place, folder, options, progress),
            PhotoSet::Capture(settings) => capture::write(place, folder, settings, progress),
        }
    }

    /// Writes the photos as a COLMAP data set into `folder`. Replaces those of an earlier session.
    ///
    /// # Errors
    /// The options make no photos, the folder cannot be written, or Ctrl-C was pressed.
    pub(crate) fn shoot(&self, folder: &Path, run: &RunArgs) -> Result<()> {
        if let PhotoSet::Capture(settings) = &self.set {
            settings.flaws.check().map_err(anyhow::Error::msg)?;
        }
        clear(folder)?;
        let (message, build): (_, fn() -> Place) = match self.place {
            PlaceChoice::Street => ("building the street", Street::builtin),
            PlaceChoice::Park => ("building the park", Park::builtin),
        };
        let spinner = progress::spinner(message);
        let threads = threads(run.threads)?;
        let place = threads.install(|| in_light(build(), self.light));
        spinner.finish_and_clear();
        let bar = progress::bar(u64::from(self.count()), "photos");
        let taken = threads.install(|| {
            self.write(&place, folder, &mut |done| {
                bar.set_position(done as u64);
                !interrupt::asked()
            })
        })?;
        bar.finish_and_clear();
        match taken {
            Some(_) => Ok(()),
            None => Err(interrupt::stopped(format!("{} is not a whole data set", folder.display()))),
        }
    }
}

/// Removes the photos of an earlier session: those that are left over would not belong to the new
/// model.
///
/// Removes only files that a session writes: any other data set belongs to the user.
fn clear(folder: &Path) -> Result<()> {
    let (images, model) = (folder.join("images"), folder.join("sparse"));
    if !images.exists() && !model.exists() {
        return Ok(());
    }
    if !folder.join(dataset::MARK).is_file() {
        bail!("{}: holds a data set that is not the demo's; name another folder", folder.display());
    }
    for part in [images, model, folder.join("truth")] {
        if part.exists() {
            std::fs::remove_dir_all(&part).with_context(|| format!("cannot clear {}", part.display()))?;
        }
    }
    let facts = folder.join(capture::TRUTH);
    if facts.exists() {
        std::fs::remove_file(&facts).with_context(|| format!("cannot clear {}", facts.display()))?;
    }
    Ok(())
}

/// Command line of a training.
#[derive(Parser, Debug)]
#[command(no_binary_name = true)]
struct Words {
    #[command(flatten)]
    args: ReconstructArgs,
}

/// Returns the run folder of the training of a scene.
pub(crate) fn run_folder(scene: &Path) -> PathBuf {
    scene.with_extension("run")
}

/// Reconstructs the photos in `folder` into `scene` by running the command `reconstruct`. Starts
/// from the beginning, and replaces what exists.
///
/// # Errors
/// Options of `reconstruct`.
pub(crate) fn reconstruct(folder: &Path, scene: &Path, steps: u32, run: &RunArgs) -> Result<()> {
    let mut words: Vec<std::ffi::OsString> = vec![folder.into(), "--out".into(), scene.into()];
    words.extend(["--overwrite".into(), "--run-folder".into(), run_folder(scene).into()]);
    words.extend(TRAINING.map(Into::into));
    words.extend(["--steps".into(), steps.to_string().into()]);
    let Words { mut args } = Words::try_parse_from(words).context("the demo's own options")?;
    args.run = run.clone();
    reconstruct::run(&args)
}

/// Options of the demo's training: the poses are in metres, and all photos have one exposure.
const TRAINING: [&str; 6] = ["--preset", "quick", "--metres-per-unit", "1", "--exposure", "shared"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_of_others_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        clear(folder.path()).unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        assert!(clear(folder.path()).unwrap_err().to_string().contains("not the demo's"));
        std::fs::write(folder.path().join(dataset::MARK), "").unwrap();
        clear(folder.path()).unwrap();
        assert!(!folder.path().join("images").exists());
    }
}
