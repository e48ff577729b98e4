//! The state of a view: everything except the scene that a picture depends on, in one value that
//! clients send and receive.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use wm_scene::Camera;
use wm_scene::values::MAX_SCENE_COORDINATE;
use wm_weather::Weather;

/// Checks a point that a client sends: each coordinate is within [`MAX_SCENE_COORDINATE`], as those
/// of splats are.
///
/// # Errors
/// The point in one line, which begins with its name, `what`.
pub fn check_point(what: &str, point: [f64; 3]) -> Result<(), String> {
    // NaN is within no limit.
    if point.iter().all(|v| v.abs() <= f64::from(MAX_SCENE_COORDINATE)) {
        return Ok(());
    }
    let [x, y, z] = point;
    Err(format!(
        "{what} {x:e},{y:e},{z:e}: each coordinate must be within {MAX_SCENE_COORDINATE:e} scene units"
    ))
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

/// The lidar of a state, as clients send it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LidarState {
    /// The name of a preset.
    pub(crate) model: String,
    /// The place and the heading; `null` at the camera.
    #[serde(default)]
    pub(crate) at: Option<SensorPlace>,
    /// Rays of a pulse, 1 or 7.
    #[serde(default = "one_ray")]
    pub(crate) sub_rays: u8,
    /// The returns that become points, as `scan --returns` names them.
    #[serde(default = "usual_returns")]
    pub(crate) returns: String,
    /// The colours of points: class, range or intensity.
    #[serde(default = "usual_colors")]
    pub(crate) colors: String,
}

/// The place of a sensor that does not move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPlace {
    /// The origin, world axes, scene units.
    pub(crate) eye: [f64; 3],
    /// A point ahead of it.
    pub(crate) target: [f64; 3],
}

fn one_ray() -> u8 {
    1
}

fn usual_returns() -> String {
    "strongest".into()
}

fn usual_colors() -> String {
    "class".into()
}

impl SensorPlace {
    /// Returns the place in a scene of this origin as `scan --at` reads it; bit by bit, if the
    /// origin is zero.
    pub(crate) fn text(&self, origin: DVec3) -> String {
        let world = |point| (DVec3::from_array(point) + origin).to_array();
        [self.eye, self.target].map(|point| world(point).map(|v| v.to_string()).join(",")).join(":")
    }
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
    /// Returns the initial state of a page.
    pub fn new(camera: &Camera, weather: &Weather, time: f64) -> Self {
        Self {
            camera: Pose::of(camera),
            path: Vec::new(),
            follow: Follow::Camera,
            weather: weather_to_json(weather),
            time,
            output: ViewOutput::Rgb,
            size: [camera.width, camera.height],
            quality: 90,
            divider: None,
            lidar: None,
        }
    }

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
    use crate::testing::state;
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
