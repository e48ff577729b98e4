//! Answers about a place in a weather without a picture: lying snow, the light, the water.

use super::prepared::PreparedPlace;
use crate::assets::{AssetKey, AssetNeeds, MissingAssets, lock};
use crate::view::{ViewOptions, ViewSearch};
use crate::{Error, Progress, Renderer, Result};
use std::sync::{Arc, Mutex};
use wm_scene::Splats;
use wm_weather::Weather;
use wm_weather::cover::{Cover, LyingCover};
use wm_weather::light::CaptureLight;
use wm_weather::wetness::WaterState;

impl Renderer {
    /// Returns the snow or dust that lies on the place at one instant; `None` if the weather lays
    /// nothing.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub fn lying_cover(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<LyingCover>> {
        let backend = self.backend_of(place)?;
        let prepared = place.prepare_weather(weather, time);
        if let Some(paper) = &prepared.paper_cover {
            let snow = backend.pool().install(|| paper.snow(&place.scene.splats, &place.site));
            return Ok(Some(LyingCover::on_top(snow)));
        }
        let requests = prepared.cover();
        let airflow = AssetNeeds::of(weather, &place.site).cover;
        let Some(airflow) = airflow.filter(|_| !requests.is_empty()) else { return Ok(None) };
        let missing = MissingAssets::of([AssetKey::Cover(airflow)], &place.store);
        place.prepare(backend, missing, progress)?;
        let cover = place.store.take_up::<Mutex<Cover>>(airflow);
        Ok(cover.map(|cover| backend.pool().install(|| lock(&cover).lay_all(requests))))
    }

    /// Returns the splats of a place in the light of an instant of a weather; `None` where that
    /// does not change it.
    pub(crate) fn relit_splats(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<Splats>> {
        let backend = self.backend_of(place)?;
        let prepared = place.prepare_weather(weather, time);
        if prepared.light().is_none() && prepared.wetness().is_none() {
            return Ok(None);
        }
        let missing = place.missing_assets(weather, time);
        let missing = missing.only(|key| !matches!(key, AssetKey::Lying(_)));
        place.prepare(backend, missing, progress)?;
        // The light of the photos says more of the site.
        let prepared = place.prepare_weather(weather, time);
        place.relight(&prepared, backend.pool());
        place.water.find(&prepared, &mut place.store, &place.site, backend.pool());
        let relit = place.light.gains(&prepared).map(|gains| gains.applied(&place.scene.splats));
        let Some(wet) = place.water.gains(&prepared, None) else { return Ok(relit) };
        let mut splats = relit.unwrap_or_else(|| place.scene.splats.clone());
        wet.apply(&mut splats);
        Ok(Some(splats))
    }

    /// Returns the light in which a place was captured, split into sun and sky; finds it first if
    /// it is not known, which takes seconds.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub fn capture_light(
        &mut self,
        place: &mut PreparedPlace,
        progress: &mut dyn Progress,
    ) -> Result<Arc<CaptureLight>> {
        let backend = self.backend_of(place)?;
        let missing = MissingAssets::of([AssetKey::Light(())], &place.store);
        place.prepare(backend, missing, progress)?;
        place.store.take_up(()).ok_or_else(|| Error::Unsupported("the light was not found".into()))
    }

    /// Returns the water on the ground of a place at an instant of a weather, `None` where nothing
    /// is wet; what it needs of the place is made first, which takes seconds.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub fn water_state(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<WaterState>> {
        let backend = self.backend_of(place)?;
        let missing = place
            .missing_assets(weather, time)
            .only(|key| matches!(key, AssetKey::Light(()) | AssetKey::Wet(()) | AssetKey::Shelter(_)));
        place.prepare(backend, missing, progress)?;
        let prepared = place.prepare_weather(weather, time);
        place.water.find(&prepared, &mut place.store, &place.site, backend.pool());
        Ok(place.water.state())
    }

    /// A place to look for cameras in.
    pub fn view_search<'a>(&'a mut self, place: &'a PreparedPlace, options: ViewOptions) -> ViewSearch<'a> {
        let renderer = self.backend_mut();
        ViewSearch { renderer, set: place.set, scene: &place.scene, survey: &place.survey, options }
    }
}
