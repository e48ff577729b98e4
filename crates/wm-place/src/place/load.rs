//! Scenes become places in a renderer, get other facts by hand, and leave it again.

use super::levels::PlaceLevels;
use super::prepared::{PlaceFacts, PlaceOptions, PreparedPlace, doubts, site_of};
use crate::assets::{AssetCache, AssetStore, scene_digest};
use crate::lamps::PlaceLamps;
use crate::levels::LevelBudget;
use crate::place_light::PlaceLight;
use crate::place_water::PlaceWater;
use crate::{Error, Renderer, Result};
use std::path::Path;
use std::sync::Arc;
use wm_render::{AnyRenderer, Background, RenderBackend};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::levels::LevelIndex;
use wm_scene::splats::LabelKind;
use wm_scene::survey::{Aligned, Alignment, FactSource, Survey, align, label_sky};
use wm_scene::{Lamp, LitWindow, Metadata, Scene, Severity};

impl Renderer {
    /// Loads a scene: labels its sky, surveys it (up, ground, scale, light) and uploads its splats.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the splats cannot be held; repair scenes with NaN first
    /// ([`Scene::repaired`]).
    pub fn load(&mut self, scene: Scene) -> Result<PreparedPlace> {
        self.load_with(scene, &PlaceOptions::default())
    }

    /// Loads a scene with facts of your own, and with a folder that keeps prepared assets.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn load_with(&mut self, mut scene: Scene, options: &PlaceOptions) -> Result<PreparedPlace> {
        label_sky(&mut scene.splats);
        let reading = std::mem::take(&mut scene.remarks).into_iter();
        let reading = reading.filter(|remark| remark.severity == Severity::Doubt).map(|remark| remark.text);
        let survey = Survey::of(&scene, &options.facts);
        let (renderer, backend) = (self.id(), self.backend_mut());
        let set = backend.load(&scene.splats)?;
        let lamps = PlaceLamps::of(&scene, &survey);
        let site = site_of(&survey, &lamps);
        let own = || scene_digest(&scene, &survey, &backend.arithmetic());
        let digest = options.assets.as_ref().map(|_| options.asset_digest.unwrap_or_else(own));
        let scene_rasterization = scene.metadata.rasterization.unwrap_or_default();
        let mut place = PreparedPlace {
            renderer,
            set,
            levels: None,
            scene_number: 0,
            labels: LabelKind::ALL.map(|kind| scene.splats.names(kind).into()),
            scene: Arc::new(scene),
            given: options.facts.clone(),
            site,
            background: Background::default(),
            rasterization: scene_rasterization,
            assets: options.assets.clone(),
            given_digest: options.asset_digest,
            cache: AssetCache::new(options.assets.clone(), digest.unwrap_or_default()),
            store: AssetStore::default(),
            lying: None,
            thinned: None,
            light: PlaceLight::new(lamps),
            water: PlaceWater::default(),
            near_ground: None,
            last_ground: None,
            is_released: false,
            warnings: reading.chain(survey.warning()).collect(),
            doubts: doubts(&survey),
            ground_doubt: survey.ground_warning(),
            survey,
        };
        place.background = place.auto_background();
        Ok(place)
    }

    /// Opens a scene in levels of detail: surveys it at one level, and draws it under a budget, so
    /// that it may be larger than the memory. Each frame draws a cut of the levels that depends on
    /// its camera and the budget alone; [`PreparedPlace::set_shot`] fixes one for many frames. With
    /// `repairs`, files that cannot be read are drawn at a coarser level or left out, with a
    /// warning.
    ///
    /// # Errors
    /// As [`Self::load`]; [`crate::Error::Format`] if a file cannot be read.
    pub fn load_levels(
        &mut self,
        index: LevelIndex,
        options: &PlaceOptions,
        budget: &LevelBudget,
        repairs: bool,
    ) -> Result<PreparedPlace> {
        let (mut levels, scene) = PlaceLevels::open(self.backend_mut(), index, budget, repairs)?;
        let mut place = self.load_with(scene, options)?;
        levels.captured_sky = place.survey.captured_sky;
        place.levels = Some(Box::new(levels));
        Ok(place)
    }

    /// Opens the scene at a path: in levels of detail if it has them and its finest level does not
    /// fit the budget, else as a whole.
    ///
    /// # Errors
    /// As [`Self::load_levels`]; [`crate::Error::Unsupported`] if a splat has a number that is not
    /// finite.
    pub fn open(
        &mut self,
        path: &Path,
        options: &PlaceOptions,
        budget: &LevelBudget,
    ) -> Result<PreparedPlace> {
        if let Some(index) = budget.levels_of(path)? {
            return self.load_levels(index, options, budget, false);
        }
        let scene = read_scene(path, &ReadOptions::default())?;
        if let Err(found) = scene.check_finite() {
            let says =
                format!("{}: {found}; `weather-magician convert --repair` leaves them out", path.display());
            return Err(Error::Unsupported(says));
        }
        self.load_with(scene, options)
    }

    /// Sets facts of a place by hand: up, the ground, the scale. The next frame has them; assets of
    /// the old facts are not used any more. [`PreparedPlace::facts`] has the metadata to write.
    /// About half a second for 850,000 splats.
    ///
    /// # Errors
    /// [`crate::Error::Align`] if a value cannot be used, and the place is as it was then;
    /// [`crate::Error::Unsupported`] after [`PreparedPlace::release_splats`].
    pub fn align(&mut self, place: &mut PreparedPlace, by: &Alignment) -> Result<Aligned> {
        let backend = self.backend_of(place)?;
        place.check_splats()?;
        let mut metadata = place.given.clone().or(place.scene.metadata.clone());
        // A height that was given is that in the world.
        metadata.ground = place.given.ground.map(|_| place.survey.ground.value).or(metadata.ground);
        if place.given.ground.is_none() && place.survey.ground.source != FactSource::File {
            // It is along another up than the given one.
            (metadata.ground, metadata.ground_confidence) = (None, None);
        }
        let scene = Arc::make_mut(&mut place.scene);
        let before = std::mem::replace(&mut scene.metadata, metadata);
        let aligned = match align(scene, by) {
            Ok(aligned) => aligned,
            Err(error) => {
                scene.metadata = before;
                return Err(error.into());
            }
        };
        place.given = Metadata::default();
        place.renew(backend, aligned.after.clone());
        Ok(aligned)
    }

    /// Replaces the facts of a place, such as by those that [`PreparedPlace::facts`] returned
    /// before. Assets of the old facts are not used any more, nor those that are still being made.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] after [`PreparedPlace::release_splats`].
    pub fn set_facts(&mut self, place: &mut PreparedPlace, facts: PlaceFacts) -> Result<()> {
        let backend = self.backend_of(place)?;
        place.check_splats()?;
        Arc::make_mut(&mut place.scene).metadata = facts.scene;
        place.given = facts.given;
        let survey = Survey::of(&place.scene, &place.given);
        place.renew(backend, survey);
        Ok(())
    }

    /// Sets the lamps and lit windows of a place, instead of those that its scene states. The next
    /// frame has them; the other assets of the place stay.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] with the first fault of a lamp or a window; the place has
    /// those of before then.
    pub fn set_lamps(
        &mut self,
        place: &mut PreparedPlace,
        lamps: Vec<Lamp>,
        windows: Vec<LitWindow>,
    ) -> Result<()> {
        self.backend_of(place)?;
        let metadata =
            Metadata { lamps: Some(lamps), windows: Some(windows), ..place.scene.metadata.clone() };
        if let Some(fault) = metadata.fault() {
            return Err(Error::Unsupported(fault));
        }
        Arc::make_mut(&mut place.scene).metadata = metadata;
        let lamps = PlaceLamps::of(&place.scene, &place.survey);
        place.site = site_of(&place.survey, &lamps);
        place.light.set_lamps(lamps);
        Ok(())
    }

    /// Frees a place's memory in the renderer.
    ///
    /// # Errors
    /// [`crate::Error::OtherRenderer`] if another renderer holds it.
    pub fn unload(&mut self, mut place: PreparedPlace) -> Result<()> {
        let backend = self.backend_of(&place)?;
        place.clear_cover(backend);
        if let Some(thin) = place.thinned.take() {
            backend.unload(thin.set);
        }
        backend.unload(place.set);
        if let Some(levels) = &mut place.levels {
            levels.clear(backend);
        }
        Ok(())
    }
}

impl PreparedPlace {
    /// Takes a survey of other facts, and forgets what was made along the old ones.
    fn renew(&mut self, backend: &mut AnyRenderer, survey: Survey) {
        self.clear_cover(backend);
        let has_own_background = self.background != self.auto_background();
        self.given_digest = None;
        let digest = self.assets.as_ref().map(|_| scene_digest(&self.scene, &survey, &backend.arithmetic()));
        self.cache = AssetCache::new(self.assets.clone(), digest.unwrap_or_default());
        self.store = AssetStore::default();
        // Assets that are being made with the old facts are not taken.
        self.scene_number += 1;
        let lamps = PlaceLamps::of(&self.scene, &survey);
        self.site = site_of(&survey, &lamps);
        self.light = PlaceLight::new(lamps);
        self.water = PlaceWater::default();
        self.doubts = doubts(&survey);
        self.ground_doubt = survey.ground_warning();
        (self.near_ground, self.last_ground) = (None, None);
        self.survey = survey;
        if let Some(levels) = &mut self.levels {
            levels.captured_sky = self.survey.captured_sky;
        }
        if !has_own_background {
            self.background = self.auto_background();
        }
    }
}
