//! Snowfall: flakes of three arms that sway and tumble, in their true number.
//!
//! Sekhon and Srivastava's sizes, as water: a flake of 2 mm of water is some 6 mm wide and falls at
//! 1 m/s, see [`crate::particles`]. Light snow is below 1 mm/h of water, heavy above 2.5: one sees
//! some 300 m then.

use super::drops::{drops, prelude::*};
use crate::particles::SNOW;

drops! {
    name: "snowfall",
    about: "Flakes that sway and tumble, in their true number",
    kind: SNOW,
    /// Water that falls through a level plane, melted; ten times as much in depth of fresh snow.
    /// Light snow 0.5, moderate 1.5, heavy 4.
    rate: 1.0, 50.0,
    paper: {
        number: 40_000.0 at 1.0,
        speed: 1.2,
        length: 0.05,
        width: ParamValue::Auto,
        opacity: 0.8,
        t: -0.1, 0.6,
        fog: 0.5,
    },
}
