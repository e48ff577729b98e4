//! Haze in which photos were taken: measured before the training, and taken out of the scene.
//!
//! Photos taken in haze show `I = J t + A (1 - t)` in linear light, `t = exp(-beta d)`, with the
//! clear colour J of a surface at the distance d along the ray and the light A of endless haze
//! (Koschmieder's law). A training on them that knows nothing of it learns I, from which no clear
//! day can be made. But points of the reconstruction are seen from several distances, and how their
//! colours change with these tells `beta` and A ([`PhotoHaze::measured`]). Splats are then drawn
//! through such air while they learn ([`wm_render::EvenAir`]), so that they learn J.
//!
//! Each splat is seen through the air at its own distance, so silhouettes have no halos, as they
//! have in photos that are cleared pixel by pixel.
//!
//! Cameras compress bright light, so no single extinction suits near and far. Renders use that of
//! far sightings, since an error of 5 % costs what is far 1 to 2 dB (`PhotoHaze::shown`); the MOR
//! is that of all sightings.
//!
//! Surfaces that the haze hides are made at the end of a training and not learnt (`far_ground.rs`,
//! `settle.rs`).

mod far_ground;
mod fit;
mod photo_haze;
mod settle;
mod sightings;

pub(crate) use far_ground::{FarGround, without_hidden};
pub(crate) use photo_haze::PhotoHaze;
pub(crate) use settle::settle;
