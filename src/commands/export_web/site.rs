//! The file of a site and the files of its page.

use super::output::write;
use super::single_file::with_policy;
use anyhow::Result;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::path::Path;
use weather_magician::view::path::PathKey;
use wm_scene::{Camera, Metadata};
use wm_weather::Weather;

/// The name of the program and its version.
pub const PROGRAM: &str = concat!("weather-magician ", env!("CARGO_PKG_VERSION"));
/// The version of the files of a site.
pub const SITE_VERSION: u32 = 1;

/// The camera of a photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteView {
    /// The name of the photo.
    pub name: String,
    /// The camera.
    pub camera: Camera,
}

/// A file of a site that a page may fetch.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteAsset {
    /// The path below `place/`.
    pub name: String,
    /// The size, bytes.
    pub bytes: u64,
}

/// The scene of a static page: its facts, the initial view, and the files that belong to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SiteFile {
    /// [`SITE_VERSION`].
    pub version: u32,
    /// The program that wrote it.
    pub program: String,
    /// The name of the scene, used in file names.
    pub name: String,
    /// The file of the scene below `place/`.
    pub scene: String,
    /// The facts of the scene.
    pub metadata: Metadata,
    /// The cameras of the photos, all of them: they shape what lies.
    pub views: Vec<SiteView>,
    /// The initial state.
    pub start: Value,
    /// Near plane, scene units.
    pub near: f64,
    /// Command-line words of the scene.
    pub words: Vec<String>,
    /// The files below `place/` beside the scene.
    pub files: Vec<SiteAsset>,
    /// The digest of the scene that the files were made of, 32 bytes in hexadecimal digits.
    pub digest: String,
    /// Names of the presets that have a thumbnail, `thumbnails/NAME.jpg` below `place/`.
    pub thumbnails: Vec<String>,
    /// Number of splats of the scene.
    pub splats: u64,
    /// Memory for the splats of a scene in levels of detail, bytes.
    pub memory: Option<u64>,
}

impl SiteFile {
    /// Returns the text of the file.
    pub fn text(&self) -> Result<String, String> {
        Ok(serde_json::to_string(self).map_err(|error| format!("place.json: {error}"))? + "\n")
    }
}

/// Returns the initial state of a page.
pub fn start(camera: &Camera, weather: &Weather, time: f64) -> Value {
    let key = PathKey::of(camera, 0.0);
    let r = key.rotation;
    let pose = json!({ "eye": key.eye.to_array(), "rotation": [r.w, r.x, r.y, r.z], "fov": key.fov });
    json!({
        "camera": pose, "path": [], "follow": "camera", "weather": weather_to_json(weather), "time": time,
        "output": "rgb", "size": [camera.width, camera.height], "quality": 90, "divider": null, "lidar": null,
    })
}

fn weather_to_json(weather: &Weather) -> Value {
    let table: toml::Table =
        toml::from_str(&weather.to_toml()).expect("weather files that are written can be read");
    json_of(toml::Value::Table(table))
}

fn json_of(value: toml::Value) -> Value {
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

macro_rules! page {
    ($($name:literal),+ $(,)?) => {
        /// The files of the page.
        pub const PAGE: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../viewer/page/", $name)))),+];
    };
}

page! {
    "index.html", "style.css", "icon.svg", "dial.js", "align.js", "align.css", "main.js", "camera.js", "controls.js",
    "connection.js", "dom.js", "files.js", "lidar.js", "panels.js", "store.js", "timeline.js", "tracks.js",
}

/// What a page may load: its own files. Its module is compiled, and pictures are shown from memory.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; \
                      style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; media-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'";

/// Writes the files of the page into a site.
pub fn write_page(folder: &Path) -> Result<()> {
    for (name, text) in PAGE {
        let text = match *name {
            "index.html" => with_policy(text, POLICY)?,
            _ => (*text).to_owned(),
        };
        write(&folder.join(name), text.as_bytes())?;
    }
    Ok(())
}
