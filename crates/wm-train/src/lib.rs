//! From photos to splats.
//!
//! - [`photos`]: the photos of a capture, decoded, resized and undistorted when they are needed.
//! - [`colmap`]: a capture from a plain folder of photos, by the COLMAP that is installed.
//! - [`builtin`]: made-up captures of the built-in place, with exact depth, normals and sky.
//! - [`npy`]: arrays on disk.

pub mod builtin;
pub mod colmap;
pub mod npy;
pub mod photos;
#[cfg(test)]
mod testing;
