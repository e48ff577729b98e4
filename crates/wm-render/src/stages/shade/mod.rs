//! Colours of the splats in view: spherical harmonics, then the air.
//!
//! Contract: `rgb = max(0, 0.5 + sum_k basis_k(d) sh_k)` with `d` the unit direction from the
//! camera centre to the mean in world axes (see [`wm_scene::sh`]), display-referred.
//!
//! A fade `f` takes away the part of the colour that depends on the direction: `rgb` becomes
//! `rgb + f (max(0, 0.5 + basis_0 sh_0) - rgb)`.
//!
//! Splats with gains are relit: of the colour in linear light, `c`, comes `c' = c g` by channel.
//! Where the largest channel of `c'` is above `limit = max(1, c)`, all are scaled to bring it
//! there, so that what is too bright keeps its hue.
//!
//! Then the weather's [`Medium`](crate::hooks::Medium) changes it, at the splat's own ray length;
//! splats of the sky are infinitely far for it.
//!
//! The air acts here and not on pixels because a pixel at a silhouette holds two distances: its
//! mean depth is neither, and fog from it draws a bright rim.
//!
//! In training the air is that of the photos, [`EvenAir`](crate::EvenAir): colours become
//! `rgb k + m` with numbers by the distance.
//!
//! Tolerance: up to 16 products of like magnitude, relative 2e-6 of the largest.

pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;
