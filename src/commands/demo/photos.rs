//! Photos of the built-in street, and their reconstruction.

use crate::commands::reconstruct::{self, ReconstructArgs};
use crate::interrupt::{self, Interrupted};
use crate::progress;
use crate::scene::RunArgs;
use anyhow::{Context, Result, bail};
use clap::{Parser, ValueEnum};
use std::path::Path;
use wm_street::{
    Street,
    dataset::{self, CameraRoute, DatasetOptions, GroundTruth},
};

/// Route of the camera that takes photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum PhotoRoute {
    /// Along the street, at eye level.
    #[default]
    Walk,
    /// Around the street, from above.
    Orbit,
}

/// Exact depth, normals and sky beside photos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum TruthChoice {
    /// The maps are written.
    #[default]
    Write,
    /// The maps are not written.
    Omit,
}

/// Options of a set of photos.
#[derive(Clone, Copy, Debug)]
pub struct PhotoSession {
    /// Route of the camera.
    pub route: PhotoRoute,
    /// Number of photos.
    pub count: u32,
    /// Width and height, px.
    pub size: (u32, u32),
    /// Exact maps to write beside them.
    pub truth: TruthChoice,
}

impl PhotoSession {
    fn options(&self) -> DatasetOptions {
        DatasetOptions {
            route: match self.route {
                PhotoRoute::Walk => CameraRoute::Walk,
                PhotoRoute::Orbit => CameraRoute::Orbit,
            },
            count: self.count,
            size: self.size,
            truth: match self.truth {
                TruthChoice::Write => GroundTruth::Write,
                TruthChoice::Omit => GroundTruth::Omit,
            },
            ..DatasetOptions::default()
        }
    }

    /// Writes the photos as a COLMAP data set into `folder`. Replaces those of an earlier session.
    ///
    /// # Errors
    /// The folder cannot be written, or Ctrl-C was pressed.
    pub fn shoot(&self, folder: &Path, run: &RunArgs) -> Result<()> {
        clear(folder)?;
        let spinner = progress::spinner("building the street");
        let place = Street::builtin();
        spinner.finish_and_clear();
        let threads = rayon::ThreadPoolBuilder::new().num_threads(run.threads.map_or(0, usize::from)).build();
        let threads = threads.context("cannot start threads")?;
        let bar = progress::bar(u64::from(self.count), "photos");
        let taken = threads.install(|| {
            dataset::write(&place, folder, &self.options(), &mut |done| {
                bar.set_position(done as u64);
                !interrupt::asked()
            })
        })?;
        bar.finish_and_clear();
        match taken {
            Some(_) => Ok(()),
            None => Err(Interrupted(format!("{} is not a whole data set", folder.display())).into()),
        }
    }
}

/// Removes the photos of an earlier session: those that are left over would not belong to the new model.
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
    Ok(())
}

/// Command line of a training.
#[derive(Parser, Debug)]
#[command(no_binary_name = true)]
struct Words {
    #[command(flatten)]
    args: ReconstructArgs,
}

/// Reconstructs the photos in `folder` into `scene` by running the command `reconstruct`.
///
/// # Errors
/// Options of `reconstruct`.
pub fn reconstruct(folder: &Path, scene: &Path, steps: u32, run: &RunArgs) -> Result<()> {
    let run_folder = scene.with_extension("run");
    // The demo starts from the beginning each time: the remains of an interrupted one are removed.
    let left = run_folder.join(reconstruct::CHECKPOINT);
    if left.exists() {
        std::fs::remove_file(&left).with_context(|| format!("cannot remove {}", left.display()))?;
    }
    let mut words: Vec<std::ffi::OsString> = vec![folder.into(), "--out".into(), scene.into()];
    words.extend(["--run-folder".into(), run_folder.into()]);
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
