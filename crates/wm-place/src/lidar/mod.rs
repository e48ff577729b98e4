//! Lidar sweeps of places in weather, and pictures of them.
//!
//! ```
//! use wm_place::lidar::{LidarModel, ScanOptions};
//! use wm_place::{Camera, CameraMotion, FrameCamera, Renderer, Weather};
//!
//! # let scene = wm_street::Street::builtin().sampling(0.1).scene(&|_| true).unwrap();
//! let mut renderer = Renderer::cpu()?;
//! let mut place = renderer.load(scene)?;
//! let look = Camera::look_at([4.0, -20.0, 1.8], [4.0, -30.0, 1.8]);
//! let view = FrameCamera::from(look).at(0.0, &place)?;
//! let weather = Weather::preset("fog")?.set("fog.mor", 80.0)?;
//! let lidar = LidarModel::find("vlp-16")?;
//! let motion = CameraMotion::from(view.camera);
//! let sweep = renderer.scan_once(&mut place, &weather, &lidar, &motion, &ScanOptions::default())?;
//! assert!(sweep.points.len() > 1000);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod colors;
mod overlay;
mod picture;

pub use crate::sweep_picture::SweepPicture;
pub use colors::PointColors;
pub use overlay::PointOverlay;
pub use picture::SweepView;
pub use wm_sensors::{
    EchoClass, LidarModel, LidarPoint, LidarSweep, PRESETS, PointFormat, PointFrame, ReturnMode, ScanOptions,
    SensorError, SensorPose, SubRays, about,
};

use crate::error::check_physical;
use crate::motion::CameraMotion;
use crate::place::{PreparedPlace, check_owner};
use crate::{Error, Progress, Renderer, Result};
use glam::DVec3;
use std::borrow::Cow;
use std::sync::Arc;
use wm_render::RayTracer;
use wm_scene::reflectance::by_label;
use wm_scene::{Group, Splats};
use wm_sensors::{LidarScene, SensorMotion, SurfaceState, SurfaceStates};
use wm_sensors::{base_reflectance, sweep};
use wm_weather::wetness::WetGains;
use wm_weather::{Site, Weather};

impl Renderer {
    /// Makes one sweep of a lidar that is where the camera of `motion` is: upright, and ahead as
    /// the camera looks, or as it is mounted on a rig. What the weather needs of the place is made
    /// first.
    ///
    /// # Errors
    /// As [`Self::scan`].
    pub fn scan_once(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        lidar: &LidarModel,
        motion: &CameraMotion,
        options: &ScanOptions,
    ) -> Result<LidarSweep> {
        let mut made = None;
        let mut take = |sweep| {
            made = Some(sweep);
            Ok(())
        };
        self.scan(place, weather, lidar, motion, options, 1, &mut take, &mut ())?;
        made.ok_or(Error::Stopped)
    }

    /// Makes `sweeps` sweeps from `options.index` on, each as [`Self::scan_once`] makes it, and
    /// hands each to `take`. Returns their number: fewer than asked for if `progress` asked to
    /// stop. Sweep `i` begins `i` periods after the start and is the same if made alone.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for the paper's fidelity, for a flood, and if the splats were
    /// released; the errors of `take`.
    #[allow(
        clippy::too_many_arguments,
        reason = "each is a thing of its own: place, weather, sensor, path, sink"
    )]
    pub fn scan(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        lidar: &LidarModel,
        motion: &CameraMotion,
        options: &ScanOptions,
        sweeps: u32,
        take: &mut dyn FnMut(LidarSweep) -> Result<()>,
        progress: &mut dyn Progress,
    ) -> Result<u32> {
        check_owner(place, self.id())?;
        check_physical(weather, "lidar")?;
        self.focus_along(place, motion)?;
        let time = |index: u32| options.time + f64::from(index) * lidar.period();
        let site = *place.site();
        let covers = |index: u32| weather.at(time(index)).prepare(&site).cover().to_vec();
        let motion = UprightMotion::new(motion, &site, options.time);
        let is_snow = weather.effects().any(|(effect, _)| effect.name == "snow_cover");
        let end = options.index.saturating_add(sweeps);
        let mut index = options.index;
        while index < end {
            let lying = self.lying_cover(place, weather, time(index), progress)?;
            let lies = covers(index);
            let scene = Arc::clone(place.scene());
            let splats: Cow<'_, Splats> = match &lying {
                Some(lying) => Cow::Owned(lying.over(&scene.splats)),
                None => Cow::Borrowed(&scene.splats),
            };
            let is_met = |index: usize| splats.groups[index] != Group::Sky;
            let known = scene.metadata.reflectances.as_deref().unwrap_or_default();
            let known = by_label(known, lidar.wavelength);
            let value = |index: usize| {
                let of_label = splats.labels.get(index).and_then(|label| known.get(label));
                of_label.map_or_else(|| base_reflectance(&splats, index), |known| *known as f32)
            };
            let mut rays = self.backend_mut().ray_splats(&splats, is_met, value)?;
            // What stands on the ground, and may be mirrored by it.
            let floor = site.ground + MIN_MIRRORED_HEIGHT_M / site.metres_per_unit;
            let height =
                |index: usize| (0..3).map(|k| f64::from(splats.means[index][k]) * site.up[k]).sum::<f64>();
            let gets_wet = weather.at(time(index)).prepare(&site).wetting_rain().is_some();
            let stands = |index: usize| is_met(index) && height(index) > floor;
            let mirrored = gets_wet.then(|| self.backend_mut().ray_splats(&splats, stands, value));
            let mut mirrored = mirrored.transpose()?;
            while index < end && covers(index) == lies {
                if progress.is_stopped() {
                    return Ok(index - options.index);
                }
                let path = self.backend().path();
                let own = ScanOptions { index, ..*options };
                let made = place.for_sensors(
                    self.backend_mut(),
                    weather,
                    time(index),
                    progress,
                    |pool, prepared, shelter, wet| {
                        let surfaces =
                            PlaceSurfaces { groups: &splats.groups, labels: &splats.labels, wet, is_snow };
                        let scene = LidarScene {
                            splats: &rays,
                            mirrored: mirrored.as_ref().map(|rays| rays as &dyn RayTracer),
                            weather: prepared,
                            site: &site,
                            shelter,
                            surfaces: &surfaces,
                            path,
                        };
                        pool.install(|| sweep(lidar, &motion, &scene, &own))
                    },
                )?;
                for rays in [Some(&mut rays), mirrored.as_mut()].into_iter().flatten() {
                    self.backend_mut().check_rays(rays)?;
                }
                take(made)?;
                index += 1;
            }
        }
        Ok(index - options.index)
    }
}

/// Splats are mirrored in wet ground from this height above it on, m.
const MIN_MIRRORED_HEIGHT_M: f64 = 0.3;

/// The surfaces of a place in a weather.
struct PlaceSurfaces<'a> {
    groups: &'a [Group],
    labels: &'a [u16],
    wet: Option<&'a WetGains<'a>>,
    /// True if the lying cover is snow, false if it is dust.
    is_snow: bool,
}

impl SurfaceStates for PlaceSurfaces<'_> {
    fn state(&self, splat: u32) -> SurfaceState {
        let index = splat as usize;
        let is_snow = self.is_snow && self.groups.get(index) == Some(&Group::Snow);
        let [pores, film] = self.wet.and_then(|wet| wet.shares(index)).unwrap_or_default().map(f64::from);
        // Lying snow is no splat of the scene.
        let label = self.labels.get(index).copied().unwrap_or(0);
        SurfaceState { is_snow, pores, film, label }
    }
}

/// A sensor that stands upright where a camera is, and looks ahead as it does.
pub(crate) struct UprightMotion<'a> {
    motion: &'a CameraMotion,
    up: DVec3,
    metres: f64,
    /// The time at which a camera without a path is where it says, s.
    from: f64,
}

impl<'a> UprightMotion<'a> {
    /// Places a sensor on a camera's path; a camera without a path is where it says at `from`, s.
    pub(crate) fn new(motion: &'a CameraMotion, site: &Site, from: f64) -> Self {
        Self { motion, up: DVec3::from_array(site.up), metres: site.metres_per_unit, from }
    }
}

/// A camera's view direction counts as ahead if its horizontal part is longer than this. For
/// steeper cameras the top of the picture is ahead.
const MIN_LEVEL_PART: f64 = 0.1;

impl SensorMotion for UprightMotion<'_> {
    fn pose(&self, time: f64) -> SensorPose {
        // On a rig a sensor stands as it is mounted.
        if let CameraMotion::Mounted { .. } = self.motion {
            return self.motion.sensor_pose(time);
        }
        let camera = self.motion.camera(time);
        let forward = camera.forward();
        let is_level = forward.reject_from_normalized(self.up).length() > MIN_LEVEL_PART;
        let ahead = if is_level { forward } else { camera.up() };
        let driven = match self.motion {
            CameraMotion::Still { speed, .. } => forward * (speed * (time - self.from) / self.metres),
            CameraMotion::Along { .. } | CameraMotion::Delayed { .. } | CameraMotion::Mounted { .. } => {
                DVec3::ZERO
            }
        };
        SensorPose::upright(camera.center() + driven, ahead, self.up)
    }
}

#[cfg(test)]
mod tests;
