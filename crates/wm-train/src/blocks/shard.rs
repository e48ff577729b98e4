//! The training of one block: begun, continued or found done.

use super::error::BlockError;
use super::training::{BlockTraining, read_splats};
use crate::checkpoint::{FNV_START, Summed};
use crate::config::TrainConfig;
use crate::dataset::HeldOut;
use crate::files::write_json;
use crate::poor_photos::PoorPhotoMode;
use crate::session::{CHECKPOINT, PriorSource, Resume, Session, SessionOptions, TrainObserver, TrainPart};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, BufReader};
use std::path::Path;
use std::sync::Arc;
use wm_base::files::write_durably;
use wm_scene::formats::write_scene;
use wm_scene::{Group, Scene, Splats};

/// The marker of a block that is trained, in its folder; it is written last.
const MARKER_FILE: &str = "trained.json";
/// The splats of its core.
const SPLATS_FILE: &str = "splats.ply";

/// A block that is trained.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedBlock {
    /// The checksum of the plan (FNV-1a, 64 bit).
    plan: String,
    /// The number of the block.
    pub block: usize,
    /// Splats that were trained, without the sky's.
    pub trained: usize,
    /// Splats in the core of the block, which the scene has from it.
    pub splats: usize,
    /// The size of their file, bytes, and its checksum; 0 and that of nothing if there are none.
    bytes: u64,
    checksum: String,
}

impl BlockTraining {
    /// Returns what is known of a block that is trained; `None` if it is not, or its splats are
    /// damaged.
    #[must_use]
    pub fn trained(&self, block: usize) -> Option<TrainedBlock> {
        let folder = self.block_folder(block);
        let marker: TrainedBlock = serde_json::from_slice(&fs::read(folder.join(MARKER_FILE)).ok()?).ok()?;
        let (bytes, checksum) = match marker.splats {
            0 => (0, text(FNV_START)),
            _ => sum(&folder.join(SPLATS_FILE)).ok()?,
        };
        let is_whole = marker.block == block
            && marker.plan == text(self.sum)
            && (marker.bytes, &marker.checksum) == (bytes, &checksum);
        is_whole.then_some(marker)
    }

    /// Trains a block, if it is not trained yet: from its checkpoint, if it has one. The splats of
    /// its core are written into its folder, and the marker after them.
    ///
    /// # Errors
    /// [`BlockError`] if there is no such block, its training ends early or its folder cannot be
    /// written to.
    pub fn train(&self, block: usize, observer: &mut dyn TrainObserver) -> Result<TrainedBlock, BlockError> {
        let last = self.plan.blocks.len() - 1;
        let planned = self.plan.blocks.get(block).ok_or(BlockError::NoBlock { block, last })?;
        if let Some(trained) = self.trained(block) {
            return Ok(trained);
        }
        let folder = self.block_folder(block);
        let part = TrainPart {
            photos: planned.cameras.clone(),
            held_out: planned.held_out.clone(),
            gains: self.plan.gains.clone(),
            haze: self.plan.haze.as_ref().map(|planned| (planned.haze(), planned.gains.clone())),
            sky: self.sky()?,
        };
        let options = self.session_options(planned.config.clone(), part, &folder);
        let mut training = Session::new(&self.dataset).options(options).prepare(observer)?;
        training.run_to_end(observer)?;
        let splats = training.splats()?;
        let is_own = |index: &usize| splats.groups[*index] != Group::Sky;
        let own: Vec<usize> = (0..splats.len()).filter(is_own).collect();
        let is_core = |index: &usize| {
            let mean = DVec3::from_array(splats.means[*index].map(f64::from));
            self.plan.is_core(planned, mean)
        };
        let core: Vec<usize> = own.iter().copied().filter(is_core).collect();
        let (bytes, checksum) = match core.is_empty() {
            true => (0, text(FNV_START)),
            false => {
                let path = folder.join(SPLATS_FILE);
                let splats = splats.select(&core);
                write_scene(&path, &Scene { splats, ..Scene::default() })?;
                sum(&path).map_err(|reason| BlockError::Unread { path, reason })?
            }
        };
        let (trained, splats, plan) = (own.len(), core.len(), text(self.sum));
        let marker = TrainedBlock { plan, block, trained, splats, bytes, checksum };
        write_durably(&folder.join(MARKER_FILE), |out| Ok(write_json(&marker, out)?))?;
        Ok(marker)
    }

    /// Reads the splats of the core of a block that is trained.
    pub(super) fn block_splats(&self, block: usize) -> Result<Splats, BlockError> {
        match self.trained(block).map_or(0, |trained| trained.splats) {
            0 => Ok(Splats::with_capacity(0, 0)),
            count => read_splats(&self.block_folder(block).join(SPLATS_FILE), Group::Scene, count),
        }
    }

    fn session_options(&self, config: TrainConfig, part: TrainPart, folder: &Path) -> SessionOptions {
        let options = self.options.clone();
        let is_begun = folder.join(CHECKPOINT).is_file();
        SessionOptions {
            held_out: HeldOut::default(),
            // Poor photos are left out by the plan, which compares all.
            poor_photos: PoorPhotoMode::Keep,
            config: Some(config),
            priors: match &self.plan.priors {
                Some(priors) => PriorSource::Folder(self.folder.join(priors)),
                None => PriorSource::None,
            },
            run_folder: Some(folder.to_owned()),
            resume: if is_begun { Resume::Always } else { Resume::Overwrite },
            part: Some(Arc::new(part)),
            ..options
        }
    }
}

/// A checksum as markers state it.
fn text(sum: u64) -> String {
    format!("{sum:016x}")
}

/// Returns the size of a file, bytes, and its checksum.
fn sum(path: &Path) -> io::Result<(u64, String)> {
    let mut file = BufReader::with_capacity(1 << 18, File::open(path)?);
    let mut out = Summed { inner: &mut io::sink(), sum: FNV_START };
    let bytes = io::copy(&mut file, &mut out)?;
    Ok((bytes, text(out.sum)))
}
