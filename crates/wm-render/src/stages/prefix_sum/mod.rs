//! Prefix sums, for the GPU alone: the place at which each block of splats writes its results.
//!
//! Contract: of counts `c_0, c_1, ...` it makes their exclusive prefix sums in place, and the
//! total. Exact, in u32. Reduce, then scan: the stages before sum up each block of 256 in one
//! workgroup; here one workgroup makes the prefix sums of those; the stages after add their own
//! place in the block. No workgroup waits for another, so nothing is asked of the order in which a
//! GPU runs them.
//!
//! Items beyond the room of the buffers are cut off here: `visible` and `entries` are at most the
//! capacities, `..._needed` are the full numbers.

pub(crate) mod gpu;
#[cfg(test)]
mod tests;
