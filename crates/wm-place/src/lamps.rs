//! The lamps of a place: those that its scene states, or those on its posts, or a row along the
//! path of its photos.

use glam::DVec3;
use std::f64::consts::TAU;
use std::sync::OnceLock;
use wm_scene::lamps::along_path;
use wm_scene::posts::{Post, find_posts};
use wm_scene::survey::Survey;
use wm_scene::{Lamp, Scene};
use wm_weather::dome::level_axes;
use wm_weather::light::LampLights;
use wm_weather::{LampSource, Site};

/// Distance between lamps along a path, m.
pub(crate) const PATH_LAMP_SPACING_M: f64 = 25.0;
/// Distance of a row of lamps from the path, m.
pub(crate) const PATH_LAMP_OFFSET_M: f64 = 3.0;
/// Height of such lamps above the ground, m.
pub(crate) const PATH_LAMP_HEIGHT_M: f64 = 6.0;

/// Returns a row of lamps beside the path of a scene's photos, each shining down:
/// [`PATH_LAMP_SPACING_M`] apart, [`PATH_LAMP_OFFSET_M`] to the right of it and
/// [`PATH_LAMP_HEIGHT_M`] above the ground. Without photos they are one lamp in the middle of the
/// place and six around it.
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
    let [spacing, aside, height] = [PATH_LAMP_SPACING_M, PATH_LAMP_OFFSET_M, PATH_LAMP_HEIGHT_M]
        .map(|metres| metres / survey.metres_per_unit.value);
    if !centers.is_empty() {
        return along_path(&centers, up, ground, spacing, aside, height);
    }
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

/// Most posts that get a lamp: those that are nearest to the middle of the place.
const MAX_LAMP_POSTS: usize = 16;

/// Returns a lamp at the head of each post of a scene, shining down: the higher, the brighter, with
/// the flux of a lamp of [`lamps_along_photos`] at its height.
#[must_use]
pub fn lamps_on_posts(scene: &Scene, survey: &Survey) -> Vec<Lamp> {
    let mut posts = find_posts(&scene.splats, survey);
    posts.sort_by(|a, b| {
        let [a, b] = [a, b].map(|post| post.head.distance_squared(survey.center));
        a.total_cmp(&b)
    });
    posts.truncate(MAX_LAMP_POSTS);
    let lamp = |post: &Post| Lamp {
        aim: Some((-survey.up.value).to_array()),
        lumens: Lamp::default_lumens() * post.height / PATH_LAMP_HEIGHT_M,
        ..Lamp::new(post.head.to_array())
    };
    posts.iter().map(lamp).collect()
}

/// The origin of the lamps of weathers with `light.lamps = "path"`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum LampOrigin {
    /// The scene states them.
    #[default]
    Stated,
    /// So many posts are taken for lampposts.
    Posts(usize),
    /// A row along the path of the photos.
    Row,
}

/// The lamps of weathers with `light.lamps = "path"`.
#[derive(Debug, Default)]
struct PathLamps {
    lights: LampLights,
    origin: LampOrigin,
    /// Illuminance of the ground under them, lx.
    level: f64,
}

/// The sources of light of a place.
#[derive(Debug, Default)]
pub(crate) struct PlaceLamps {
    scene: LampLights,
    /// Found when a weather first asks for them, since all splats are looked at.
    path: OnceLock<PathLamps>,
}

impl PlaceLamps {
    /// Lists the lamps that a scene states.
    pub(crate) fn of(scene: &Scene, survey: &Survey) -> Self {
        let stated = scene.metadata.lamps.as_deref().unwrap_or_default();
        Self { scene: lights_of(stated, scene, survey), path: OnceLock::new() }
    }

    /// Finds the lamps of weathers with `light.lamps = "path"`: where the scene states none, its
    /// posts carry lamps, and where it has no posts a row stands along the path of its photos.
    /// Returns the illuminance of the ground under them, lx.
    pub(crate) fn find_path(&self, scene: &Scene, survey: &Survey, site: &Site) -> f64 {
        let find = || {
            let (lights, origin) = match scene.metadata.lamps {
                Some(_) => (self.scene.clone(), LampOrigin::Stated),
                None => match lamps_on_posts(scene, survey) {
                    row if row.is_empty() => {
                        (lights_of(&lamps_along_photos(scene, survey), scene, survey), LampOrigin::Row)
                    }
                    posts => (lights_of(&posts, scene, survey), LampOrigin::Posts(posts.len())),
                },
            };
            PathLamps { level: level_under(&lights, site), lights, origin }
        };
        self.path.get_or_init(find).level
    }

    /// Returns a warning that the lamps are guessed; `None` if the scene states them.
    pub(crate) fn doubt(&self) -> Option<String> {
        let what = match self.path.get()?.origin {
            LampOrigin::Stated => return None,
            LampOrigin::Posts(count) => format!("{count} posts of the capture are taken for lampposts"),
            LampOrigin::Row => {
                "no lamppost was found, and a row of lamps is assumed along the path of the photos".into()
            }
        };
        Some(format!("the scene states no lamps: {what}; set them with `align --lamp`, or light.lamps = off"))
    }

    /// The lamps that a weather asks for; `None` if there are none, or if they are those of the
    /// path and were not looked for.
    pub(crate) fn get(&self, source: LampSource) -> Option<&LampLights> {
        let lights = match source {
            LampSource::Scene => &self.scene,
            LampSource::Path => &self.path.get()?.lights,
        };
        Some(lights).filter(|lights| !lights.is_empty())
    }

    /// Illuminance of the ground under the lamps that the scene states, lx.
    pub(crate) fn level(&self, site: &Site) -> f64 {
        level_under(&self.scene, site)
    }
}

/// Returns lamps, and the lit windows of a scene, as sources of light.
fn lights_of(lamps: &[Lamp], scene: &Scene, survey: &Survey) -> LampLights {
    let windows = scene.metadata.windows.as_deref().unwrap_or_default();
    LampLights::of(lamps, windows, survey.metres_per_unit.value)
}

/// Returns the illuminance of the ground under lamps, lx.
fn level_under(lights: &LampLights, site: &Site) -> f64 {
    lights.level(site.up, site.ground, site.metres_per_unit)
}
