//! Fog: water droplets of 5 to 20 um that reduce visibility to less than 1 km.
//!
//! Droplets that large scatter all of visible light alike and absorb almost none of it, so fog is
//! grey and as bright as the sky that feeds it. Classes by meteorological optical range (WMO): fog
//! below 1000 m, thick below 200 m, dense below 50 m; mist from 1 to 5 km. Radiation fog thins over
//! 10 to 50 m of height, advection fog over 100 to 300 m; the default is the same at all heights,
//! which is the paper's fog.
//!
//! Source: WMO No. 8, chapter 9; the paper's `eq:fog style` and `eq:style_intensity`. Departures
//! from the paper: see [`crate::optics`]; its own form is fidelity `paper`.

use super::air::{air, prelude::*};

air! {
    name: "fog",
    about: "Water droplets: grey, visibility below 1 km",
    mor: 200.0,
    angstrom: 0.0,
    albedo: 1.0,
    tint: ParamValue::Auto,
    scale_height: f64::INFINITY,
}
