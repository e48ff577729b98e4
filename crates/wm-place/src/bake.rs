//! Scenes with what lies on them, for other programs.

use crate::place::PreparedPlace;
use crate::{Progress, Renderer, Result};
use wm_scene::{Metadata, Scene};
use wm_weather::Weather;

/// A scene with what lies on it.
#[derive(Clone, Debug)]
pub struct BakedScene {
    /// The scene, which any program can render.
    pub scene: Scene,
    /// The number of its splats that lie on the place; they are the last.
    pub added: usize,
}

impl Renderer {
    /// Bakes what lies under an instant of a weather, and its light, into the scene of a place, as
    /// splats. `None` if the weather lays nothing and leaves the light as it is. The air and what
    /// falls are not splats, and stay out.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] if the splats of the place were released.
    pub fn bake(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<BakedScene>> {
        let lying = self.lying_cover(place, weather, time, progress)?;
        let relit = self.relit_splats(place, weather, time, progress)?;
        if lying.is_none() && relit.is_none() {
            return Ok(None);
        }
        let (scene, survey) = (place.scene(), place.survey());
        let metadata = Metadata {
            metres_per_unit: Some(survey.metres_per_unit.value),
            up: Some(survey.up.value),
            ground: Some(survey.ground.value),
            ..scene.metadata.clone()
        };
        let lit = relit.as_ref().unwrap_or(&scene.splats);
        let added = lying.as_ref().map_or(0, |lying| lying.splats.len());
        let splats = lying.map_or_else(|| lit.clone(), |lying| lying.bake(lit));
        let scene = Scene { splats, views: scene.views.clone(), metadata, ..Scene::default() };
        Ok(Some(BakedScene { scene, added }))
    }
}
