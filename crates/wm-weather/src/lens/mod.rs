//! A wet glass in front of the camera: drops that land, refract, run and dry; dirt; and light that
//! scatters.
//!
//! Nothing is simulated from frame to frame. Landings are Poisson events of hashed cells of the
//! glass and of slots of a clock that counts drops ([`GlassRain`]); [`drops::drops`] finds those
//! that are on the glass at an instant, in a bounded window of the past. Drops as large as
//! [`Glass::runs_from`] run down a hashed path, wipe what is on it and leave small ones behind.
//!
//! A drop is a cap of water on the outer side. It bends the view by Snell's law and so shows a wide
//! picture upside down, from a small render of its own ([`wide_camera`], [`wide::WideView`]); rims
//! that reflect the light back inside are dark. [`LensEffect`] draws drops into a layer as coarse
//! as the aperture blurs the glass, blurs it by the disc of the aperture, and lays it over the
//! picture in linear light.
//!
//! The glass is the last picture pass. The wide picture has 256x256 px, is taken from the same eye,
//! and shows fewer splats than the scene has.

mod drops;
mod effect;
mod flux;
mod geometry;
mod glass;
mod layer;
mod veil;
mod wide;

#[cfg(test)]
mod tests;

pub use effect::LensEffect;
pub(crate) use flux::{GlassRain, Rainfall};
pub use glass::Glass;
pub use wide::wide_camera;
