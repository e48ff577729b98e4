//! The names and values that are written into a file beside its pixels.

use crate::view::spec;
use wm_render::AnyRenderer;
use wm_scene::Camera;
use wm_weather::{Site, Weather};

/// The program, the scene's name, the weather, the instant, the camera, the renderer and the scale
/// of a picture.
#[must_use]
pub fn picture_tags(
    scene: &str,
    site: &Site,
    renderer: &AnyRenderer,
    weather: &Weather,
    time: f64,
    camera: &Camera,
) -> Vec<(String, String)> {
    vec![
        ("program".into(), concat!("weather-magician ", env!("CARGO_PKG_VERSION")).into()),
        ("scene".into(), scene.into()),
        ("weather".into(), weather_text(weather, time)),
        ("time".into(), format!("{time} s")),
        ("camera".into(), spec::text_of(camera, site.origin.into())),
        // Without the number of threads: no byte of a picture depends on it, and none of its words
        // may.
        ("renderer".into(), renderer.arithmetic()),
        ("metres_per_unit".into(), site.metres_per_unit.to_string()),
    ]
}

/// The weather of an instant with every value that is not its default.
fn weather_text(weather: &Weather, time: f64) -> String {
    let instant = weather.at(time);
    let mut words = vec![weather.name.clone(), instant.fidelity.name().to_owned()];
    for (effect, values) in instant.effects() {
        for (param, value) in effect.params.iter().zip(values) {
            if *value != param.default || param.name == "mor" {
                words.push(format!("{}.{}={value}", effect.name, param.name));
            }
        }
    }
    words.join(" ")
}
