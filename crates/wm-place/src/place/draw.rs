//! Pinhole pictures of a place.

use super::attributes::{SceneAttributes, chosen_attributes, shown_attributes, shown_views, with_cover};
use super::prepared::{LoadedCover, PreparedPlace};
use super::surface::flood_follows_camera;
use crate::assets::{AssetNeeds, AssetStore, LyingKey};
use crate::frame::FrameInputs;
use crate::picture::Picture;
use crate::place_water::{OnGround, PlaceWater};
use crate::shot::{MovingCamera, Patience, PinholeContent, PinholeShot};
use crate::thinned::{ChosenAttributes, ThinnedSet, thin};
use crate::{Error, Progress, Result};
use std::sync::Arc;
use wm_render::hooks::SplatAttributes;
use wm_render::{AnyRenderer, Pictures, RenderBackend, SetId, SetView, Stats};
use wm_scene::Camera;
use wm_weather::light::LampsOn;
use wm_weather::shelter::Shelter;
use wm_weather::water::WaterGrid;
use wm_weather::{PreparedWeather, Site, Weather};

impl PreparedPlace {
    /// Draws a pinhole picture of an instant; in a browser it lets the page work while a GPU draws.
    pub(crate) async fn draw(
        &mut self,
        backend: &mut AnyRenderer,
        memory: &mut Pictures,
        shot: &PinholeShot<'_>,
        picture: &mut Picture,
        progress: &mut dyn Progress,
    ) -> Result<Stats> {
        let PinholeShot { weather, time, camera: MovingCamera { camera, .. }, .. } = shot;
        let time = *time;
        camera.check()?;
        self.check_light(weather)?;
        if flood_follows_camera(weather) && self.near_ground.is_none() {
            self.check_splats()?;
        }
        let mut patience = shot.patience;
        if patience == Patience::Whole {
            self.focus(backend, weather, camera)?;
            // What is made of splats elsewhere is of no use once those here are fetched.
            if !self.is_focused(weather, camera) {
                patience = Patience::Draft;
            }
        }
        self.look(backend, shot.whole.as_ref().unwrap_or(camera), shot.patience)?;
        let mut prepared = self.prepared_at(weather, time, camera);
        // Before assets are made and kept.
        if !prepared.falling.is_empty() {
            shot.camera.check_speed()?;
        }
        if let Some(glass) = prepared.glass() {
            glass.check(camera).map_err(Error::Unsupported)?;
        }
        if patience == Patience::Whole {
            let missing = self.lacking(weather, &prepared);
            if !missing.is_empty() {
                self.prepare(backend, missing, progress)?;
                // The light of the photos says more of the site.
                prepared = self.prepared_at(weather, time, camera);
            }
        }
        self.check_water(weather, &prepared, camera)?;
        if prepared.glass().is_some() || prepared.wetness().is_some() || prepared.flood().is_some() {
            self.make_thinned(backend)?;
        }
        let wants_weather = self.levels.is_some() && AssetNeeds::of(weather, &self.site).any(weather);
        let drawn = self.drawn_sets(backend, wants_weather);
        let shelter = prepared.fall().and_then(|fall| match patience {
            Patience::Whole => self.store.take_up::<Shelter>(fall),
            Patience::Draft => self.store.take_up::<Shelter>(fall).or_else(|| self.store.last()),
        });
        self.relight(&prepared, backend.pool());
        let moving = prepared.moving_light(camera);
        let light = self.light.gains(&prepared).map(|gains| gains.in_frame(moving.as_ref()));
        self.water.find(&prepared, &mut self.store, &self.site, backend.pool());
        let lying = self.lying.as_ref().filter(|lying| lying.is_of(&prepared));
        let puddles = find_puddles(&mut self.water, &mut self.store, lying, &prepared, &self.site);
        let wet = self.water.gains(&prepared, Some(camera));
        let splashes = self.water.splash_ground(&prepared, &self.site);
        let scene = SceneAttributes { buried: lying.map(|lying| &lying.buried), light, wet: wet.as_ref() };
        let lying_light = lying.filter(|_| light.is_some()).and_then(|lying| lying.light.gains());
        let lying_light = lying_light.map(|gains| gains.in_frame(moving.as_ref()));
        let lying_light = lying_light.as_ref().map(|light| light as &dyn SplatAttributes);
        let chosen = drawn.as_deref().map(|drawn| chosen_attributes(drawn, &scene));
        let whole = [(self.set, &scene as &dyn SplatAttributes)];
        let parts: Vec<(SetId, &dyn SplatAttributes)> = match (&drawn, &chosen) {
            (Some(drawn), Some(chosen)) => {
                drawn.iter().zip(chosen).map(|(part, own)| (part.set, own as &dyn SplatAttributes)).collect()
            }
            _ => whole.to_vec(),
        };
        // Of a place in levels all that is held, for views from elsewhere, such as that of a
        // mirror.
        let mut held = with_cover(&parts, scene.is_changed(), lying.map(|lying| (lying.set, lying_light)));
        let windows = self.light.windows(&prepared, &self.scene, &self.site);
        held.extend(windows.as_ref().map(SetView::transient));
        let (own, others) = held.split_at(parts.len());
        let shown = drawn.as_deref().map(|drawn| shown_attributes(drawn, own));
        let sets: Vec<SetView<'_>> = match (&drawn, &shown) {
            (Some(drawn), Some(shown)) => {
                shown_views(drawn, own, shown).chain(others.iter().copied()).collect()
            }
            _ => held.clone(),
        };
        let thinned_attributes =
            self.thinned.as_ref().map(|thin| ChosenAttributes { all: &scene, chosen: &thin.chosen });
        let thinned_sets =
            self.thinned.as_ref().zip(thinned_attributes.as_ref()).map(|(thin, attributes)| {
                let own = scene.is_changed().then_some(attributes as &dyn SplatAttributes);
                let thin = SetView::plain(thin.set).with_attributes(own);
                std::iter::once(thin).chain(others.iter().copied()).collect::<Vec<_>>()
            });
        let sources = self.light.sources(&prepared, &self.store, moving.as_ref(), &self.site);
        let lamps = sources.as_ref().map(|(lights, display)| LampsOn { lights, display: *display });
        let (config, pool) = (self.config(shot.outputs), Arc::clone(backend.pool()));
        let inputs = FrameInputs {
            lamps: lamps.as_ref(),
            puddles: puddles.as_ref(),
            splashes: splashes.as_ref(),
            pool: Some(&pool),
            sets: &sets,
            thinned: thinned_sets.as_deref(),
            elsewhere: &held,
            weather: &prepared,
            camera: shot.camera,
            whole: shot.whole,
            shelter: shelter.as_deref(),
            config: &config,
            parts: shot.parts,
            stages: shot.stages,
        };
        picture.metres_per_unit = self.site.metres_per_unit;
        Ok(match shot.content {
            PinholeContent::Picture => inputs.draw_async(backend, memory, picture).await?,
            PinholeContent::Geometry => inputs.draw_geometry_async(backend, memory, picture).await?,
            PinholeContent::Particles => {
                picture.falling = inputs.particles(backend.path());
                Stats::default()
            }
        })
    }

    /// Prepares an instant of a weather for a camera.
    fn prepared_at(&mut self, weather: &Weather, time: f64, camera: &Camera) -> PreparedWeather {
        let mut prepared = self.prepare_weather(weather, time);
        if prepared.flood().is_some_and(|flood| flood.ground.is_none()) {
            prepared.stand_flood_on(self.ground_under(camera).unwrap_or(0.0));
        }
        prepared
    }

    /// Makes a scene of fewer splats for blurred views (through drops on the lens, mirrored in
    /// films of water and waves), unless it is made or the splats are no longer here.
    pub(super) fn make_thinned(&mut self, backend: &mut AnyRenderer) -> Result<()> {
        if self.thinned.is_none() && !self.is_released {
            let (splats, chosen) =
                thin(&self.scene.splats, self.survey.center.to_array(), self.survey.radius);
            self.thinned = Some(ThinnedSet { set: backend.load(&splats)?, chosen });
        }
        Ok(())
    }

    /// Finds the gains of the light, if it changes and the capture's is known.
    pub(super) fn relight(&mut self, prepared: &PreparedWeather, pool: &rayon::ThreadPool) {
        let lying = self
            .lying
            .as_mut()
            .filter(|lying| matches!(lying.what, LyingKey::Physical(..)) && lying.is_of(prepared));
        let lying = lying.map(|lying| &mut lying.light);
        self.warnings.extend(self.light.relight(
            prepared,
            &self.store,
            &self.scene.splats,
            lying,
            &self.site,
            pool,
        ));
        self.warnings.extend(self.light.doubt_of_lamps(prepared));
    }
}

/// Finds the surface of the water on the ground: not where snow or dust lies on it.
fn find_puddles(
    water: &mut PlaceWater,
    store: &mut AssetStore,
    lying: Option<&LoadedCover>,
    prepared: &PreparedWeather,
    site: &Site,
) -> Option<Arc<WaterGrid>> {
    let lying = lying.and_then(|lying| {
        let LyingKey::Physical(airflow, requests) = &lying.what else { return None };
        Some(OnGround { requests, cover: store.take_up(*airflow)?, depths: &lying.depths })
    });
    // What is to lie and does not yet would be under the water.
    if lying.is_none() && !prepared.cover().is_empty() {
        return None;
    }
    water.puddles(prepared, lying.as_ref(), site)
}
