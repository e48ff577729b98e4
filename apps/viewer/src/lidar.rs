//! The lidar of a state, checked.

use crate::state::{LidarState, SensorPlace, check_point};
use glam::DVec3;
use serde_json::{Value, json};
use weather_magician::lidar::{LidarModel, PRESETS, PointColors, ReturnMode, ScanOptions, SubRays, about};
use weather_magician::view::ViewOptions;
use weather_magician::view::spec::CameraSpec;
use wm_scene::Camera;
use wm_scene::survey::Survey;

/// Largest coordinate of a sensor, scene units.
const MAX_COORDINATE: f64 = 1e6;

/// The lidar of a state that was checked.
#[derive(Clone, Debug)]
pub struct CheckedLidar {
    /// The lidar.
    pub model: LidarModel,
    /// The camera that a sensor is at which does not move; `None` for the camera of the view.
    pub(crate) fixed: Option<Camera>,
    /// Rays of a pulse.
    sub_rays: SubRays,
    /// The returns that become points.
    returns: ReturnMode,
    /// The colours of points.
    pub(crate) colors: PointColors,
}

impl CheckedLidar {
    /// Checks the lidar of a state.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub(crate) fn new(state: &LidarState, survey: &Survey) -> Result<Self, String> {
        let model = LidarModel::preset(&state.model).map_err(|error| format!("lidar: {error}"))?;
        let sub_rays = SubRays::of_count(state.sub_rays.into())
            .ok_or_else(|| format!("lidar.sub_rays is {}: must be 1 or 7", state.sub_rays))?;
        let returns = state.returns.parse().map_err(|_| {
            format!("lidar.returns is `{}`: must be one of {}", state.returns, return_names().join(", "))
        })?;
        let colors = state.colors.parse().map_err(|error: String| format!("lidar.colors: {error}"))?;
        let camera = |place: &SensorPlace| {
            check_point("lidar.at: eye", place.eye)?;
            check_point("lidar.at: target", place.target)?;
            let [eye, target] =
                [place.eye, place.target].map(|point| DVec3::from_array(point) + survey.origin);
            let camera = CameraSpec::LookAt { eye, target }.camera(&[], survey, &ViewOptions::default());
            camera.map_err(|error| format!("lidar.at: {error}"))
        };
        let fixed = state.at.as_ref().map(camera).transpose()?;
        let at = fixed.map_or(DVec3::ZERO, |camera| camera.center());
        if at.abs().max_element() > MAX_COORDINATE {
            return Err(format!("lidar.at: the sensor must be within {MAX_COORDINATE} scene units"));
        }
        Ok(Self { model, fixed, sub_rays, returns, colors })
    }

    /// Returns the options of a sweep at a time, s, as `scan` has them.
    pub fn options(&self, time: f64) -> ScanOptions {
        ScanOptions { time, sub_rays: self.sub_rays, returns: self.returns, ..ScanOptions::default() }
    }
}

/// Returns the presets as JSON.
pub(crate) fn presets() -> Value {
    PRESETS.iter().map(|(name, text)| json!({ "name": name, "about": about(text) })).collect()
}

/// Returns the names of the choices of returns.
pub(crate) fn return_names() -> Vec<&'static str> {
    ReturnMode::ALL.iter().map(|(_, name)| *name).collect()
}
