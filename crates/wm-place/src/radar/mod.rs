//! Radar sweeps of places in rain, and pictures of them: plausible, not validated.
//!
//! ```
//! use wm_place::radar::{RadarModel, RadarScanOptions};
//! use wm_place::{Camera, CameraMotion, FrameCamera, Renderer, Weather};
//!
//! # let scene = wm_street::Street::builtin().sampling(0.1).scene(&|_| true).unwrap();
//! let mut renderer = Renderer::cpu()?;
//! let mut place = renderer.load(scene)?;
//! let look = Camera::look_at([4.0, -20.0, 0.6], [4.0, -10.0, 0.6]);
//! let view = FrameCamera::from(look).at(0.0, &place)?;
//! let weather = Weather::preset("heavy-rain")?;
//! let radar = RadarModel::find("long-range-77")?;
//! let motion = CameraMotion::from(view.camera);
//! let sweep = renderer.scan_radar_once(&mut place, &weather, &radar, &motion, &RadarScanOptions::default())?;
//! assert!(!sweep.detections.is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod picture;

pub use picture::RadarView;
pub use wm_sensors::radar::{
    RADAR_PRESETS, RadarClass, RadarDetection, RadarModel, RadarScanOptions, RadarSweep,
};
pub use wm_sensors::{PointFrame, SensorError, about};

use crate::error::check_physical;
use crate::lidar::UprightMotion;
use crate::motion::CameraMotion;
use crate::place::{PreparedPlace, check_owner};
use crate::{Error, Progress, Renderer, Result};
use std::sync::Arc;
use wm_scene::Group;
use wm_sensors::radar::{RadarScene, radar_sweep};
use wm_weather::Weather;

impl Renderer {
    /// Makes one sweep of a radar that is where the camera of `motion` is: upright, and ahead as
    /// the camera looks, or as it is mounted on a rig. The shelter of the rain is found first.
    ///
    /// # Errors
    /// As [`Self::scan_radar`].
    pub fn scan_radar_once(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        radar: &RadarModel,
        motion: &CameraMotion,
        options: &RadarScanOptions,
    ) -> Result<RadarSweep> {
        let mut made = None;
        let mut take = |sweep| {
            made = Some(sweep);
            Ok(())
        };
        self.scan_radar(place, weather, radar, motion, options, 1, &mut take, &mut ())?;
        made.ok_or(Error::Stopped)
    }

    /// Makes `sweeps` sweeps from `options.index` on, each as [`Self::scan_radar_once`] makes it,
    /// and hands each to `take`. Returns their number: fewer than asked for if `progress` asked to
    /// stop. Sweep `i` begins `i` periods after the start and is the same if made alone.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for the paper's fidelity, for a flood, and if the splats were
    /// released; the errors of `take`.
    #[allow(
        clippy::too_many_arguments,
        reason = "each is a thing of its own: place, weather, sensor, path, sink"
    )]
    pub fn scan_radar(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        radar: &RadarModel,
        motion: &CameraMotion,
        options: &RadarScanOptions,
        sweeps: u32,
        take: &mut dyn FnMut(RadarSweep) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32> {
        check_owner(place, self.id())?;
        check_physical(weather, "radar")?;
        self.focus_along(place, motion)?;
        let site = *place.site();
        let motion = UprightMotion::new(motion, &site, options.time);
        let scene = Arc::clone(place.scene());
        let splats = &scene.splats;
        let is_met = |index: usize| splats.groups[index] != Group::Sky;
        let mut rays = self.backend_mut().ray_splats(splats, is_met, |_| 0.0)?;
        for index in options.index..options.index.saturating_add(sweeps) {
            if progress.is_stopped() {
                return Ok(index - options.index);
            }
            let path = self.backend().path();
            let own = RadarScanOptions { index, ..*options };
            let time = options.time + f64::from(index) * radar.period();
            let scan = |pool: &rayon::ThreadPool, prepared: &_, shelter: Option<&_>| {
                let scene = RadarScene { splats: &rays, weather: prepared, site: &site, shelter, path };
                pool.install(|| radar_sweep(radar, &motion, &scene, &own))
            };
            let made = place.for_radars(self.backend_mut(), weather, time, progress, scan)?;
            self.backend_mut().check_rays(&mut rays)?;
            take(made)?;
        }
        Ok(sweeps)
    }
}

#[cfg(test)]
mod tests;
