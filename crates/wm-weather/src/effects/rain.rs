//! Rain: drops as long as their way during the exposure, in their true number.
//!
//! Marshall and Palmer's sizes, terminal speeds after Brandes, Garg and Nayar's photometry: see
//! [`crate::particles`]. Classes (WMO): slight below 2.5 mm/h, moderate to 10, heavy to 50, violent
//! above. Rain is plain in a short exposure and faint in a long one: a 2 mm drop at 1/60 s covers
//! some 1 % of a pixel. Factors of size, opacity and brightness are there for pictures that are to
//! show more than a camera would.

use super::drops::{drops, prelude::*};
use crate::particles::RAIN;

drops! {
    name: "rain",
    about: "Streaks of drops in their true number",
    kind: RAIN,
    /// Water that falls through a level plane. Drizzle 0.5, moderate rain 5, heavy 25, violent 100.
    rate: 10.0, 300.0,
    paper: {
        number: 40_000.0 at 10.0,
        speed: 8.0,
        length: 0.25,
        width: ParamValue::Number(0.004),
        opacity: 0.8,
        t: 0.0, 0.35,
        fog: 0.3,
    },
}
