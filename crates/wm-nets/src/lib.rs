//! Neural networks on the CPU: depth from one photo, perceptual distance, image embeddings.
//!
//! Every network is one file; weights are never part of the program. The user gives files, or
//! downloads them with the feature `fetch`. Files are read with limits on what their headers may
//! claim, and a wrong file is named with advice.
//!
//! This is a crate and a feature of the program (`nets`) of its own, since it takes as long to
//! build as everything else.
//!
//! The types to know:
//! - [`DepthAnything`]: relative depth of a photo.
//! - [`Lpips`]: the distance of two images as people see it.
//! - [`Clip`]: the embedding of an image.
//! - [`WeightsError`]: a file of weights that cannot be used, and why.
//! - [`weights::Licence`]: what the licence of published weights allows.
//!
//! ```
//! use wm_nets::Lpips;
//!
//! // The tensors that a file of weights must hold.
//! let (name, shape) = &wm_nets::lpips::tensors()[0];
//! assert_eq!((name.as_str(), &shape[..]), ("features.0.weight", &[64, 3, 11, 11][..]));
//!
//! let error = Lpips::read(&["missing.safetensors".into()]).unwrap_err();
//! assert!(error.to_string().starts_with("missing.safetensors: cannot be read"));
//! ```
//!
//! ```no_run
//! use wm_nets::Lpips;
//!
//! let network = Lpips::read(&["alexnet.pth".into(), "alex.pth".into()])?;
//! let (width, black, grey) = (64, vec![0.0; 64 * 64 * 3], vec![0.5; 64 * 64 * 3]);
//! println!("{:.3}", network.distance(&black, &grey, None, width));
//! # Ok::<(), wm_nets::WeightsError>(())
//! ```

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
