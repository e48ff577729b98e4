//! The names that clients may use: parameters, weathers, cameras. Names from a client are looked up
//! here only, so that none of them reaches the file system.

use crate::state::{Follow, Pose, ViewOutput, ViewState, weather_of_json, weather_to_json};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use weather_magician::view::ViewOptions;
use weather_magician::view::path::{CameraPath, PathKey};
use wm_scene::Camera;
use wm_scene::survey::{FactSource, Survey};
use wm_weather::param::{Param, ParamKind};
use wm_weather::presets::PRESETS;
use wm_weather::{EFFECTS, Easing, Panorama, ParamValue, Weather};

/// Maximum number of photos' cameras that are sent to the page, evenly spaced.
const MAX_VIEWS: usize = 400;

/// Facts about the scene, and the names that clients may use.
#[derive(Clone, Debug)]
pub struct Catalog {
    /// The scene's name, used in file names.
    pub stem: String,
    /// Command-line words of the scene; names of files need not be UTF-8.
    pub words: Vec<OsString>,
    /// Command-line words of its facts.
    pub fact_words: Vec<String>,
    /// True if the facts were changed and not saved.
    pub is_unsaved: bool,
    /// Command-line words of the run's options that change bytes.
    pub run_words: Vec<String>,
    /// Facts of the scene, such as its up direction and scale.
    pub survey: Survey,
    /// Near plane, scene units.
    pub near: f64,
    /// Number of splats of the scene.
    pub splats: usize,
    /// Description of the renderer.
    pub renderer: String,
    /// Names and cameras of the photos.
    pub views: Vec<(String, Camera)>,
    /// The initial weather.
    pub weather: Weather,
    /// Panoramas by the paths that weather files use for them.
    pub panoramas: BTreeMap<String, Arc<Panorama>>,
    /// True if videos can be rendered.
    pub has_video: bool,
}

impl Catalog {
    /// Parses a weather from JSON and loads its panoramas.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub fn weather(&self, value: &Value) -> Result<Weather, String> {
        let mut weather = weather_of_json(value)?;
        self.load_panoramas(&mut weather)?;
        Ok(weather)
    }

    /// Converts the text of a weather file to the weather of a state.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub fn read_weather(&self, text: &str) -> Result<Value, String> {
        let mut weather = Weather::parse(text, "weather.toml").map_err(|error| error.to_string())?;
        if weather.name.is_empty() {
            weather.name = "mine".into();
        }
        self.load_panoramas(&mut weather)?;
        Ok(weather_to_json(&weather))
    }

    /// Sets the panoramas of a weather.
    ///
    /// # Errors
    /// The program was not started with a panorama of this path.
    fn load_panoramas(&self, weather: &mut Weather) -> Result<(), String> {
        weather.load_images(|path| {
            let known = path.to_str().and_then(|name| self.panoramas.get(name));
            known.cloned().ok_or_else(|| {
                let known: Vec<&str> = self.panoramas.keys().map(String::as_str).collect();
                let known = if known.is_empty() { "none".into() } else { known.join(", ") };
                format!("sky.panorama: the program was started with {known}; give --panorama FILE to `view`")
            })
        })
    }

    /// Returns the text of the keyframe file of a state's camera or path, and the path that
    /// `render` reads from it, bit by bit.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub(crate) fn camera_path(&self, state: &ViewState) -> Result<(String, CameraPath), String> {
        let key = |time, eye, [w, x, y, z]: [f64; 4], fov| {
            let rotation = DQuat::from_xyzw(x, y, z, w);
            let is_turn = rotation.is_finite() && rotation.length() > 1e-9;
            let rotation = if is_turn { rotation.normalize() } else { rotation };
            PathKey { time, eye: DVec3::from_array(eye), rotation, fov }
        };
        let keys: Vec<PathKey> = match state.follow {
            Follow::Camera => {
                let Pose { eye, rotation, fov } = state.camera;
                vec![key(0.0, eye, rotation, fov)]
            }
            Follow::Path => state.path.iter().map(|k| key(k.time, k.eye, k.rotation, k.fov)).collect(),
        };
        let said = |error: weather_magician::view::ViewError| error.to_string();
        let text = CameraPath::new(keys, self.near).map_err(said)?.text(self.survey.origin);
        let path = CameraPath::parse(&text, &self.survey, &ViewOptions::default()).map_err(said)?;
        Ok((text, path))
    }

    /// Returns the initial state with a camera.
    pub fn initial_state(&self, camera: &Camera) -> ViewState {
        ViewState::new(camera, &self.weather, 0.0)
    }

    /// Returns the facts of the scene as JSON.
    pub fn facts(&self) -> Value {
        let survey = &self.survey;
        json!({
            "up": survey.up.value.to_array(),
            "up_confidence": survey.up.confidence.to_string(),
            "center": survey.center.to_array(),
            "radius": survey.radius,
            "ground": survey.ground.value,
            "metres_per_unit": survey.metres_per_unit.value,
            "has_scale": survey.metres_per_unit.source != FactSource::Assumed,
            "unsaved": self.is_unsaved,
        })
    }

    /// Returns the catalog as JSON, for the page and for scripts.
    pub fn json(&self, start: &ViewState) -> Value {
        let every = self.views.len().div_ceil(MAX_VIEWS).max(1);
        let view = |(name, camera): &(String, Camera)| json!({ "name": name, "camera": Pose::of(camera) });
        let preset = |(name, _): &(&str, &str)| {
            let weather = Weather::preset(name).unwrap_or_default();
            json!({ "name": name, "about": weather.about, "weather": weather_to_json(&weather) })
        };
        let mut scene = self.facts();
        scene["name"] = json!(self.stem);
        scene["splats"] = json!(self.splats);
        scene["renderer"] = json!(self.renderer);
        scene["views"] = self.views.iter().step_by(every).map(view).collect();
        json!({
            "program": crate::PROGRAM,
            "scene": scene,
            "state": start,
            "outputs": ViewOutput::ALL.map(|(_, name)| name),
            "easings": Easing::ALL.map(Easing::name),
            "effects": effects(),
            "presets": PRESETS.iter().map(preset).collect::<Value>(),
            "panoramas": self.panoramas.keys().collect::<Vec<_>>(),
            "video": self.has_video,
            "lidars": crate::lidar::presets(),
            "returns": crate::lidar::return_names(),
        })
    }
}

/// Returns every effect with its parameters as JSON.
fn effects() -> Value {
    let effect = |effect: &wm_weather::Effect| {
        json!({
            "name": effect.name,
            "about": effect.about,
            "role": effect.role.name(),
            "params": effect.params.iter().map(param).collect::<Value>(),
        })
    };
    EFFECTS.iter().map(effect).collect()
}

fn param(param: &Param) -> Value {
    let (kind, words): (_, &[&str]) = match param.kind {
        ParamKind::Number => ("number", &[]),
        ParamKind::NumberOrAuto => ("number-or-auto", &[]),
        ParamKind::ColorOrAuto => ("color-or-auto", &[]),
        ParamKind::Word(words) => ("word", words),
        ParamKind::ImageOrAuto => ("picture-or-auto", &[]),
    };
    // JSON has no infinity.
    let number = |number: f64| if number.is_finite() { json!(number) } else { json!(number.to_string()) };
    let default = match &param.default {
        ParamValue::Number(value) => number(*value),
        ParamValue::Color(rgb) => json!(rgb),
        other => json!(other.to_string()),
    };
    json!({
        "name": param.name,
        "kind": kind,
        "words": words,
        "default": default,
        "least": number(param.range.0),
        "greatest": number(param.range.1),
        "unit": param.unit,
        "meaning": param.meaning.trim(),
    })
}

/// Returns the panoramas that a weather uses, by path.
///
/// # Errors
/// As [`panorama_name`].
pub fn panoramas_of(weather: &Weather) -> Result<BTreeMap<String, Arc<Panorama>>, String> {
    let keys = weather.effects().flat_map(|(_, tracks)| tracks).flat_map(wm_weather::Track::keys);
    let picture = |key: &wm_weather::Keyframe| match &key.value {
        ParamValue::Image(picture) => Some((picture.path().to_owned(), Arc::clone(picture.panorama()?))),
        _ => None,
    };
    keys.filter_map(picture).map(|(path, picture)| Ok((panorama_name(&path)?, picture))).collect()
}

/// Returns the text by which states, links and commands name the panorama at a path.
///
/// # Errors
/// The path is not UTF-8, so that no text can name it.
pub fn panorama_name(path: &Path) -> Result<String, String> {
    let name = path.to_str().map(str::to_owned);
    name.ok_or_else(|| format!("panorama {}: its path is not text in UTF-8; rename it", path.display()))
}
