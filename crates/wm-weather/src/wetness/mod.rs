//! Wet ground and walls: how much water is where, and how it looks.
//!
//! # How much water is where
//! Rain fills pores, then the texture of surfaces, then it runs off ([`mod@column`]), into the
//! depressions of the ground that fill and run over ([`basins`]). What dries is taken from films
//! first and from puddles last ([`drying`]). Each surface gets the share of the rain that reaches
//! it: by what stands above it in the slanted direction of the rain ([`crate::shelter`]), by its
//! slope, and on walls by the wind ([`surfaces`]). The state at an instant is a sum of steps until
//! then ([`timeline`]), and depends on nothing else. Snow that melts ([`crate::cover::snowpack`])
//! is water in the same steps: where a share of the rain falls the same share of the snow does.
//!
//! Columns of ground for sixteen shares of the rain pass all steps, and a splat looks up its own
//! share between them. The rain has one direction for all times, that of the heaviest rain in the
//! wind of the start, so that no dry edge jumps.
//!
//! # How it looks
//! The light of each splat is multiplied by a factor per channel ([`optics`]): in the slot of the
//! light, so that both compose. The rain that wets a splat is found once per direction of the rain;
//! a frame looks up two numbers per splat. Steep surfaces mirror the sky's light too
//! ([`SkySheen`]): as a part of the same factor, since what depends on the direction is gone from a
//! wet splat, so that its light is known.
//!
//! The attribute [`Fade`](wm_render::hooks::Attribute::Fade) takes away what the dry surface
//! mirrored of another sky.
//!
//! [`WaterState`] is the same water as a grid, to be drawn as a surface. Depths are interpolated
//! between nodes, so that puddles end in curves within cells, and water fades where the capture
//! ends.

pub(crate) mod basins;
pub(crate) mod column;
pub(crate) mod drying;
mod eaves;
mod gains;
mod gather;
mod ground_map;
pub mod optics;
mod plane_fit;
mod relief;
mod request;
mod run_off;
mod sheen;
pub(crate) mod state;
pub(crate) mod surfaces;
pub(crate) mod timeline;

pub(crate) use column::Drainage;
pub(crate) use eaves::Eave;
pub use gains::WetGains;
pub(crate) use ground_map::GroundMap;
pub(crate) use relief::{between_corners, lower_share, relief, smooth_noise};
pub(crate) use request::driving_rain;
pub use request::{SlantedRain, WetRequest};
pub use run_off::RunOff;
pub(crate) use sheen::SkySheen;
pub use state::{Catchments, WaterState, WetState};
pub use surfaces::{WetShares, WetSurfaces};
