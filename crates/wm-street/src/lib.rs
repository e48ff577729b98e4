//! The built-in places: scenes that need no download, and photos of them with exact ground truth.
//!
//! A [`Place`] is analytic surfaces with procedural textures and baked light under a sky. There are
//! two: [`Street`], a village street about 150 m long between houses, gardens and trees, and
//! [`Park`], 120 x 120 m of lawns, a hill, a pond, gravel paths and a wood; fields, a church and
//! hills lie beyond both, so that fog has depth to act on. [`SplatSampling`] turns a place into
//! Gaussians; [`Place::photo`] ray-casts pictures of it with exact depth, normals, materials and
//! sky. Units are metres and z is up; the carriageway of the street and the level lawn of the park
//! lie at z = 0. East is x and north is y.
//!
//! A place depends on its seed alone, never on the order of calls or the number of threads.
//!
//! - [`Place`]: the place itself; [`Place::cast`] and [`Place::sky`] give linear radiance along a
//!   ray.
//! - [`SplatSampling`]: its splats, any range of them.
//! - [`Viewpoint`]: a good position to look from; [`Place::dolly`] is a walk.
//! - [`PhotoPixel`]: one pixel of a photo, with its ground truth.
//! - [`dataset`]: photos, cameras and points as a COLMAP data set, exact and in metres, with the
//!   ground truth beside them.
//! - [`capture`]: the same as drones, walkers and cars bring it home: unknown axes and scale, GPS,
//!   blur, movers, weather.
//!
//! ```
//! use wm_street::Street;
//!
//! let street = Street::builtin();
//! let camera = Street::views()[0].camera((300, 200))?;
//! let pixel = street.photo(&camera, 150, 190, 1);
//! assert!(pixel.depth > 1.0 && !pixel.is_sky);
//! let splats = street.sampling(0.5).splats_in(0..1000);
//! assert!(splats.len() <= 1000);
//! # Ok::<(), wm_scene::CameraError>(())
//! ```

mod air;
mod build;
mod bvh;
pub mod capture;
pub mod dataset;
mod gaussian;
mod ground;
mod hash;
mod light;
mod light_map;
mod paint;
mod park;
mod photo;
mod place;
mod sampling;
mod shape;
mod sky;
mod street;
mod texture;
mod tone;
mod views;

pub use light::LitHit;
pub use paint::{Label, Material};
pub use park::Park;
pub use photo::PhotoPixel;
pub use place::{Place, SurfaceHit};
pub use sampling::SplatSampling;
pub use sky::Lighting;
pub use street::Street;
pub use tone::{display_of, exposed};
pub use views::Viewpoint;

#[cfg(test)]
mod tests;
