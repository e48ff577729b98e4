//! A wet glass before the camera: drops that land, refract, run and dry; dirt; and light that
//! scatters.
//!
//! Nothing is simulated from frame to frame. Landings are Poisson events of hashed cells of the
//! glass and of slots of a clock that counts drops ([`GlassRain`]); [`drops::drops`] finds those
//! that are on the glass at an instant, in a bounded window of the past. Drops as large as
//! [`Glass::runs_from`] run down a hashed path, wipe what is on it and leave small ones behind.
//!
//! A drop is a cap of water on the outer side. It bends the view by Snell's law and so shows a wide
//! picture upside down, from a small render of its own ([`wide_camera`], [`WideView`]); rims that
//! reflect the light back inside are dark. [`LensEffect`] draws drops into a layer as coarse as the
//! aperture blurs the glass, blurs it by the disc of the aperture, and lays it over the picture in
//! linear light.
//!
//! The glass is the last picture pass. The wide picture has 256x256 px, is taken from the same eye,
//! and shows fewer splats than the scene has.

mod drops;
mod effect;
mod flux;
mod geometry;
mod layer;
mod veil;
mod wide;

#[cfg(test)]
mod tests;

pub use effect::LensEffect;
pub(crate) use flux::{GlassRain, Rainfall};
pub(crate) use geometry::GlassView;
pub use wide::wide_camera;
use wm_scene::Camera;

/// The glass before the camera at an instant.
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

/// Most drops on the glass before a camera.
const MOST_DROPS: f64 = 3e7;

impl Glass {
    /// Checks that a camera has no more than `MOST_DROPS` drops before it.
    ///
    /// # Errors
    /// One line with their number and what helps.
    pub fn check(&self, camera: &Camera) -> Result<(), String> {
        let Some([low, high]) = self.part_with_drops(camera) else { return Ok(()) };
        let count = (high[0] - low[0]) * (high[1] - low[1]) * drops::looked_for(self);
        if count <= MOST_DROPS {
            return Ok(());
        }
        Err(format!(
            "lens: {count:.1e} drops on the glass before this camera, more than {MOST_DROPS:e}: set larger drops (lens.size), \
             a nearer glass (lens.distance) or a narrower view"
        ))
    }

    /// The part of the glass where drops are large enough to be seen: its least and greatest
    /// corner, m from the point on the view's axis. `None` if there is no such part.
    fn part_with_drops(&self, camera: &Camera) -> Option<[[f64; 2]; 2]> {
        if self.rain.is_dry(self.time) {
            return None;
        }
        let least = layer::MIN_RADIUS_PX * layer::LayerScale::before(self, camera).pixels as f64;
        let [low, high] = GlassView::new(self, camera).part_with(self.rain.widest(), least, camera)?.bounds;
        Some([low.map(|v| v - self.aperture), high.map(|v| v + self.aperture)])
    }

    /// Returns true if it changes no picture.
    pub(crate) fn is_clear(&self) -> bool {
        self.veil <= 0.0 && self.dirt <= 0.0 && self.rain.is_dry(self.time)
    }
}
