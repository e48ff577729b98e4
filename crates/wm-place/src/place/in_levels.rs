//! Places in levels of detail: what frames draw of them, and what their weather is prepared with.

#[cfg(test)]
mod tests;

use super::levels::{DrawnSet, LevelCounts, PlaceLevels, Shot};
use super::prepared::PreparedPlace;
use crate::assets::{AssetCache, AssetNeeds, AssetStore, scene_digest};
use crate::lamps::PlaceLamps;
use crate::levels::WeatherFocus;
use crate::place_light::PlaceLight;
use crate::place_water::PlaceWater;
use crate::{CameraMotion, Patience, Renderer, Result};
use std::path::PathBuf;
use std::sync::Arc;
use wm_render::{AnyRenderer, RenderBackend};
use wm_scene::splats::LabelKind;
use wm_scene::{Camera, Scene};
use wm_weather::Weather;

/// Places of a sensor on its way, less one.
const WAY_STOPS: u32 = 32;

impl Renderer {
    /// Takes the splats about a camera for those that a weather is prepared with, of a place in
    /// levels of detail: [`Self::render`] does so itself. Assets that are being made on another
    /// thread are of the splats of before then: [`Self::insert_assets`] leaves them out.
    ///
    /// # Errors
    /// [`crate::Error::Format`] if a file cannot be read.
    pub fn focus(&mut self, place: &mut PreparedPlace, weather: &Weather, camera: &Camera) -> Result<()> {
        let backend = self.backend_of(place)?;
        place.focus(backend, weather, camera)
    }

    /// Takes the splats along a sensor's way for the weather's, of a place in levels of detail.
    pub(crate) fn focus_along(&mut self, place: &mut PreparedPlace, motion: &CameraMotion) -> Result<()> {
        let backend = self.backend_of(place)?;
        if place.levels.is_none() {
            return Ok(());
        }
        let at = |stop: u32| motion.camera(motion.duration() * f64::from(stop) / f64::from(WAY_STOPS));
        let cameras: Vec<Camera> = (0..=WAY_STOPS).map(at).collect();
        place.focus_on(backend, place.focus_of_all(&cameras))
    }
}

impl PreparedPlace {
    /// Returns true if the place is drawn in levels of detail.
    #[must_use]
    pub fn has_levels(&self) -> bool {
        self.levels.is_some()
    }

    /// The number of its splats, of a place in levels those of the finest.
    #[must_use]
    pub fn splats(&self) -> u64 {
        let always =
            |levels: &PlaceLevels| levels.environment.as_ref().map_or(0, |(splats, _)| splats.len() as u64);
        match &self.levels {
            Some(levels) => levels.stream.index.count_of_level(0) + always(levels),
            None => self.scene.splats.len() as u64,
        }
    }

    /// Draws all frames from one cut of the levels, the best for these cameras together, so that
    /// nothing changes its level between them; without cameras each frame has a cut of its own
    /// again. Other places stay as they are.
    pub fn set_shot(&mut self, cameras: &[Camera]) {
        let Some(levels) = &mut self.levels else { return };
        if levels.shot.as_ref().map_or(&[][..], |shot| &shot.cameras) == cameras {
            return;
        }
        levels.shot = (!cameras.is_empty())
            .then(|| Shot { cameras: cameras.to_vec(), focus: WeatherFocus::along(cameras) });
        (levels.camera, levels.shot_cut) = (None, None);
    }

    /// Returns true if all frames are drawn from one cut of the levels.
    #[must_use]
    pub fn has_shot(&self) -> bool {
        self.levels.as_ref().is_some_and(|levels| levels.shot.is_some())
    }

    /// The splats of the last picture of a place in levels; `None` of other places.
    #[must_use]
    pub fn level_counts(&self) -> Option<LevelCounts> {
        let levels = self.levels.as_ref()?;
        let counts = levels.drawn.iter().filter_map(|(id, part)| {
            let held = levels.stream.get(*id)?.means.len();
            Some((part.count(held) as u64, held as u64))
        });
        Some(counts.fold(LevelCounts::default(), |sum, (drawn, held)| LevelCounts {
            drawn: sum.drawn + drawn,
            held: sum.held + held,
        }))
    }

    /// Returns true if the last picture lacks files that have to be fetched, as in a browser; it
    /// was drawn with coarser levels. Those of other places lack none.
    #[must_use]
    pub fn waits_for_files(&self) -> bool {
        self.levels.as_ref().is_some_and(|levels| levels.weather_waits || levels.stream.waits)
    }

    /// The fetched files of a place in levels that the last picture did not need, those longest ago
    /// first: they may be dropped, and are wanted again by pictures that need them.
    #[must_use]
    pub fn spare_files(&self) -> Vec<PathBuf> {
        self.levels.as_ref().map_or_else(Vec::new, |levels| levels.stream.spare_files())
    }

    /// Makes the renderer hold what a camera sees of the levels.
    pub(super) fn look(
        &mut self,
        backend: &mut AnyRenderer,
        camera: &Camera,
        patience: Patience,
    ) -> Result<()> {
        let Some(levels) = &mut self.levels else { return Ok(()) };
        levels.cut_for(backend, camera, patience)?;
        self.warnings.extend(levels.stream.take_warnings());
        Ok(())
    }

    /// Returns true if no splats have to be read before a camera's pictures of a weather can be
    /// prepared, as [`crate::Renderer::focus`] does.
    #[must_use]
    pub fn is_focused(&self, weather: &Weather, camera: &Camera) -> bool {
        let Some(levels) = &self.levels else { return true };
        !AssetNeeds::of(weather, &self.site).any(weather)
            || levels.focus == Some(self.focus_for(levels, camera))
    }

    fn focus_for(&self, levels: &PlaceLevels, camera: &Camera) -> WeatherFocus {
        match &levels.shot {
            Some(shot) => shot.focus,
            None => WeatherFocus::cell_of(camera, self.survey.up.value, self.site.metres_per_unit),
        }
    }

    /// Takes the splats about a camera, or along its shot, for the weather's, if the weather needs
    /// any.
    pub(crate) fn focus(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        camera: &Camera,
    ) -> Result<()> {
        if let Some(levels) = &mut self.levels {
            levels.weather_waits = false;
        }
        match &self.levels {
            Some(levels) if !self.is_focused(weather, camera) => {
                self.focus_on(backend, self.focus_for(levels, camera))
            }
            _ => Ok(()),
        }
    }

    /// The focus for all of some cameras: in one cell they share what is prepared with the other
    /// cameras of that cell.
    fn focus_of_all(&self, cameras: &[Camera]) -> WeatherFocus {
        let (up, metres) = (self.survey.up.value, self.site.metres_per_unit);
        let mut cells = cameras.iter().map(|camera| WeatherFocus::cell_of(camera, up, metres));
        match cells.next() {
            Some(first) if cells.all(|cell| cell == first) => first,
            _ => WeatherFocus::along(cameras),
        }
    }

    /// Takes the splats along the shot for the weather's; returns false if there is no shot, or if
    /// files have to be fetched first.
    pub(super) fn focus_on_shot(&mut self, backend: &mut AnyRenderer) -> Result<bool> {
        let shot = self.levels.as_ref().and_then(|levels| levels.shot.as_ref());
        let Some(Shot { focus, .. }) = shot else { return Ok(false) };
        let focus = *focus;
        self.focus_on(backend, focus)?;
        Ok(self.levels.as_ref().is_some_and(|levels| levels.focus == Some(focus)))
    }

    /// Takes the splats about a place for the weather's.
    fn focus_on(&mut self, backend: &mut AnyRenderer, focus: WeatherFocus) -> Result<()> {
        let metres = self.site.metres_per_unit;
        let Some(levels) = &mut self.levels else { return Ok(()) };
        if levels.focus == Some(focus) {
            return Ok(());
        }
        let Some(splats) = levels.weather_scene(&focus, metres)? else { return Ok(()) };
        let captured_sky = levels.captured_sky;
        let set = backend.load(&splats)?;
        self.survey.captured_sky = captured_sky;
        self.site.captured_sky = captured_sky;
        self.scene_number += 1;
        (self.near_ground, self.last_ground) = (None, None);
        self.clear_cover(backend);
        if let Some(thin) = self.thinned.take() {
            backend.unload(thin.set);
        }
        backend.unload(std::mem::replace(&mut self.set, set));
        let scene = Scene { splats, metadata: self.scene.metadata.clone(), ..Scene::default() };
        let digest = self.assets.as_ref().map(|_| match self.given_digest {
            Some(given) => given.about(&focus.path, scene.splats.len()),
            None => scene_digest(&scene, &self.survey, &backend.arithmetic()),
        });
        self.cache = AssetCache::new(self.assets.clone(), digest.unwrap_or_default());
        self.store = AssetStore::default();
        self.light = PlaceLight::new(PlaceLamps::of(&scene, &self.survey));
        self.water = PlaceWater::default();
        self.labels = LabelKind::ALL.map(|kind| scene.splats.names(kind).into());
        self.scene = Arc::new(scene);
        self.is_released = false;
        Ok(())
    }

    /// The line along which cameras are, where the place is in levels and the weather is prepared
    /// about them.
    pub(super) fn weather_path(&self) -> Option<[[f64; 3]; 2]> {
        Some(self.levels.as_ref()?.focus?.path)
    }

    /// The sets that a frame draws: `scene` itself, or those of the last cut.
    pub(super) fn drawn_sets(&mut self, backend: &AnyRenderer, is_changed: bool) -> Option<Vec<DrawnSet>> {
        Some(self.levels.as_mut()?.sets(backend.pool(), is_changed))
    }
}
