//! Smog: soot, sulphates and nitrogen dioxide under an inversion.
//!
//! The particles absorb: a single-scattering albedo of 0.85 to 0.92 dims the airlight, and nitrogen
//! dioxide takes out the blue and some green. A published smog colour is (0.925, 0.906, 0.758),
//! meant as the whole airlight; as a tint of a sky it turns olive or sandy, so the default is
//! nearer to grey. An inversion keeps smog in the lowest few hundred metres.
//!
//! Departure from the paper, whose smog is fog of another colour: absorption, spectrum, height.

use super::air::{air, prelude::*};

air! {
    name: "smog",
    about: "Soot and nitrogen dioxide: brownish, dimmer than the sky",
    mor: 800.0,
    angstrom: 1.0,
    albedo: 0.88,
    tint: ParamValue::Color([0.95, 0.905, 0.82]),
    scale_height: 400.0,
}
