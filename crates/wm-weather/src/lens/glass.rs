//! The glass in front of a camera.

use super::flux::GlassRain;

/// The glass in front of the camera at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Glass {
    /// Distance along the view, m.
    pub(crate) distance: f64,
    /// Diameter of the aperture, m.
    pub(crate) aperture: f64,
    /// Angle by which its top leans towards the camera, radians.
    pub(crate) tilt: f64,
    /// Contact angle of its drops, radians.
    pub(crate) contact: f64,
    /// Radius from which drops run, m.
    pub(crate) runs_from: f64,
    /// Time in which a drop of 1 mm radius dries, s.
    pub(crate) drying: f64,
    /// Share that dirt covers, 0-1.
    pub(crate) dirt: f64,
    /// Share of light that dirt lets through, 0-1.
    pub(crate) dirt_transmittance: f64,
    /// Share of light that dirt scatters into the view, 0-1.
    pub(crate) dirt_scatter: f64,
    /// Factor on the veil of bright sources.
    pub(crate) veil: f64,
    /// Seed of its drops.
    pub(crate) seed: u64,
    /// The instant, s.
    pub(crate) time: f64,
    /// The rain that has landed on it.
    pub(crate) rain: GlassRain,
}

impl Glass {
    /// Returns true if it changes no picture.
    pub(crate) fn is_clear(&self) -> bool {
        self.veil <= 0.0 && self.dirt <= 0.0 && self.rain.is_dry(self.time)
    }
}
