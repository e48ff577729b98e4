//! Shared by every crate of the workspace: errors of files in one line, files that are whole or not
//! there, random numbers by (seed, index), colours, arrays for NumPy, and small linear algebra.
//!
//! - [`FormatError`]: path, place, problem and remedy of a file, in one line.
//! - [`files`]: reading with limits, writing beside the final name and then renaming.
//! - [`random`]: numbers that are pure functions of a seed and an index.
//! - [`color`]: sRGB and linear light. [`npy`]: arrays for NumPy.
//! - [`statistics`]: the median and other quantiles. [`linear`], [`jacobi`]: eigenvectors.
//! - [`kd_tree`]: nearest neighbours.

pub mod calendar;
pub mod color;
pub mod error;
pub mod file_index;
pub mod files;
pub mod jacobi;
pub mod kd_tree;
pub mod linear;
mod nearest;
pub mod npy;
pub mod random;
pub mod source;
pub mod statistics;

pub use error::{FormatError, Location, Problem};
pub use nearest::nearest;
