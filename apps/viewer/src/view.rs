//! A state that was checked against the scene.
//!
//! The weather of a state is the content of a weather file, and the camera goes through the text of
//! a keyframe file. So `render` gives the same bytes from the files that a view saves.

use crate::catalog::Catalog;
use crate::lidar::CheckedLidar;
use crate::state::{Follow, ViewState, check_point};
use std::sync::Arc;
use weather_magician::view::path::CameraPath;
use weather_magician::{Camera, CameraMotion, Weather};

/// Longest side of a picture, px.
const MAX_SIDE: u32 = 4096;
/// Maximum number of pixels of a picture.
const MAX_PIXELS: u64 = 3840 * 2160;
/// Largest absolute time, seconds.
const MAX_TIME: f64 = 1e6;

/// A state that was checked and is ready to be rendered.
#[derive(Clone, Debug)]
pub struct View {
    /// The state that was checked.
    pub state: ViewState,
    /// The weather, with its panoramas loaded.
    pub weather: Arc<Weather>,
    /// The text of the keyframe file for `--camera` or `--path`.
    pub(crate) camera_file: String,
    /// The lidar of the state.
    pub lidar: Option<CheckedLidar>,
    path: CameraPath,
}

impl View {
    /// Checks a state; the weather of `before` is reused if it is the same.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub fn new(state: ViewState, catalog: &Catalog, before: Option<&Self>) -> Result<Self, String> {
        let [width, height] = state.size;
        let pixels = u64::from(width) * u64::from(height);
        if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE || pixels > MAX_PIXELS {
            return Err(format!(
                "size {width}x{height}: sides are 1 to {MAX_SIDE} px, {MAX_PIXELS} px in all"
            ));
        }
        if state.time.is_nan() || state.time.abs() > MAX_TIME {
            return Err(format!("time {}: must be a number of seconds within {MAX_TIME}", state.time));
        }
        if !(1..=100).contains(&state.quality) {
            return Err(format!("quality {}: must be 1 to 100", state.quality));
        }
        if state.divider.is_some_and(|share| !(0.0..=1.0).contains(&share)) {
            return Err("divider: must be a share of the width, 0 to 1, or null".into());
        }
        check_point("camera: eye", state.camera.eye)?;
        state.path.iter().try_for_each(|key| check_point("path: eye", key.eye))?;
        let weather = match before.filter(|before| before.state.weather == state.weather) {
            Some(before) => Arc::clone(&before.weather),
            None => Arc::new(catalog.weather(&state.weather)?),
        };
        let (camera_file, path) = catalog.camera_path(&state)?;
        let lidar =
            state.lidar.as_ref().map(|lidar| CheckedLidar::new(lidar, &catalog.survey)).transpose()?;
        let view = Self { state, weather, camera_file, lidar, path };
        view.camera().check().map_err(|error| error.to_string())?;
        Ok(view)
    }

    /// Returns the motion of the camera, as `render` has it with `--camera FILE` or `--path FILE`.
    pub fn motion(&self) -> CameraMotion {
        self.motion_for(self.size())
    }

    /// Returns the motion of the camera for pictures of another size, px.
    pub(crate) fn motion_for(&self, size: (u32, u32)) -> CameraMotion {
        match self.state.follow {
            Follow::Camera => self.path.at(self.path.start(), size).into(),
            Follow::Path => CameraMotion::Along { path: self.path.clone(), size },
        }
    }

    /// Returns the camera at the state's time.
    pub fn camera(&self) -> Camera {
        self.motion().camera(self.state.time)
    }

    /// Returns the motion of the lidar, as `scan` has it with `--at` or `--path`; `None` without a
    /// lidar.
    pub fn sensor_motion(&self) -> Option<CameraMotion> {
        let fixed = self.lidar.as_ref()?.fixed;
        Some(fixed.map_or_else(|| self.motion(), CameraMotion::from))
    }

    /// Returns the size of the picture, px.
    pub fn size(&self) -> (u32, u32) {
        (self.state.size[0], self.state.size[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Pose, PoseKey};
    use crate::testing::{catalog, state};

    #[test]
    fn a_camera_is_the_one_of_its_file() {
        let mut state = state();
        // Not of length 1, and not of few digits.
        state.camera.rotation = [0.7123, 0.31, -0.6000000000000001, 1.0 / 3.0];
        let view = View::new(state.clone(), &catalog(), None).unwrap();
        let survey = catalog().survey;
        let read =
            CameraPath::parse(&view.camera_file, &survey, &weather_magician::view::ViewOptions::default())
                .unwrap();
        assert_eq!(read.at(0.0, (60, 40)), view.motion().camera(0.0));
        // And of a path at an instant of it.
        let key =
            |time: f64| PoseKey { time, eye: [time, 0.1, 0.2], rotation: state.camera.rotation, fov: 50.0 };
        (state.path, state.follow, state.time) = (vec![key(1.0), key(2.7)], Follow::Path, 0.9);
        let view = View::new(state, &catalog(), None).unwrap();
        let read =
            CameraPath::parse(&view.camera_file, &survey, &weather_magician::view::ViewOptions::default())
                .unwrap();
        assert_eq!(read.at(read.start() + 0.9, (60, 40)), view.motion().camera(0.9));
    }

    #[test]
    fn points_beyond_any_place_are_refused() {
        let pose = |eye| Pose { eye, ..state().camera };
        let key = |eye| PoseKey { time: 0.0, eye, rotation: [1.0, 0.0, 0.0, 0.0], fov: 50.0 };
        for bad in [1e11, -1e20, 1e300, f64::INFINITY, f64::NAN] {
            let eye = [0.0, bad, 0.0];
            for state in [
                ViewState { camera: pose(eye), ..state() },
                ViewState { path: vec![key([0.0; 3]), key(eye)], ..state() },
            ] {
                let error = View::new(state, &catalog(), None).unwrap_err();
                assert!(error.contains("within 1e10 scene units") && error.len() < 200, "{error}");
            }
        }
        assert!(View::new(ViewState { camera: pose([1e10; 3]), ..state() }, &catalog(), None).is_ok());
    }
}
