//! The lamps of a place: those that its scene states, or a row along the path of its photos.

use glam::DVec3;
use std::f64::consts::TAU;
use wm_scene::lamps::along_path;
use wm_scene::survey::Survey;
use wm_scene::{Lamp, Scene};
use wm_weather::dome::level_axes;
use wm_weather::light::LampLights;
use wm_weather::{LampLevels, LampSource, Site};

/// Distance between lamps along a path, m.
pub const SPACING: f64 = 25.0;
/// Distance of a row of lamps from the path, m.
pub const ASIDE: f64 = 3.0;
/// Height of such lamps above the ground, m.
pub const HEIGHT: f64 = 6.0;

/// Returns a row of lamps beside the path of a scene's photos, each shining down: [`SPACING`] apart, [`ASIDE`] to the right of it and
/// [`HEIGHT`] above the ground. Without photos they are one lamp in the middle of the place and six around it.
#[must_use]
pub fn lamps_along_photos(scene: &Scene, survey: &Survey) -> Vec<Lamp> {
    let up = survey.up.value;
    let centers: Vec<DVec3> = scene.views.iter().map(|view| view.camera.center()).collect();
    let height = scene.metadata.camera_height;
    let ground = |foot: DVec3| {
        // Under cameras that were carried at one height the ground follows their path.
        let nearest = centers.iter().min_by(|a, b| {
            let level = |center: &DVec3| (*center - foot).reject_from(up).length_squared();
            level(a).total_cmp(&level(b))
        });
        match (height, nearest) {
            (Some(height), Some(nearest)) => up.dot(*nearest) - height,
            _ => survey.ground.value,
        }
    };
    let units = [SPACING, ASIDE, HEIGHT].map(|metres| metres / survey.metres_per_unit.value);
    if !centers.is_empty() {
        return along_path(&centers, up, ground, units);
    }
    let [spacing, _, height] = units;
    let axes = level_axes(up.to_array()).map(DVec3::from_array);
    let around = (0..6).map(|k| {
        let (sin, cos) = (TAU * f64::from(k) / 6.0).sin_cos();
        (axes[0] * cos + axes[1] * sin) * spacing
    });
    let near = around.filter(|_| survey.radius > spacing);
    let level = survey.center - up * (up.dot(survey.center) - survey.ground.value - height);
    let lamp = |aside: DVec3| Lamp { aim: Some((-up).to_array()), ..Lamp::new((level + aside).to_array()) };
    std::iter::once(DVec3::ZERO).chain(near).map(lamp).collect()
}

/// The sources of light of a place.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PlaceLamps {
    scene: LampLights,
    path: LampLights,
}

impl PlaceLamps {
    /// Those of a scene, and of its path where it states no lamps.
    pub fn of(scene: &Scene, survey: &Survey) -> Self {
        let metres_per_unit = survey.metres_per_unit.value;
        let windows = scene.metadata.windows.as_deref().unwrap_or_default();
        let lights = |lamps: &[Lamp]| LampLights::of(lamps, windows, metres_per_unit);
        let own = scene.metadata.lamps.as_deref();
        let path = match own {
            Some(lamps) => lights(lamps),
            None => lights(&lamps_along_photos(scene, survey)),
        };
        Self { scene: lights(own.unwrap_or_default()), path }
    }

    /// Those that a weather asks for.
    pub fn get(&self, source: LampSource) -> &LampLights {
        match source {
            LampSource::Scene => &self.scene,
            LampSource::Path => &self.path,
        }
    }

    /// The light of the ground under them.
    pub fn levels(&self, site: &Site) -> LampLevels {
        let level = |lights: &LampLights| lights.level(site.up, site.ground, site.metres_per_unit);
        LampLevels { scene: level(&self.scene), path: level(&self.path) }
    }
}
