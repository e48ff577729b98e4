//! Rain and snowfall as things in the world: each drop is where it is, whoever looks.
//!
//! # Where they are
//! Drops are sorted into classes of diameter ([`spectrum`]), and all of one class fall at one speed
//! and drift with one wind. So a class is a picture that does not change, only moves: a Poisson
//! process in the whole of space, seen at `x - d(t)` with `d(t) = drift(t) - speed t up`. Space is
//! cut in cells, and what a cell holds is a pure function of (seed, class, cell): nothing repeats,
//! nothing wraps, no state is kept, any instant can be asked for alone, and two cameras see the
//! same drops.
//!
//! # How many
//! Each drop has a threshold, and a cell's come in its order: a second Poisson process. Those below
//! `density now / density of reference` are there, so a rate that changes adds drops or takes some
//! away, fades the few near the threshold, and moves none. Diameter and class are a drop's own for
//! all time.
//!
//! # Which are drawn
//! Rain: up to the distance at which a drop is 0.3 px wide. Snow: the same, but from where flakes
//! are smaller than 1.25 px, fewer are drawn, each for several: `(size / 1.25 px)^2` of them, each
//! that wide, so that they keep cover and motion. Both end over a zone and not at once. What is not
//! drawn is the air's ([`residual`]): together they follow one law at every distance.
//!
//! A frame evaluates the cells in view, sixteen drops at a time. Coverage is added in whole
//! numbers, so that the order of drops does not count.
//!
//! # Departures from the paper
//! There, drops are bound to random places of the scene, moved by hand from frame to frame, and
//! rendered as splats over splats in k layers. Here they are in physical units and tested against
//! depth one by one ([`wm_render::stages::particles`]).

pub(crate) mod fall;
pub(crate) mod field;
pub(crate) mod near;
pub(crate) mod precipitation;
pub(crate) mod random;
pub(crate) mod residual;
pub(crate) mod spectrum;
pub(crate) mod sway;

pub(crate) use fall::FallingParticles;
pub use near::NearParticle;
pub(crate) use precipitation::{ParticleAppearance, Precipitation};
pub(crate) use residual::Residual;
pub(crate) use spectrum::{ClassSpacing, LEAST_RATE};
pub use spectrum::{ParticleShape, PrecipitationKind, RAIN, SNOW};
