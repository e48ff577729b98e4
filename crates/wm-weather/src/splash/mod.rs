//! Splashes of rain on wet ground and on water.
//!
//! # Which drops splash
//! Drops of the rain's own sizes hit open ground and water where nothing shelters them. A drop
//! throws a crown if `We Oh^-0.4 > 2100 + 5880 (film / D)^1.44` (Cossali and others 1997), so only
//! drops above some 1 mm do, and on deep water only the largest ([`impact`]). Those above 2 mm are
//! the very drops that make the rings of [`crate::water::ripples`]: a ring and its splash have one
//! centre and one time ([`fallen`]).
//!
//! # What a splash is
//! A crown of a few millimetres that lives some 5 to 15 ms, droplets of 0.1 to 0.5 mm that fly with
//! the drag of the air ([`flight`]), and on water deeper than the drop a thin jet. They are
//! particles as the rain itself is: as long as their way in the exposure, lit by sky and lamps,
//! seen through the air, hidden by what stands before them.
//!
//! # Spray
//! Beyond some metres crowns and droplets are smaller than a pixel. Then fewer are drawn, each for
//! several and as wide as these together, so that they keep cover and motion on average, as far as
//! the ground is known. So spray is the same drops from near to far, follows the ground and stays
//! away from under roofs, which a layer of the air could not.
//!
//! # Eaves
//! A share of the water that runs off of roofs can fall from their eaves (`eaves.rs` of
//! [`crate::wetness`]) in drops of numbered slots of time (`drips.rs`), which splash as the others
//! do.
//!
//! All of it is a function of time and place: any frame can be had alone.

mod drips;
pub(crate) mod fallen;
pub(crate) mod flight;
pub(crate) mod ground;
pub(crate) mod impact;
pub(crate) mod particles;
#[cfg(test)]
mod tests;

pub use ground::{SplashGround, SplashTiles};
pub(crate) use particles::SplashParticles;
