//! The state of a view: everything except the scene that a picture depends on, in one value that
//! clients send and receive.

use crate::catalog::Catalog;
use crate::lidar::{CheckedLidar, LidarState};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::sync::Arc;
use weather_magician::CameraMotion;
use weather_magician::view::path::CameraPath;
use wm_scene::Camera;
use wm_scene::values::FARTHEST;
use wm_weather::Weather;

/// Longest side of a picture, px.
const MAX_SIDE: u32 = 4096;
/// Maximum number of pixels of a picture.
const MAX_PIXELS: u64 = 3840 * 2160;
/// Largest absolute time, seconds.
const MAX_TIME: f64 = 1e6;

/// Checks a point that a client sends: each coordinate is within [`FARTHEST`], as those of splats
/// are.
///
/// # Errors
/// The point in one line, which begins with its name, `what`.
pub fn check_point(what: &str, point: [f64; 3]) -> Result<(), String> {
    // NaN is within no limit.
    if point.iter().all(|v| v.abs() <= f64::from(FARTHEST)) {
        return Ok(());
    }
    let [x, y, z] = point;
    Err(format!("{what} {x:e},{y:e},{z:e}: each coordinate must be within {FARTHEST:e} scene units"))
}

/// Position, orientation and field of view of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// The camera centre, world axes, scene units.
    pub(crate) eye: [f64; 3],
    /// `camera_from_world` as a quaternion wxyz, OpenCV axes.
    pub(crate) rotation: [f64; 4],
    /// Vertical field of view, degrees.
    pub fov: f64,
}

impl Pose {
    /// Returns the pose of a camera.
    pub fn of(camera: &Camera) -> Self {
        let key = weather_magician::view::path::PathKey::of(camera, 0.0);
        let r = key.rotation;
        Self { eye: key.eye.to_array(), rotation: [r.w, r.x, r.y, r.z], fov: key.fov }
    }

    /// Returns the pose with its horizon level under another up; unchanged if it looks straight up
    /// or down.
    pub fn levelled(self, up: DVec3) -> Self {
        let [w, x, y, z] = self.rotation;
        let forward = DQuat::from_xyzw(x, y, z, w).normalize().inverse() * DVec3::Z;
        let eye = DVec3::from_array(self.eye);
        // A pose is of any size.
        Camera::looking((2, 2), self.fov, eye, eye + forward, up).map_or(self, |camera| Self::of(&camera))
    }
}

/// A keyframe of a camera path: a pose at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseKey {
    /// Time, seconds.
    pub(crate) time: f64,
    /// The camera centre, world axes, scene units.
    pub(crate) eye: [f64; 3],
    /// `camera_from_world` as a quaternion wxyz, OpenCV axes.
    pub(crate) rotation: [f64; 4],
    /// Vertical field of view, degrees.
    pub(crate) fov: f64,
}

/// The kind of picture to show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ViewOutput {
    /// The colour.
    #[default]
    Rgb,
    /// Expected depth as colours, near ones warm.
    Depth,
    /// Normals, `0.5 + 0.5 n`.
    Normal,
    /// Opacity of the splats.
    Alpha,
}

impl ViewOutput {
    /// All kinds with their names on the page.
    pub const ALL: [(Self, &str); 4] =
        [(Self::Rgb, "rgb"), (Self::Depth, "depth"), (Self::Normal, "normal"), (Self::Alpha, "alpha")];

    /// The name in JSON and of the option `--also`.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(output, _)| *output == self).map_or("rgb", |(_, name)| name)
    }
}

/// The source of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Follow {
    /// The field `camera`.
    #[default]
    Camera,
    /// The field `path` at `time`.
    Path,
}

/// Everything except the scene that a picture depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewState {
    /// The camera, if `follow` is `Camera`.
    pub camera: Pose,
    /// Keyframes of a camera path, times ascending; may be empty.
    pub path: Vec<PoseKey>,
    /// The source of the camera.
    pub follow: Follow,
    /// The content of a weather file as JSON; infinite numbers are the text `inf`.
    pub weather: Value,
    /// Time, seconds.
    pub time: f64,
    /// The kind of picture.
    pub output: ViewOutput,
    /// Width and height, px.
    pub size: [u32; 2],
    /// JPEG quality, 1-100.
    pub quality: u8,
    /// Fraction of the width, 0-1, left of which no weather is rendered; `null` for weather
    /// everywhere.
    pub divider: Option<f64>,
    /// The lidar whose points are drawn over the picture; `null` for none.
    pub lidar: Option<LidarState>,
}

impl ViewState {
    /// Returns a copy with the fields of the object `patch` replaced.
    ///
    /// # Errors
    /// The patch is no object, or a field is unknown or of the wrong type.
    pub fn patched(&self, patch: Value) -> Result<Self, String> {
        let Value::Object(patch) = patch else { return Err("state: must be an object".into()) };
        let Ok(Value::Object(mut whole)) = serde_json::to_value(self) else {
            return Err("the state cannot be written".into());
        };
        whole.extend(patch);
        serde_json::from_value(Value::Object(whole)).map_err(|error| format!("state: {error}"))
    }
}

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

/// Converts a weather to JSON.
pub fn weather_to_json(weather: &Weather) -> Value {
    let table: toml::Table =
        toml::from_str(&weather.to_toml()).expect("weather files that are written can be read");
    json_of(toml::Value::Table(table))
}

pub(crate) fn json_of(value: toml::Value) -> Value {
    match value {
        toml::Value::Float(number) if number.is_finite() => json!(number),
        toml::Value::Float(number) => json!(number.to_string()),
        toml::Value::Integer(number) => json!(number),
        toml::Value::Boolean(value) => json!(value),
        toml::Value::String(text) => json!(text),
        toml::Value::Datetime(time) => json!(time.to_string()),
        toml::Value::Array(list) => list.into_iter().map(json_of).collect(),
        toml::Value::Table(table) => {
            Value::Object(table.into_iter().map(|(key, value)| (key, json_of(value))).collect::<Map<_, _>>())
        }
    }
}

/// Parses a weather from JSON; its panoramas are not loaded.
///
/// # Errors
/// The first invalid value, in one line.
pub fn weather_of_json(value: &Value) -> Result<Weather, String> {
    if !value.is_object() {
        return Err("weather: must be an object, as a weather file is a table".into());
    }
    let text = toml::to_string(value).map_err(|error| format!("weather: {error}"))?;
    let mut weather = Weather::parse(&text, "weather").map_err(|error| error.to_string())?;
    if weather.name.is_empty() {
        weather.name = "mine".into();
    }
    Ok(weather)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{catalog, state};
    use wm_weather::presets::PRESETS;

    #[test]
    fn weathers_are_the_same_after_the_way_through_json() {
        for (name, _) in PRESETS {
            let weather = Weather::preset(name).unwrap();
            let json = serde_json::to_string(&weather_to_json(&weather)).unwrap();
            assert_eq!(weather_of_json(&serde_json::from_str(&json).unwrap()), Ok(weather));
        }
        let mut odd = Weather::preset("fog").unwrap();
        for set in ["fog.scale_height=inf", "fog.mor=0:2000:smooth,5:60.123", "fog.tint=0.1,0.2,0.3"] {
            odd.set_text(set).unwrap();
        }
        assert_eq!(weather_of_json(&weather_to_json(&odd)), Ok(odd));
    }

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

    #[test]
    fn patches_change_what_they_name() {
        let patched = state().patched(json!({ "time": 2, "divider": 0.25 })).unwrap();
        assert_eq!(patched, ViewState { time: 2.0, divider: Some(0.25), ..state() });
        assert!(state().patched(json!({ "tiem": 2 })).unwrap_err().contains("tiem"));
        assert!(state().patched(json!(2)).is_err());
    }

    #[test]
    fn errors_are_one_line() {
        for (text, expected) in [
            ("3", "weather: must be an object"),
            (r#"{"fog": {"mor": -5}}"#, "fog.mor is -5: must be"),
            (r#"{"fog": {"moor": 5}}"#, "did you mean `mor`"),
            (r#"{"fog": null}"#, "weather: "),
            (r#"{"fgo": {}}"#, "did you mean `fog`"),
            (r#"{"fog": {"mor": {"keys": [[1, 2], [0, 3]]}}}"#, "times must rise"),
            (r#"{"fog": {"mor": {"keys": [[1, 2, "bounce"], [2, 3]]}}}"#, "the easings are"),
        ] {
            let error = weather_of_json(&serde_json::from_str(text).unwrap()).unwrap_err();
            assert!(error.contains(expected) && !error.contains('\n'), "{text}: {error}");
        }
    }
}
