//! The error of all back ends.

use crate::stages::intersect::MAX_SPLATS;
use thiserror::Error;
use wm_scene::{CameraError, SplatsError};

/// Why a render failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The camera cannot be rendered with.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The splats do not fit each other.
    #[error(transparent)]
    Splats(#[from] SplatsError),
    /// A splat holds a number that cannot be rendered.
    #[error("splat {index} holds {value}, which is no finite number: repair the scene first")]
    NotFinite {
        /// The index of the splat.
        index: usize,
        /// The name of the field.
        value: &'static str,
    },
    /// More splats than indices.
    #[error("{0} splats are too many for one set: the most is {max}", max = MAX_SPLATS)]
    TooMany(usize),
    /// The set was never loaded or is unloaded.
    #[error("splat set {0} is not loaded")]
    UnknownSet(usize),
    /// The processor lacks the SIMD path.
    #[error("this processor has no {0}: use --simd auto")]
    NoSimd(&'static str),
    /// The lists of a frame would take too much memory.
    #[error("a picture's lists would take more than {mebibytes} MiB: {}", listed.advice())]
    TooMuch {
        /// The things that are listed.
        listed: Listed,
        /// The most that the lists of such a picture may take, MiB.
        mebibytes: u64,
    },
    /// Too many cells of space would be searched for rain, snow or hail.
    #[error("{cells:.0} cells of space would have to be searched: {}", Listed::Falling.advice())]
    TooManyCells {
        /// Their number.
        cells: f64,
    },
    /// Memory for the picture could not be had.
    #[error("no memory for a picture of {width}x{height} px")]
    Memory {
        /// Picture width, px.
        width: u32,
        /// Picture height, px.
        height: u32,
    },
    /// The thread pool could not be started.
    #[error("cannot start {threads} threads: {reason}")]
    Threads {
        /// The number of threads.
        threads: usize,
        /// The system's words.
        reason: String,
    },
    /// A GPU was asked for, and the program has no GPU back end.
    #[cfg(not(feature = "gpu"))]
    #[error("this program was built without the feature `gpu`: use --device cpu")]
    NoGpu,
    /// The GPU cannot be used, or failed.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] crate::gpu::error::GpuError),
}

impl RenderError {
    /// Returns true if the GPU failed: another device may succeed.
    #[must_use]
    pub fn is_of_gpu(&self) -> bool {
        #[cfg(feature = "gpu")]
        return matches!(self, Self::Gpu(_));
        #[cfg(not(feature = "gpu"))]
        return false;
    }
}

/// The kinds of lists of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listed {
    /// Splats, for each tile that they cover.
    Splats,
    /// Drops, flakes and stones, for each patch that they cover.
    Falling,
}

impl Listed {
    /// Returns the cause and the remedy, for error messages.
    pub(crate) fn advice(self) -> &'static str {
        match self {
            Self::Splats => {
                "splats cover the picture too many times over; `inspect` finds splats that are too large"
            }
            Self::Falling => {
                "too much falls before this camera: lower the rate, the exposure or the camera's speed, or take a wider view"
            }
        }
    }
}
