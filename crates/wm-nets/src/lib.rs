//! Neural networks, a file each, with weights that the user gives or has fetched: none are in the program.
//!
//! - [`clip`]: what a picture shows, as an embedding.
//! - [`depth_anything`]: how near what a photo shows is.
//! - [`lpips`]: how alike two pictures look to people.
//! - [`weights`]: files of weights, safetensors and PyTorch's; with the feature `fetch` also from the network.

pub mod clip;
pub mod depth_anything;
pub mod lpips;
mod ops;
mod pillow;
#[cfg(test)]
mod testing;
mod transformer;
pub mod weights;

pub use clip::Clip;
pub use depth_anything::DepthAnything;
pub use lpips::Lpips;
pub use weights::WeightsError;
