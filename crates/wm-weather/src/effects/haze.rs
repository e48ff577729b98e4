//! Haze: dry particles below 1 um, in ranges above 1 km.
//!
//! Particles of about the size of a wavelength scatter short waves more: extinction goes with the
//! wavelength to the power of -1.3 (Angstrom), 0.874 / 1 / 1.244 for 610 / 550 / 465 nm. So
//! distance turns dark things bluish and bright things warm. Haze fills the lower atmosphere,
//! thinning over about a kilometre: the zenith stays clearer than the horizon.
//!
//! Source: A. Angstrom, 1929; WMO No. 8, chapter 9. Departure from the paper, whose haze is fog of
//! another colour: extinction by wavelength and by height.

use super::air::{air, prelude::*};

air! {
    name: "haze",
    about: "Fine dry particles: bluish, visibility above 1 km",
    mor: 2000.0,
    angstrom: 1.3,
    albedo: 1.0,
    tint: ParamValue::Auto,
    scale_height: 1000.0,
}
