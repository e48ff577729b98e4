//! Scenes on disk and in memory: splats, cameras, metadata, file formats and captures.
//!
//! The plain types of the corridor start here. Nothing in this crate knows a GPU, a thread pool or
//! the weather; every other crate stands on it.
//!
//! - [`Splats`]: the Gaussians, structure of arrays, in their stored (trained) form.
//! - [`Camera`]: pinhole intrinsics and pose, OpenCV axes.
//! - [`Metadata`]: what weather must know of a scene: metres per unit, up, ground, sky.
//! - [`Scene`]: the three together, read and written by [`formats`].
//! - [`SceneView`]: a photographed view, of a scene or a [`capture`].
//! - [`npy`]: arrays of numbers on disk.
//! - [`survey::Survey`]: what the splats and views say of the place where the metadata does not.

pub mod camera;
pub mod capture;
pub mod card;
pub mod color;
pub mod error;
pub mod files;
pub mod formats;
pub mod group;
pub mod health;
pub mod jacobi;
pub mod metadata;
pub mod morton;
mod nearest;
pub mod npy;
pub mod quat;
pub mod random;
pub mod scene;
pub mod sh;
pub mod similarity;
mod source;
pub mod splats;
pub mod survey;
#[cfg(any(test, feature = "testing"))]
pub mod synthetic;
#[cfg(any(test, feature = "testing"))]
pub mod testing;

pub use camera::{Camera, CameraError};
pub use error::{FormatError, Location, Problem};
pub use group::Group;
pub use health::Health;
pub use metadata::{Metadata, Rasterization};
pub use nearest::nearest;
pub use scene::{Scene, SceneView};
pub use splats::{Splats, SplatsError};
