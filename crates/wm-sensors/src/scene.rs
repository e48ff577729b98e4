//! The place in weather that a lidar scans.

use crate::surface::SurfaceStates;
use wm_render::RayTracer;
use wm_render::simd::SimdPath;
use wm_weather::shelter::Shelter;
use wm_weather::{PreparedWeather, Site};

/// A place in weather, for sensors.
#[derive(Clone, Copy)]
pub struct LidarScene<'a> {
    /// The splats, with their reflectances as values; see [`crate::reflecting_splats`].
    pub splats: &'a dyn RayTracer,
    /// The splats above the ground, which wet ground mirrors; `None` for no ghosts.
    pub mirrored: Option<&'a dyn RayTracer>,
    /// The weather at the start of the sweep.
    pub weather: &'a PreparedWeather,
    /// The scale and the up direction.
    pub site: &'a Site,
    /// The map of the places that rain and snow do not reach; `None` to ignore roofs.
    pub shelter: Option<&'a Shelter>,
    /// Wet and snowy surfaces.
    pub surfaces: &'a dyn SurfaceStates,
    /// The processor's instructions.
    pub path: SimdPath,
}
