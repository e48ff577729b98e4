//! The errors of the GPU back end.

use thiserror::Error;

/// Why a GPU cannot be used, or failed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no GPU, or none of that name.
    #[error("no GPU {wanted}: there is {found}")]
    NoAdapter {
        /// The name that was asked for.
        wanted: String,
        /// The adapters of this machine.
        found: String,
    },
    /// The driver refused to start the GPU.
    #[error("{adapter} cannot be started: {reason}")]
    Start {
        /// Name of the adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The GPU lacks something that the renderer needs.
    #[error("{adapter} has too little for this renderer: {limit} is {has}, and {needs} is needed")]
    Limit {
        /// Name of the adapter.
        adapter: String,
        /// The limit, by wgpu's name.
        limit: &'static str,
        /// Value of the limit.
        has: u64,
        /// The least that will do.
        needs: u64,
    },
    /// One array is larger than the adapter allows.
    #[error("no room on the GPU for {what}: {} in one piece, and its most is {}", size(*bytes), size(*most))]
    TooLarge {
        /// The content of the array.
        what: &'static str,
        /// Size of the array, bytes.
        bytes: u64,
        /// The adapter's limit.
        most: u64,
    },
    /// The memory of the GPU is full.
    #[error("no room on the GPU for {what}, {}", size(*bytes))]
    Memory {
        /// The content of the array.
        what: &'static str,
        /// Size of the array, bytes.
        bytes: u64,
    },
    /// The GPU was lost: driver reset, unplugged, or taken away.
    #[error("the GPU was lost: {0}")]
    Lost(String),
    /// An effect has no form for the GPU.
    #[error("{0} has no form for the GPU yet: render with the CPU")]
    Effect(&'static str),
    /// The driver refused a command; a bug of the program.
    #[error("the GPU refused its work: {0}")]
    Refused(String),
}

/// In words.
fn size(bytes: u64) -> String {
    if bytes < 10_000_000 { format!("{} kB", bytes / 1000) } else { format!("{} MB", bytes / 1_000_000) }
}
