//! Gaussian splatting scenes on disk and in memory: splats, cameras, metadata and file formats.
//!
//! Reads and writes every common splat format ([`formats`]: PLY, compressed PLY, SPZ, SOG, glTF,
//! .splat, .ksplat), and estimates what splat files do not state ([`survey`]: up, ground, scale,
//! sky). It has no GPU, no threads and no weather.
//!
//! - [`Scene`]: the content of a scene file: splats, metadata and photographed views.
//! - [`Splats`]: the Gaussians, structure of arrays, in their stored (trained) form.
//! - [`Camera`]: pinhole intrinsics and pose, OpenCV axes; [`Camera::look_at`] describes one.
//! - [`Metadata`]: the facts that weather needs: metres per unit, up, ground, light of the sky.
//! - [`survey::Survey`]: the same facts for any scene, estimated where the metadata is silent.
//!
//! The feature `testing` adds synthetic scenes for tests and benches.
//!
//! ```
//! use wm_scene::survey::{FactSource, Survey};
//! use wm_scene::{Camera, Group, Metadata, Scene, Splats, splats::Splat};
//!
//! // A meadow of 100 flat splats, 2 m apart.
//! let mut splats = Splats::with_capacity(100, 0);
//! for index in 0..100u8 {
//!     splats.push(&Splat {
//!         mean: [f32::from(index % 10), f32::from(index / 10), 0.0],
//!         quat: [1.0, 0.0, 0.0, 0.0],
//!         log_scale: [-0.7, -0.7, -5.0],
//!         logit_opacity: 3.0,
//!         rgb: [0.3, 0.5, 0.2],
//!         group: Group::Scene,
//!     });
//! }
//! let scene = Scene { splats, ..Scene::default() }.metres_per_unit(2.0).up([0.0, 0.0, 1.0]);
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("meadow.ply");
//! scene.save(&path)?;
//! assert_eq!(Scene::open(&path)?, scene);
//!
//! let survey = Survey::of(&scene, &Metadata::default());
//! assert_eq!(survey.metres_per_unit.value, 2.0);
//! assert_eq!(survey.metres_per_unit.source, FactSource::File);
//! let camera = Camera::look_at([5.0, -8.0, 2.0], [5.0, 5.0, 0.0]).camera(survey.up.value, 0.2)?;
//! assert!(camera.project([5.0, 5.0, 0.0].into()).is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod camera;
pub mod card;
pub mod formats;
pub mod gps;
mod group;
pub mod health;
pub mod lamps;
pub mod levels;
pub mod metadata;
pub mod morton;
pub mod origin;
pub mod points;
pub mod posts;
pub mod quat;
pub mod reflectance;
mod remark;
mod scene;
pub mod sh;
pub mod similarity;
pub mod splats;
pub mod sun;
pub mod survey;
#[cfg(any(test, feature = "testing"))]
pub mod synthetic;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod values;

pub use camera::{Camera, CameraError, LensModel, LookAt};
pub use gps::Gps;
pub use group::Group;
pub use health::{Health, NonFiniteSplats};
pub use lamps::{Lamp, LitWindow};
pub use metadata::{Metadata, PhotoSun, Rasterization};
pub use points::SparsePoints;
pub use remark::{Remark, Severity};
pub use scene::{Scene, SceneView};
pub use splats::{Splats, SplatsError};
