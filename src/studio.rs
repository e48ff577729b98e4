//! A loaded scene and how it is drawn: all that a frame needs but the weather and the camera.

use crate::scene::Loaded;
use crate::view::spec;
use anyhow::Result;
use wm_render::{Frame, Job, RenderConfig, Renderer, SetView, Stats};
use wm_scene::Camera;
use wm_weather::{Site, Weather};

/// Where frames are made.
pub struct Studio {
    /// The scene.
    pub loaded: Loaded,
    /// What weather knows of it.
    pub site: Site,
    /// What is rendered, and over what.
    pub config: RenderConfig,
}

impl Studio {
    /// Opens it. The splats as they were read are freed: the renderer has its own.
    pub fn new(mut loaded: Loaded, config: RenderConfig) -> Self {
        loaded.release();
        Self { site: loaded.weather_site(), loaded, config }
    }

    /// Renders the instant `time` of a weather, alone: nothing depends on other frames.
    pub fn render(
        &mut self,
        weather: &Weather,
        time: f64,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<Stats> {
        let sky = weather.at(time).over(&self.site);
        let sets = [SetView::plain(self.loaded.set)];
        let stats = sky.with_hooks(|hooks| {
            let job = Job { sets: &sets, camera, config: &self.config, hooks };
            self.loaded.renderer.render(&job, frame)
        })?;
        Ok(stats)
    }

    /// The renderer in words.
    pub fn describe(&self) -> String {
        self.loaded.renderer.describe()
    }

    /// What is written into a file besides its pixels; `scene` is the name of the scene.
    pub fn tags(&self, scene: &str, weather: &Weather, time: f64, camera: &Camera) -> Vec<(String, String)> {
        vec![
            ("program".into(), concat!("weather-magician ", env!("CARGO_PKG_VERSION")).into()),
            ("scene".into(), scene.into()),
            ("weather".into(), weather_text(weather, time)),
            ("time".into(), format!("{time} s")),
            ("camera".into(), spec::text_of(camera)),
            // Without the number of threads: no byte of a picture depends on it, and none of its words may.
            ("renderer".into(), format!("cpu, {}", self.loaded.renderer.path())),
            ("metres_per_unit".into(), self.site.metres_per_unit.to_string()),
        ]
    }
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
