//! A training in blocks: its plan, and the join of what was trained.

use super::error::BlockError;
use super::plan::{self, BlockOptions, BlockPlan, PlannedHaze, SKY_FILE};
use crate::session::{SessionOptions, TrainObserver, WholeSession};
use crate::{files, priors};
use std::fs;
use std::path::{Path, PathBuf};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::{Group, Scene, Splats};

/// The name of the plan in the run folder.
pub const PLAN: &str = "blocks.json";

/// A training in blocks: its plan, and what is done of it in its run folder.
pub struct BlockTraining {
    pub(super) dataset: PathBuf,
    pub(super) options: SessionOptions,
    pub(super) folder: PathBuf,
    pub(super) plan: BlockPlan,
    /// The checksum of the plan's bytes.
    pub(super) sum: u64,
    /// The data set, if it is open.
    pub(super) whole: Option<WholeSession>,
}

impl BlockTraining {
    /// Reads the plan in the run folder, or makes it: opens the data set, finds priors, brightness,
    /// haze and sky of all photos, and cuts the ground. `options` are those of a training of the
    /// whole; their run folder, `folder`, is that of all blocks.
    ///
    /// # Errors
    /// [`BlockError`] says what is wrong with the data set or the options, or that the plan in the
    /// folder is of other ones.
    pub fn open(
        dataset: &Path,
        options: &SessionOptions,
        blocks: &BlockOptions,
        folder: &Path,
        observer: &mut dyn TrainObserver,
    ) -> Result<Self, BlockError> {
        let path = folder.join(PLAN);
        let mut whole = None;
        if !path.is_file() {
            let opened = WholeSession::open(dataset, options, folder, observer)?;
            plan::make(&opened, options, blocks, folder, observer)?.write(&path)?;
            whole = Some(opened);
        }
        // Also what was just written, so that all processes have the same numbers.
        let (plan, sum) = BlockPlan::read(&path)?;
        plan.check(&path, options, blocks)?;
        let (dataset, folder) = (dataset.to_owned(), folder.to_owned());
        Ok(Self { dataset, options: options.clone(), folder, plan, sum, whole })
    }

    /// Returns the plan.
    #[must_use]
    pub fn plan(&self) -> &BlockPlan {
        &self.plan
    }

    /// Returns the folder of a block.
    #[must_use]
    pub fn block_folder(&self, block: usize) -> PathBuf {
        folder_of(&self.folder, block)
    }

    /// Joins the blocks, all of which are trained, to one scene.
    ///
    /// # Errors
    /// [`BlockError`] names the blocks that are not trained yet, or the file that is damaged.
    pub fn join(&mut self, observer: &mut dyn TrainObserver) -> Result<Scene, BlockError> {
        let missing: Vec<usize> =
            (0..self.plan.blocks.len()).filter(|block| self.trained(*block).is_none()).collect();
        if !missing.is_empty() {
            return Err(BlockError::NotTrained { folder: self.folder.clone(), blocks: missing });
        }
        let degree = self.plan.blocks.iter().map(|block| block.config.sh_degree).max().unwrap_or(0);
        let mut splats = Splats::with_capacity(0, degree);
        let mut steps = 0;
        for (index, block) in self.plan.blocks.iter().enumerate() {
            splats.append(&self.block_splats(index)?);
            steps += block.config.steps;
        }
        if splats.is_empty() {
            return Err(BlockError::Empty(self.folder.clone()));
        }
        splats.append(&self.sky()?);
        if self.whole.is_none() {
            self.whole = Some(WholeSession::open(&self.dataset, &self.options, &self.folder, observer)?);
        }
        let haze = self.plan.haze.as_ref().map(PlannedHaze::haze);
        let (Some(whole), Some(first)) = (&self.whole, self.plan.blocks.first()) else {
            return Err(BlockError::Empty(self.folder.clone()));
        };
        let mut scene = whole.finish(splats, &first.config, haze.as_ref(), observer)?;
        scene.metadata.provenance = Some(format!(
            "weather-magician {}, {} photos, {} blocks, {steps} steps",
            env!("CARGO_PKG_VERSION"),
            self.plan.photos,
            self.plan.blocks.len(),
        ));
        Ok(scene)
    }

    /// Reads the shared sky; empty if there is none.
    pub(super) fn sky(&self) -> Result<Splats, BlockError> {
        match self.plan.sky {
            0 => Ok(Splats::with_capacity(0, 0)),
            count => read_splats(&self.folder.join(SKY_FILE), Group::Sky, count),
        }
    }
}

/// Removes the plan in a run folder, and what was made for it and by it.
///
/// # Errors
/// [`BlockError::Unremoved`] names what the system does not remove.
pub fn remove(folder: &Path) -> Result<(), BlockError> {
    // Without a plan the rest is nothing.
    for name in [PLAN, SKY_FILE, priors::FOLDER] {
        remove_if_there(&folder.join(name))?;
    }
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| is_block(&entry.file_name().to_string_lossy())) {
        remove_if_there(&entry.path())?;
    }
    Ok(())
}

/// Removes what was trained of a block.
///
/// # Errors
/// The errors of [`remove`].
pub fn remove_block(folder: &Path, block: usize) -> Result<(), BlockError> {
    remove_if_there(&folder_of(folder, block))
}

fn folder_of(folder: &Path, block: usize) -> PathBuf {
    folder.join(format!("block-{block:03}"))
}

fn is_block(name: &str) -> bool {
    name.strip_prefix("block-").is_some_and(|number| number.len() >= 3 && number.parse::<usize>().is_ok())
}

fn remove_if_there(path: &Path) -> Result<(), BlockError> {
    files::remove(path).map_err(|reason| BlockError::Unremoved { path: path.to_owned(), reason })
}

/// Reads splats that a part of this module wrote, all of one group.
pub(super) fn read_splats(path: &Path, group: Group, count: usize) -> Result<Splats, BlockError> {
    let mut splats = read_scene(path, &ReadOptions::default())?.as_in_file().splats;
    if splats.len() != count {
        return Err(BlockError::Splats { path: path.to_owned(), found: splats.len(), expected: count });
    }
    splats.groups.fill(group);
    Ok(splats)
}
