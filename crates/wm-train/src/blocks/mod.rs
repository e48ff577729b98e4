//! Training in blocks: a place that is too large for one training is cut into cells of the ground,
//! and each cell is trained by itself, on any machine, with the photos that show it.
//!
//! Three steps, which may be separate processes:
//! 1. The plan ([`BlockPlan`], `blocks.json` in the run folder): the cells, their photos and
//!    configurations, and what all trainings share: priors, the brightness of photos, haze and the
//!    sky ([`BlockTraining::open`]).
//! 2. The trainings, one a block ([`BlockTraining::train`]), each in a folder of its own
//!    (`block-000`). A training that was stopped or killed continues from its checkpoint and ends
//!    in the same bytes; its marker is written last, and a block with a whole marker is not trained
//!    again.
//! 3. The join ([`BlockTraining::join`]): splats outside the core of their block are dropped, the
//!    shared sky is added, and up, ground and scale are found as in a single training.
//!
//! A block learns all that its photos show, not only what lies in its core: what surrounds it is
//! learnt too, and dropped at the join. So photos near a border are explained on both sides of it,
//! and both sides meet there.
//!
//! Nothing is masked and nothing is frozen. Blocks share no splats but those of the sky, which do
//! not learn. Whatever each block would find differently by itself (brightness, haze, sky, up,
//! scale) is found once, before the trainings or after them.

mod cells;
mod error;
mod plan;
mod shard;
#[cfg(test)]
mod tests;
mod training;

pub use error::BlockError;
pub use plan::{BlockCount, BlockOptions, BlockPlan, BlockRegion, TrainBlock};
pub use shard::TrainedBlock;
pub use training::{BlockTraining, PLAN, remove, remove_block};
