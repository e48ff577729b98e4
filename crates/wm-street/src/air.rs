//! Haze between a camera and what it sees: Beer and Lambert's law along each ray.

use glam::DVec3;

/// Optical depth of the MOR: -ln of 5 % of contrast, as meteorology defines it.
const MOR_OPTICAL_DEPTH: f64 = 2.995_732_273_553_991;

/// Even haze from the ground to [`Air::HAZE_TOP_M`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Air {
    /// Meteorological optical range, m.
    pub(crate) mor: f64,
    /// Linear radiance that endless haze has.
    pub(crate) airlight: DVec3,
}

impl Air {
    /// Height at which the haze ends: the air above is clear, so the zenith stays visible.
    pub(crate) const HAZE_TOP_M: f64 = 300.0;

    /// The share of light that is left after `distance`, m.
    pub(crate) fn transmittance(&self, distance: f64) -> f64 {
        (-MOR_OPTICAL_DEPTH * distance / self.mor).exp()
    }

    /// Radiance of a surface at `distance`, m, or of the sky, as it arrives at `eye` along
    /// `direction`.
    pub(crate) fn seen(&self, radiance: DVec3, eye: DVec3, direction: DVec3, distance: Option<f64>) -> DVec3 {
        let rise = if direction.z > 1e-6 {
            ((Self::HAZE_TOP_M - eye.z) / direction.z).max(0.0)
        } else {
            f64::INFINITY
        };
        let left = self.transmittance(distance.map_or(rise, |distance| distance.min(rise)));
        radiance * left + self.airlight * (1.0 - left)
    }
}
