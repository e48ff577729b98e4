//! A scene that a renderer holds, and what weather knows of it.

use super::levels::PlaceLevels;
use crate::assets::{AssetCache, AssetDigest, AssetKey, AssetStore, LyingKey};
use crate::lamps::PlaceLamps;
use crate::place_light::{CoverLight, PlaceLight};
use crate::place_water::PlaceWater;
use crate::thinned::ThinnedSet;
use crate::{Error, Renderer, Result};
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;
use wm_render::{AnyRenderer, Background, Outputs, RenderConfig, SetId, SkyGradient};
use wm_scene::splats::LabelKind;
use wm_scene::survey::{FactSource, NearGround, Survey};
use wm_scene::{Metadata, Rasterization, Scene};
use wm_weather::cover::Buried;
use wm_weather::{Daylight, EarthPlace, LampLevels, PreparedWeather, Site, SiteLight, Weather, light_fault};

/// Options of [`crate::Renderer::load_with`].
#[derive(Clone, Debug, Default)]
pub struct PlaceOptions {
    /// Facts that win over those of the scene: scale, up, ground.
    pub facts: Metadata,
    /// The folder for prepared assets, see [`AssetCache::folder_of`]; `None` keeps none.
    pub assets: Option<PathBuf>,
    /// The digest under which files of assets are looked up and written, in place of that of the
    /// scene as this renderer has it: for assets that another renderer made, whose arithmetic
    /// differs. It holds until facts of the place change.
    pub asset_digest: Option<AssetDigest>,
}

/// The facts that a place was surveyed with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlaceFacts {
    /// The metadata of the scene.
    pub scene: Metadata,
    /// Facts that win over those of the scene.
    pub given: Metadata,
}

/// A scene in a renderer: its splats, what is known of the place, and what its weathers need.
pub struct PreparedPlace {
    /// The renderer that holds the splats.
    pub(crate) renderer: u64,
    pub(super) set: SetId,
    pub(super) scene: Arc<Scene>,
    /// The levels of detail that frames draw instead of the set.
    pub(super) levels: Option<Box<PlaceLevels>>,
    /// Counts the scenes that the weather was prepared with: assets of another one are not taken.
    pub(super) scene_number: u64,
    /// Facts that win over those of the scene.
    pub(super) given: Metadata,
    pub(super) survey: Survey,
    pub(super) site: Site,
    /// The background of frames. [`Self::auto_background`] is the usual one.
    pub background: Background,
    /// The rasterization of frames; that of the scene until it is changed.
    pub rasterization: Rasterization,
    /// Labels and instances of the splats, which stay when splats are released.
    pub(super) labels: [Arc<[u16]>; 2],
    /// The folder for prepared assets, if they are kept.
    pub(super) assets: Option<PathBuf>,
    /// The digest of the assets as it was given.
    pub(super) given_digest: Option<AssetDigest>,
    pub(super) cache: AssetCache,
    pub(super) store: AssetStore,
    pub(super) lying: Option<LoadedCover>,
    /// The scene with few splats, if a weather with drops on the lens, wet ground or a flood was
    /// drawn.
    pub(super) thinned: Option<ThinnedSet>,
    pub(super) light: PlaceLight,
    pub(super) water: PlaceWater,
    /// The ground under any camera, once a flood asked for it.
    pub(super) near_ground: Option<NearGround>,
    /// The ground under the last camera that a flood asked for: its eye, and the height over the
    /// site's ground, m, where there is any.
    pub(super) last_ground: Option<(DVec3, Option<f64>)>,
    /// True once the splats in the computer's memory are freed.
    pub(super) is_released: bool,
    pub(super) warnings: Vec<String>,
    /// Doubts about facts that are told when a weather first stands on them.
    pub(super) doubts: Vec<String>,
    /// The doubt about the ground, told when something first lies.
    pub(super) ground_doubt: Option<String>,
}

/// The snow or dust that the renderer holds.
pub(super) struct LoadedCover {
    /// On what, and what.
    pub what: LyingKey,
    pub set: SetId,
    pub buried: Buried,
    pub light: CoverLight,
    /// Depths, as [`LyingCover::settled`](wm_weather::cover::LyingCover::settled) lists them, m.
    pub depths: Vec<Vec<f32>>,
}

impl LoadedCover {
    /// Returns true if a weather lays something of this kind. In a draft it may be of another depth
    /// or place than the weather asks for.
    pub fn is_of(&self, prepared: &PreparedWeather) -> bool {
        match &self.what {
            LyingKey::Paper(_) => prepared.paper_cover.is_some(),
            LyingKey::Physical(..) => prepared.paper_cover.is_none() && !prepared.cover().is_empty(),
        }
    }
}

impl PreparedPlace {
    /// The scene. Its splats are there until [`Self::release_splats`].
    #[must_use]
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The facts known about the place, each with its source.
    #[must_use]
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// The facts that weather uses. Their light of lamps is that of the lamps that the scene
    /// states.
    #[must_use]
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// Prepares an instant of a weather, with the lamps that it asks for.
    pub(super) fn prepare_weather(&self, weather: &Weather, time: f64) -> PreparedWeather {
        let sample = weather.at(time);
        if !sample.asks_for_guessed_lamps() {
            return sample.prepare(&self.site);
        }
        let path = self.light.lamps.find_path(&self.scene, &self.survey, &self.site);
        sample.prepare(&Site { lamps: LampLevels { path, ..self.site.lamps }, ..self.site })
    }

    /// The facts that the place was surveyed with, for [`crate::Renderer::set_facts`].
    #[must_use]
    pub fn facts(&self) -> PlaceFacts {
        PlaceFacts { scene: self.scene.metadata.clone(), given: self.given.clone() }
    }

    /// The digest under which files of prepared assets are looked up now; `None` if none are kept.
    ///
    /// For a place in levels it is that of the splats about the present camera, of which others are
    /// derived for cameras elsewhere.
    #[must_use]
    pub fn asset_digest(&self) -> Option<AssetDigest> {
        self.cache.digest()
    }

    /// The label or the instance of each splat; empty if the scene has none.
    #[must_use]
    pub fn labels(&self, kind: LabelKind) -> &[u16] {
        &self.labels[kind as usize]
    }

    /// The splats in the renderer.
    #[must_use]
    pub fn set(&self) -> SetId {
        self.set
    }

    /// Returns an error if the splats, of which facts are found, were released.
    pub(super) fn check_splats(&self) -> Result<()> {
        if self.is_released {
            return Err(Error::Unsupported("the splats were released: facts cannot change any more".into()));
        }
        Ok(())
    }

    /// The configuration of a pass with some outputs.
    pub(super) fn config(&self, outputs: Outputs) -> RenderConfig {
        RenderConfig { outputs, background: self.background, rasterization: self.rasterization }
    }

    /// Takes the warnings that came up since the last call, one line each.
    pub fn take_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// Frees the splats in the computer's memory: the renderer has its own. Afterwards only
    /// weathers that the place is prepared for can be rendered.
    pub fn release_splats(&mut self) {
        if self.store.has(&AssetKey::Light(())) {
            self.light.keep_points(&self.scene.splats);
        }
        let scene = Scene {
            views: self.scene.views.clone(),
            metadata: self.scene.metadata.clone(),
            ..Scene::default()
        };
        self.scene = Arc::new(scene);
        self.is_released = true;
    }

    /// Returns the background that suits the splats: none if the scene has a sky, else a plain sky.
    #[must_use]
    pub fn auto_background(&self) -> Background {
        if self.survey.sky_splats > 0 {
            return Background::default();
        }
        Background::Sky(self.plain_sky())
    }

    /// A plain daylight sky over the place.
    #[must_use]
    pub fn plain_sky(&self) -> SkyGradient {
        SkyGradient::daylight(self.survey.up.value.to_array().map(|v| v as f32))
    }

    /// Checks that the light of a weather can be.
    pub(super) fn check_light(&self, weather: &Weather) -> Result<()> {
        light_fault(weather, &self.site).map_or(Ok(()), |fault| Err(Error::Unsupported(fault)))
    }
}

/// Returns the facts of a surveyed place that weather uses.
pub(super) fn site_of(survey: &Survey, lamps: &PlaceLamps) -> Site {
    let site = Site {
        origin: survey.origin.to_array(),
        metres_per_unit: survey.metres_per_unit.value,
        up: survey.up.value.to_array(),
        ground: survey.ground.value,
        airlight: survey.airlight.value,
        white_card: survey.white_card,
        daylight: match survey.airlight.source {
            FactSource::Estimated | FactSource::Assumed if survey.sky_splats == 0 => Daylight::Guessed,
            _ => Daylight::Known,
        },
        captured_sky: survey.captured_sky,
        sunny_side: survey.sunny_side,
        earth: survey.north.zip(survey.location).map(|(north, location)| EarthPlace {
            north: north.to_array(),
            location,
            captured: survey.captured,
        }),
        lamps: LampLevels::default(),
        light: SiteLight::Captured,
        far: 3.0 * survey.radius.max(1e-6) * survey.metres_per_unit.value,
    };
    let level = lamps.level(&site);
    Site { lamps: LampLevels { scene: level, path: level }, ..site }
}

/// The doubts about the facts that what falls and what lies stand on.
pub(super) fn doubts(survey: &Survey) -> Vec<String> {
    survey.up_warning().into_iter().chain(survey.likely_facts()).collect()
}

/// Fails if `place` was loaded by another renderer.
pub(crate) fn check_owner(place: &PreparedPlace, renderer: u64) -> Result<()> {
    if place.renderer == renderer { Ok(()) } else { Err(Error::OtherRenderer) }
}

impl Renderer {
    /// Returns the back end that holds the splats of a place; fails if another renderer has them.
    pub(super) fn backend_of(&mut self, place: &PreparedPlace) -> Result<&mut AnyRenderer> {
        check_owner(place, self.id())?;
        Ok(self.backend_mut())
    }
}
