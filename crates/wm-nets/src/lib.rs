//! Neural networks, a file each, with weights that the user gives or has fetched: none are in the program.
//!
//! - [`depth_anything`]: how near what a photo shows is.
//! - [`lpips`]: how alike two pictures look to people.
//! - [`weights`]: files of weights, safetensors and PyTorch's; with the feature `fetch` also from the network.

pub mod depth_anything;
pub mod lpips;
#[cfg(test)]
mod testing;
pub mod weights;

pub use depth_anything::DepthAnything;
pub use lpips::Lpips;
pub use weights::WeightsError;
