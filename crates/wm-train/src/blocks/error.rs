//! The error of a training in blocks.

use crate::plan::PlanError;
use crate::session::SessionError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;
use wm_base::FormatError;

/// A reason why a training in blocks ends without a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BlockError {
    /// The data set cannot be used, or the training of a block ended early.
    #[error(transparent)]
    Session(Box<SessionError>),
    /// A file cannot be read or written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The options of the training are not valid.
    #[error(transparent)]
    Options(#[from] PlanError),
    /// The plan cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Unread {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        reason: io::Error,
    },
    /// A file that is to be replaced cannot be removed.
    #[error("{}: cannot be removed: {reason}", path.display())]
    Unremoved {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        reason: io::Error,
    },
    /// The plan is damaged, or of another version.
    #[error("{}: is no plan of blocks: {reason}; plan again with --overwrite", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The place and the fault.
        reason: String,
    },
    /// The plan was made with other options.
    #[error("{}: was planned with {was}, not {is}; give the options that it was planned with, or plan again with --overwrite", path.display())]
    OtherPlan {
        /// The file.
        path: PathBuf,
        /// The option and its value in the plan.
        was: String,
        /// The value now.
        is: String,
    },
    /// There are more blocks than photos for them.
    #[error(
        "{wanted} blocks for {photos} photos: a block needs {fewest} photos or more, so at most {most} blocks"
    )]
    TooMany {
        /// Blocks that were asked for.
        wanted: usize,
        /// Training photos.
        photos: usize,
        /// Fewest photos of a block.
        fewest: usize,
        /// Most blocks.
        most: usize,
    },
    /// No photo shows anything in the region.
    #[error(
        "no point of the reconstruction is in the region; give a box in the axes of the capture, such as that of its points"
    )]
    EmptyRegion,
    /// There is no such block.
    #[error("there is no block {block}: the plan has blocks 0 to {last}")]
    NoBlock {
        /// The number that was given.
        block: usize,
        /// The last block.
        last: usize,
    },
    /// Blocks are not trained yet.
    #[error("{}: {} to be trained before they can be joined", folder.display(), named(blocks))]
    NotTrained {
        /// The run folder.
        folder: PathBuf,
        /// The blocks.
        blocks: Vec<usize>,
    },
    /// The blocks have no splats.
    #[error("{}: no block has a splat in its cell; the photos show nothing there", .0.display())]
    Empty(PathBuf),
    /// A file has another number of splats than was written.
    #[error("{}: has {found} splats and should have {expected}; plan again with --overwrite", path.display())]
    Splats {
        /// The file.
        path: PathBuf,
        /// Splats in the file.
        found: usize,
        /// Splats that were written.
        expected: usize,
    },
}

impl From<SessionError> for BlockError {
    fn from(error: SessionError) -> Self {
        Self::Session(Box::new(error))
    }
}

/// Most blocks that are named.
const MAX_NAMED_BLOCKS: usize = 8;

fn named(blocks: &[usize]) -> String {
    let first: Vec<String> = blocks.iter().take(MAX_NAMED_BLOCKS).map(usize::to_string).collect();
    match blocks.len() {
        1 => format!("block {} is", first[0]),
        count if count > MAX_NAMED_BLOCKS => {
            format!("blocks {} and {} more are", first.join(", "), count - MAX_NAMED_BLOCKS)
        }
        _ => format!("blocks {} are", first.join(", ")),
    }
}
