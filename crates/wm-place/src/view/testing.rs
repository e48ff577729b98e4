//! Helpers of the tests of cameras.

use super::{ViewOptions, ViewSearch};
use glam::DVec3;
use wm_render::{CpuConfig, CpuRenderer, RenderBackend, SetId};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::survey::{CapturedSky, Confidence, FactSource, Sourced, SunnySide, Survey, label_sky};
use wm_scene::synthetic::{self, Builder};
use wm_scene::testing::data;
use wm_scene::{Camera, Metadata, Scene, SceneView};

/// A place with z up, the ground at 0, 10 units in radius.
pub(crate) fn survey() -> Survey {
    fn known<T>(value: T) -> Sourced<T> {
        Sourced { value, source: FactSource::Given, confidence: Confidence::Sure }
    }
    Survey {
        origin: DVec3::ZERO,
        up: known(DVec3::Z),
        up_source: None,
        up_estimate: None,
        north: None,
        north_source: None,
        sun: None,
        sun_fault: None,
        sun_elevation: None,
        ground: known(0.0),
        metres_per_unit: known(1.0),
        scale_source: None,
        airlight: known([0.8; 3]),
        white_card: None,
        sunny_side: SunnySide::NONE,
        captured_sky: CapturedSky::Unknown,
        location: None,
        captured: None,
        center: DVec3::new(0.0, 0.0, 2.0),
        radius: 10.0,
        extent: [20.0, 15.0, 8.0],
        sky_splats: 0,
    }
}

/// Views of these names at x = 0, 1, 2, ... that look along y.
pub(crate) fn views(names: &[&str]) -> Vec<SceneView> {
    let camera = |x: f64| {
        let eye = DVec3::new(x, 0.0, 1.6);
        Camera::looking((300, 200), 60.0, eye, eye + DVec3::Y, DVec3::Z).unwrap()
    };
    names
        .iter()
        .enumerate()
        .map(|(i, name)| SceneView { name: (*name).into(), camera: camera(i as f64) })
        .collect()
}

/// A real scene by its file's name; `None`, said on stderr, where the data is not there.
pub(crate) fn real(name: &str) -> Option<Scene> {
    let path = data(&format!("scenes/{name}.ply"))?;
    Some(read_scene(&path, &ReadOptions::default()).unwrap())
}

/// A made-up place: `street`, `street-sky`, `table`, `rooms` or `village`.
pub(crate) fn place(name: &str) -> Scene {
    let mut place = match name {
        "table" => synthetic::table(1),
        "village" => synthetic::aerial(1),
        "rooms" => rooms(),
        _ => synthetic::street(1),
    };
    if name.ends_with("-sky") {
        place.sky(DVec3::ZERO, 400.0, 8000);
    }
    Scene { splats: place.build(), ..Scene::default() }
}

/// A flat of 24 by 18 m and 3 m high, in two rooms with a table each.
fn rooms() -> Builder {
    let mut flat = Builder::new(1);
    let (long, wide, high) = (DVec3::X * 24.0, DVec3::Y * 18.0, DVec3::Z * 3.0);
    let corner = DVec3::new(-12.0, -9.0, 0.0);
    let tiles = |u: f64, v: f64| [if ((12.0 * u) as i32 + (9.0 * v) as i32) % 2 == 0 { 0.5 } else { 0.3 }; 3];
    let panels = |u: f64, _: f64| [if (10.0 * u) as i32 % 2 == 0 { 0.7 } else { 0.4 }; 3];
    flat.surface(corner, long, wide, 0.2, tiles);
    flat.surface(corner + high, long, wide, 0.2, |_, _| [0.8; 3]);
    for (from, along) in [(corner, long), (corner + wide, long), (corner, wide), (corner + long, wide)] {
        flat.surface(from, along, high, 0.2, panels);
    }
    // A wall with a wide opening between the rooms.
    flat.surface(corner + 0.5 * long, 0.55 * wide, high, 0.2, panels);
    for x in [-6.0, 6.0] {
        flat.surface(DVec3::new(x - 1.0, -4.0, 0.8), DVec3::X * 2.0, DVec3::Y, 0.1, |_, _| [0.3, 0.2, 0.1]);
    }
    flat
}

/// A scene that is ready to be looked at.
pub(crate) struct LoadedScene {
    pub(crate) renderer: CpuRenderer,
    pub(crate) set: SetId,
    pub(crate) scene: Scene,
    pub(crate) survey: Survey,
}

impl LoadedScene {
    /// Labels the sky, surveys and loads; renders on `threads` threads.
    pub(crate) fn new(mut scene: Scene, threads: Option<usize>) -> Self {
        label_sky(&mut scene.splats);
        let survey = Survey::of(&scene, &Metadata::default());
        let mut renderer = CpuRenderer::new(CpuConfig { threads, ..CpuConfig::default() }).unwrap();
        let set = renderer.load(&scene.splats).unwrap();
        Self { renderer, set, scene, survey }
    }

    pub(crate) fn site(&mut self, options: ViewOptions) -> ViewSearch<'_> {
        let Self { renderer, set, scene, survey } = self;
        ViewSearch { renderer, set: *set, scene, survey, options }
    }
}
