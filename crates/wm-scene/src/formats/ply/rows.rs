//! The splats that are read, row by row.

use crate::Splats;

/// The rows of a file in arrays.
#[derive(Debug)]
pub(super) struct Rows {
    pub(crate) splats: Splats,
    /// The 3D filter of each splat; empty if the file has none.
    pub(crate) filters: Vec<f32>,
    /// The rounding error of each position in f32, if the file has double precision or text; else
    /// empty.
    pub(crate) residues: Vec<[f32; 3]>,
}
