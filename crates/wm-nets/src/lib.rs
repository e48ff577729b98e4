//! Neural networks, a file each, with weights that the user gives: none are in the program.
//!
//! - [`lpips`]: how alike two pictures look to people.
//! - [`weights`]: files of weights, safetensors and PyTorch's.

pub mod lpips;
#[cfg(test)]
mod testing;
pub mod weights;

pub use lpips::Lpips;
pub use weights::WeightsError;
