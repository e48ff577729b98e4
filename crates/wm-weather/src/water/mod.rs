//! Water as a surface that reflects: where it stands, how it moves, and what is seen in it and
//! through it.
//!
//! [`WaterMap`] says where water stands. A camera meets it in a [`WaterSurface`]: one distance a
//! pixel, at which the renderer splits its blend ([`wm_render::DrawPass::surface`]). The scene is
//! drawn once more from the eye that the plane of the water mirrors ([`MirrorView`]), and
//! [`WaterEffect`] lays both together: `pixel = front + T_front [(1 - F) behind + F mirrored]`. The
//! front stays in the encoding that splats are blended in, so that silhouettes keep their edges;
//! the rest is computed in linear light.
//!
//! The mirrored picture is a draw pass of half the size, or a quarter where only films mirror,
//! without what lies below the water ([`wm_render::DrawPass::cut`]). [`WaterEffect`] runs on the
//! CPU for both back ends, as pixel effects do; particles are laid over the water from a picture of
//! their own.
//!
//! Waves of the wind and of drops are slopes on tiles that are fixed to the world ([`waves`],
//! [`ripples`]), a pure function of time. What a pixel is too wide to show of them counts as
//! roughness.
//!
//! Foam (`foam.rs`) lies where the slopes are steepest. On slopes of the ground, water that runs
//! off comes together (`run_off.rs` of [`crate::wetness`]) in streams (`rills.rs`).

mod body;
mod effect;
mod fft;
mod flood;
mod foam;
mod fresnel;
mod map;
mod mirror;
mod motion;
mod puddles;
mod rills;
pub(crate) mod ripples;
mod surface;
mod tile;
pub(crate) mod waves;

#[cfg(test)]
mod tests;

pub use body::WaterBody;
pub use effect::WaterEffect;
pub use flood::Flood;
pub use fresnel::{WATER_INDEX, fresnel};
pub use map::{WaterGrid, WaterMap};
pub use mirror::MirrorView;
pub(crate) use motion::WaterForces;
pub use motion::WaterMotion;
pub use puddles::puddles;
pub use surface::WaterSurface;
