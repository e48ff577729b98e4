//! Maps of the places that surfaces above them shelter from rain and snow.
//!
//! # The map
//! An orthographic grid perpendicular to the fall, over the scene without its sky and its outliers.
//! Each cell holds how far along the fall the first surface stands that stops what falls, as a
//! distance from a plane through the middle of the scene, or infinity where nothing does.
//!
//! A map is made once for a scene and a direction of fall. In a scene with photos it is made from
//! [fused surfaces](crate::fused_surfaces), not from the splats: trained splats look right from the
//! photos alone, fused surfaces are right from above too.
//!
//! A splat projects along the fall to a 2D Gaussian of covariance `C = A S A^T`, with `S` its 3D
//! covariance and `A` the two axes of the grid. A cell sees it through a filter of variance 0.3
//! cell^2, as a pixel does: `C' = C + 0.3 I`, its opacity times `sqrt(|C| / |C'|)`, so that a leaf
//! smaller than a cell covers its own share of it. At a cell's middle, `d` from the splat's,
//!
//! `alpha = opacity sqrt(|C| / |C'|) exp(-d^T C'^-1 d / 2)`, nothing below 1/255,
//!
//! and the splats' `1 - alpha` multiply in order of the depths of their means. The first splat with
//! which the product falls below a half is what stops: thin haze does not, many leaves together do.
//! The distance is that of its own surface in the cell, the mean of its Gaussian along the ray,
//! `t + c^T C'^-1 d` with `c` the covariance of depth and position: a large slanted splat stops
//! where it is.
//!
//! # What is left out
//! Splats of the sky, faint ones, those with a standard deviation above a quarter of the scene, and
//! lone pieces of the map high above all that is around them (`floaters.rs`): those cells look for
//! the next surface below.
//!
//! # Queries
//! A point is sheltered where the surface in its cell is above it by more than a margin, the larger
//! of [`ShelterOptions::margin`] and 1.5 cells. So the ground does not shelter itself, nor do
//! slopes: up to 71 degrees where they are smooth (`tan = 3`, over half a cell), up to 60 where
//! their splats scatter. A wall along the fall shelters what is in its own cell. Outside the grid
//! nothing is known, and all is exposed.

mod cast;
mod floaters;
mod grid;
mod layers;
mod map;
mod merge;
mod occluder;
mod occluders;
mod penumbra;
#[cfg(test)]
mod tests;

pub(crate) use layers::HeightLayers;
pub use map::{FloaterRule, Shelter, ShelterOptions};
pub(crate) use occluders::FloaterMap;
pub use occluders::Occluders;
pub(crate) use penumbra::SUN;
