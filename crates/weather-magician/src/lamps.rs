//! The lamps of a place: those that its scene states, or those on its posts, or a row along the path of its photos.

use glam::DVec3;
use std::f64::consts::TAU;
use wm_scene::lamps::along_path;
use wm_scene::posts::{Post, find_posts};
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

/// Most posts that get a lamp: those that are nearest to the middle of the place.
const MOST_POSTS: usize = 16;

/// Returns a lamp at the head of each post of a scene, shining down: the higher, the brighter, with the flux of a lamp of
/// [`lamps_along_photos`] at its height.
#[must_use]
pub fn lamps_on_posts(scene: &Scene, survey: &Survey) -> Vec<Lamp> {
    let mut posts = find_posts(&scene.splats, survey);
    posts.sort_by(|a, b| {
        let [a, b] = [a, b].map(|post| post.head.distance_squared(survey.center));
        a.total_cmp(&b)
    });
    posts.truncate(MOST_POSTS);
    let lamp = |post: &Post| Lamp {
        aim: Some((-survey.up.value).to_array()),
        lumens: Lamp::default_lumens() * post.height / HEIGHT,
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

/// The sources of light of a place.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PlaceLamps {
    scene: LampLights,
    path: LampLights,
    origin: LampOrigin,
}

impl PlaceLamps {
    /// Lists the lamps that a scene states. Where it states none, its posts carry lamps, and where it has no posts a row stands along
    /// the path of its photos.
    pub fn of(scene: &Scene, survey: &Survey) -> Self {
        let metres_per_unit = survey.metres_per_unit.value;
        let windows = scene.metadata.windows.as_deref().unwrap_or_default();
        let lights = |lamps: &[Lamp]| LampLights::of(lamps, windows, metres_per_unit);
        let own = scene.metadata.lamps.as_deref();
        let (path, origin) = match own {
            Some(lamps) => (lights(lamps), LampOrigin::Stated),
            None => match lamps_on_posts(scene, survey) {
                row if row.is_empty() => (lights(&lamps_along_photos(scene, survey)), LampOrigin::Row),
                posts => (lights(&posts), LampOrigin::Posts(posts.len())),
            },
        };
        Self { scene: lights(own.unwrap_or_default()), path, origin }
    }

    /// Returns a warning that the lamps are guessed; `None` if the scene states them.
    pub fn doubt(&self) -> Option<String> {
        let what = match self.origin {
            LampOrigin::Stated => return None,
            LampOrigin::Posts(count) => format!("{count} posts of the capture are taken for lampposts"),
            LampOrigin::Row => {
                "no lamppost was found, and a row of lamps is assumed along the path of the photos".into()
            }
        };
        Some(format!("the scene states no lamps: {what}; set them with `align --lamp`, or light.lamps = off"))
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
