//! Facts about a place that a bare splat file does not state: up, ground, scale, the light of the
//! air, its middle and size, and which splats are the sky.
//!
//! For each value the best source wins: given by hand, the scene's own metadata, the photographed
//! views, an estimate from the splats, and last an assumption. The source is kept with the value.
//! All estimates come from a fixed sample of the splats, so they are the same every time.
//!
//! Facts belong to the scene and are stored with it. No weather guesses them from a frame, so a pan
//! changes no colour. Scale is measured or unknown: it comes from the user, from GPS, or from the
//! ground under the level cameras of a person (`wm_capture::ground`); else one unit counts as
//! one metre, with one warning.

mod airlight;
mod align;
mod facts;
mod ground;
pub mod habits;
mod middle;
mod near_ground;
mod own_sky;
mod plan;
mod report;
mod sample;
mod sky;
pub(crate) mod sourced;
mod sun;
mod sunny_side;
#[cfg(test)]
mod tests;
mod up;

pub use airlight::{CapturedSky, SkyPatch, airlight_of_sky, limited_airlight};
pub use align::{
    AlignError, Aligned, Alignment, GivenGround, GivenScale, ScaleError, UpSide, align, known_distance,
};
pub use facts::Survey;
pub use near_ground::NearGround;
pub use own_sky::{OwnSky, SkyChange};
pub use sky::{SkyRegion, label_sky};
pub use sourced::{Confidence, FactSource, Sourced};
pub use sun::{SunFault, SurveyedSun};
pub use sunny_side::SunnySide;
pub use up::{UpEstimate, UpScore};
