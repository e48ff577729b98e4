//! The cases of a scene in turns, each on the scene with the cover or the light of its weather.

use super::measure::{BenchCase, BenchTarget, FrameTimings, turns};
use crate::progress::Reporter;
use crate::scene::{OpenScene, RunArgs};
use anyhow::{Context, Result};
use glam::DVec3;
use weather_magician::{Camera, PlaceOptions, PreparedPlace, Renderer, Scene};
use wm_render::{RenderBackend, RenderConfig, SetId, SetView};
use wm_scene::Lamp;
use wm_weather::Site;
use wm_weather::cover::Buried;

/// A scene and its cover, in a renderer of its own.
struct SnowyScene {
    renderer: Renderer,
    /// The splat sets of the scene and its cover.
    sets: [SetId; 2],
    buried: Buried,
}

impl SnowyScene {
    fn new(loaded: &mut OpenScene, case: &BenchCase, run: &RunArgs) -> Result<Self> {
        let OpenScene { renderer, place } = loaded;
        let lying = renderer.lying_cover(place, &case.weather, 0.0, &mut Reporter::default())?;
        let lying = lying.with_context(|| format!("the case {} has no cover", case.name))?;
        let mut renderer = run.renderer()?;
        let backend = renderer.backend_mut();
        let sets = [backend.load(&place.scene().splats)?, backend.load(&lying.splats)?];
        Ok(Self { renderer, sets, buried: lying.buried })
    }
}

/// A second copy of the scene, with lamps in view and its light split into sun and sky.
struct LitScene {
    renderer: Renderer,
    place: PreparedPlace,
}

impl LitScene {
    fn new(loaded: &OpenScene, camera: &Camera, cases: &[&BenchCase], run: &RunArgs) -> Result<Self> {
        let scene = Scene::clone(loaded.place.scene());
        let mut renderer = run.renderer()?;
        let facts = loaded.place.survey().metadata();
        let mut place =
            renderer.load_with(scene, &PlaceOptions { facts, assets: None, ..PlaceOptions::default() })?;
        place.background = loaded.place.background;
        place.rasterization = loaded.place.rasterization;
        renderer.set_lamps(&mut place, lamps(camera, loaded.place.site()), Vec::new())?;
        for case in cases {
            renderer.prepare(&mut place, &case.weather, &mut Reporter::default())?;
        }
        Ok(Self { renderer, place })
    }
}

/// Ten lamps in two rows along the view, 2 m above the camera.
fn lamps(camera: &Camera, site: &Site) -> Vec<Lamp> {
    const DISTANCES_AHEAD_M: [f64; 5] = [6.0, 10.0, 15.0, 22.0, 30.0];
    let metre = 1.0 / site.metres_per_unit;
    let up = DVec3::from_array(site.up);
    let forward = camera.forward().reject_from(up).try_normalize().unwrap_or(up.any_orthonormal_vector());
    let right = forward.cross(up);
    let at = |ahead: f64, aside: f64| camera.center() + (forward * ahead + right * aside + up * 2.0) * metre;
    let row = |aside: f64| DISTANCES_AHEAD_M.map(|ahead| Lamp::new(at(ahead, aside).to_array()));
    [row(-3.0), row(3.0)].concat()
}

/// Returns the cases of a scene.
pub(super) fn cases(loaded: &OpenScene) -> Result<Vec<BenchCase>> {
    let PreparedPlace { background, rasterization, .. } = loaded.place;
    BenchCase::all(loaded.place.site(), |outputs| RenderConfig { outputs, background, rasterization })
}

/// Renders cases in turns, each on the scene with the cover of its weather.
pub(super) fn in_turns(
    loaded: &mut OpenScene,
    camera: &Camera,
    cases: &[BenchCase],
    run: &RunArgs,
    rounds: u32,
) -> Result<Vec<FrameTimings>> {
    // The first target is the bare scene, the second, if there is one, is lit by the weather.
    let lit: Vec<&BenchCase> = cases.iter().filter(|case| case.needs_place()).collect();
    let mut lit = if lit.is_empty() { None } else { Some(LitScene::new(loaded, camera, &lit, run)?) };
    let mut snowy = Vec::new();
    let mut plan: Vec<(usize, &BenchCase)> = Vec::new();
    for case in cases {
        let is_bare = case.cover().is_empty() && case.paper_cover().is_none();
        if !is_bare {
            snowy.push(SnowyScene::new(loaded, case, run)?);
        }
        plan.push(match (case.needs_place(), is_bare) {
            (true, _) => (1, case),
            (false, true) => (0, case),
            (false, false) => (usize::from(lit.is_some()) + snowy.len(), case),
        });
    }
    let mut stands = vec![BenchTarget::plain(&mut loaded.renderer, loaded.place.set())];
    if let Some(LitScene { renderer, place }) = &mut lit {
        stands.push(BenchTarget::Place { renderer, place });
    }
    for SnowyScene { renderer, sets: [scene, snow], buried } in &mut snowy {
        let scene = SetView::plain(*scene).with_attributes(Some(buried));
        stands.push(BenchTarget::Sets { renderer, sets: vec![scene, SetView::plain(*snow)] });
    }
    turns(&mut stands, camera, &plan, rounds, "rounds")
}
