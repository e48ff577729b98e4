//! A scene that a renderer holds, and what weather knows of it.

mod levels;

use crate::assets::{
    AnyAsset, AssetCache, AssetDigest, AssetKey, AssetNeeds, AssetSource, AssetStore, Assets, Keep, LyingKey,
    MissingAssets, SurfaceViews, ViewDetail, WithoutSky, lock, photo_views, scene_digest, uses_thinned,
};
use crate::frame::FrameInputs;
use crate::lamps::PlaceLamps;
use crate::levels::{DrawnAttributes, DrawnPart};
use crate::picture::Picture;
use crate::place_light::{CoverLight, PlaceLight};
use crate::place_water::{OnGround, PlaceWater};
use crate::thinned::{ChosenAttributes, ThinnedSet, thin};
use crate::view;
use crate::{Error, MovingCamera, Patience, Progress, Result};
use glam::DVec3;
pub use levels::LevelCounts;
use levels::{DrawnSet, PlaceLevels};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use wm_render::hooks::{AttributeBlock, Revision, SplatAttributes};
use wm_render::parts::PicturePart;
use wm_render::{
    AnyRenderer, Background, DrawPass, Frame, MedianDepth, Outputs, Pictures, RenderBackend, RenderConfig,
    SetId, SetView, SkyGradient, Stats,
};
use wm_scene::splats::LabelKind;
use wm_scene::survey::{Aligned, Alignment, CapturedSky, FactSource, NearGround, Survey, align, label_sky};
use wm_scene::{Camera, Lamp, LitWindow, Metadata, Rasterization, Scene, Severity, Splats};
use wm_weather::cover::{Buried, Cover, LyingCover};
use wm_weather::light::{CaptureLight, FrameGains, KnownSun, LampShadows, LampsOn};
use wm_weather::shelter::Shelter;
use wm_weather::water::WaterGrid;
use wm_weather::wetness::{WaterState, WetGains};
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

/// The passes of a pinhole picture that are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum PinholeContent {
    /// The whole picture.
    #[default]
    Picture,
    /// Coverage, expected and median depth alone, whatever outputs are set: of the scene, of what
    /// lies on it and of water. There is no air, nothing falls, and the colours are those of no
    /// weather.
    Geometry,
    /// No picture: the falling particles that it would show.
    Particles,
}

/// A pinhole picture of one instant: the unit that frames of all cameras consist of.
#[derive(Clone, Copy)]
pub(crate) struct PinholeShot<'a> {
    pub weather: &'a Weather,
    /// s.
    pub time: f64,
    pub camera: MovingCamera,
    /// The camera of the whole picture, where the camera shows a part of it: large splats are drawn
    /// as they are there.
    pub whole: Option<Camera>,
    pub outputs: Outputs,
    /// Parts of the picture that are rendered with it.
    pub parts: &'a [PicturePart],
    /// Keep the steps of the paper's rain and snow.
    pub stages: bool,
    pub patience: Patience,
    pub content: PinholeContent,
}

/// A scene in a renderer: its splats, what is known of the place, and what its weathers need.
pub struct PreparedPlace {
    /// The renderer that holds the splats.
    pub(crate) renderer: u64,
    set: SetId,
    scene: Arc<Scene>,
    /// The levels of detail that frames draw instead of the set.
    levels: Option<Box<PlaceLevels>>,
    /// Counts the scenes that the weather was prepared with: assets of another one are not taken.
    scene_number: u64,
    /// Facts that win over those of the scene.
    given: Metadata,
    survey: Survey,
    site: Site,
    /// The background of frames. [`Self::auto_background`] is the usual one.
    pub background: Background,
    /// The rasterization of frames; that of the scene until it is changed.
    pub rasterization: Rasterization,
    /// Labels and instances of the splats, which stay when splats are released.
    labels: [Arc<[u16]>; 2],
    /// The folder for prepared assets, if they are kept.
    assets: Option<PathBuf>,
    /// The digest of the assets as it was given.
    given_digest: Option<AssetDigest>,
    cache: AssetCache,
    store: AssetStore,
    lying: Option<Lying>,
    /// The scene with few splats, if a weather with drops on the lens, wet ground or a flood was
    /// drawn.
    thinned: Option<ThinnedSet>,
    light: PlaceLight,
    water: PlaceWater,
    /// The ground under any camera, once a flood asked for it.
    near_ground: Option<NearGround>,
    /// The ground under the last camera that a flood asked for: its eye, and the height over the
    /// site's ground, m, where there is any.
    last_ground: Option<(DVec3, Option<f64>)>,
    /// True once the splats in the computer's memory are freed.
    is_released: bool,
    warnings: Vec<String>,
    /// Doubts about facts that are told when a weather first stands on them.
    doubts: Vec<String>,
    /// The doubt about the ground, told when something first lies.
    ground_doubt: Option<String>,
}

/// The snow or dust that the renderer holds.
struct Lying {
    /// On what, and what.
    what: LyingKey,
    set: SetId,
    buried: Buried,
    light: CoverLight,
    /// Depths, as [`LyingCover::settled`] lists them, m.
    depths: Vec<Vec<f32>>,
}

impl Lying {
    /// Returns true if a weather lays something of this kind. In a draft it may be of another depth
    /// or place than the weather asks for.
    fn is_of(&self, prepared: &PreparedWeather) -> bool {
        match &self.what {
            LyingKey::Paper(_) => prepared.paper_cover().is_some(),
            LyingKey::Physical(..) => prepared.paper_cover().is_none() && !prepared.cover().is_empty(),
        }
    }
}

/// The attributes of the splats of a scene under a weather.
#[derive(Clone, Copy, Default)]
pub(crate) struct SceneAttributes<'a> {
    /// The splats under what lies.
    pub buried: Option<&'a Buried>,
    /// The change of the light.
    pub light: Option<FrameGains<'a>>,
    /// The darkening of what is wet.
    pub wet: Option<&'a WetGains<'a>>,
}

impl SceneAttributes<'_> {
    /// Returns true if they change how any splat is drawn.
    pub fn is_changed(&self) -> bool {
        self.buried.is_some() || self.changes_light()
    }
}

impl SplatAttributes for SceneAttributes<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(buried) = self.buried {
            buried.fill(indices, block);
        }
        if let Some(light) = self.light {
            light.fill(indices, block);
        }
    }

    fn changes_visibility(&self) -> bool {
        self.buried.is_some() || self.light.is_some_and(|light| light.changes_visibility())
    }

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        if let Some(light) = self.light {
            light.fill_light(indices, block);
        }
        if let Some(wet) = self.wet {
            wet.fill_light(indices, block);
        }
    }

    fn changes_light(&self) -> bool {
        self.light.is_some() || self.wet.is_some()
    }

    fn revision(&self) -> Option<Revision> {
        if self.wet.is_some() {
            return None;
        }
        let buried = self.buried.map_or(Some(Revision::default()), SplatAttributes::revision)?;
        let light = self.light.map_or(Some(Revision::default()), |light| light.revision())?;
        Some(buried.and(light))
    }
}

/// The sets of a scene with their attributes, if there `is_changed` anything, and what lies on it.
pub(crate) fn with_cover<'a>(
    scene: &[(SetId, &'a dyn SplatAttributes)],
    is_changed: bool,
    lying: Option<(SetId, Option<&'a dyn SplatAttributes>)>,
) -> Vec<SetView<'a>> {
    let own = |(set, attributes): &(SetId, &'a dyn SplatAttributes)| {
        SetView::plain(*set).with_attributes(is_changed.then_some(*attributes))
    };
    let lying = lying.map(|(set, light)| SetView::plain(set).with_attributes(light));
    scene.iter().map(own).chain(lying).collect()
}

/// The attributes of the sets of a cut, by those of the weather's splats.
fn chosen_attributes<'a>(drawn: &'a [DrawnSet], scene: &'a SceneAttributes<'a>) -> Vec<ChosenAttributes<'a>> {
    drawn.iter().map(|part| ChosenAttributes { all: scene, chosen: &part.chosen }).collect()
}

/// The attributes of the sets of a cut of which a part is shown; `views` are the sets as a whole.
fn shown_attributes<'a>(drawn: &'a [DrawnSet], views: &[SetView<'a>]) -> Vec<Option<DrawnAttributes<'a>>> {
    drawn.iter().zip(views).map(|(set, view)| set.part.attributes(view.attributes)).collect()
}

/// The parts of the sets of a cut that are shown.
fn shown_views<'a>(
    drawn: &[DrawnSet],
    views: &[SetView<'a>],
    shown: &'a [Option<DrawnAttributes<'a>>],
) -> impl Iterator<Item = SetView<'a>> {
    let sets = drawn.iter().zip(views).zip(shown).filter(|((set, _), _)| set.part != DrawnPart::None);
    sets.map(|((_, view), shown)| match shown {
        Some(shown) => view.with_attributes(Some(shown)),
        None => *view,
    })
}

/// The doubts about the facts that what falls and what lies stand on.
fn doubts(survey: &Survey) -> Vec<String> {
    survey.up_warning().into_iter().chain(survey.likely_facts()).collect()
}

impl PreparedPlace {
    /// Labels the sky, surveys the scene and loads its splats.
    pub(crate) fn load(
        backend: &mut AnyRenderer,
        renderer: u64,
        mut scene: Scene,
        options: &PlaceOptions,
    ) -> Result<Self> {
        label_sky(&mut scene.splats);
        let reading = std::mem::take(&mut scene.remarks).into_iter();
        let reading = reading.filter(|remark| remark.severity == Severity::Doubt).map(|remark| remark.text);
        let survey = Survey::of(&scene, &options.facts);
        let set = backend.load(&scene.splats)?;
        let lamps = PlaceLamps::of(&scene, &survey);
        let site = site_of(&survey, &lamps);
        let own = || scene_digest(&scene, &survey, &backend.arithmetic());
        let digest = options.assets.as_ref().map(|_| options.asset_digest.unwrap_or_else(own));
        let scene_rasterization = scene.metadata.rasterization.unwrap_or_default();
        let mut place = Self {
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
    fn prepare_weather(&self, weather: &Weather, time: f64) -> PreparedWeather {
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
    /// Of a place in levels it is that of the splats about the present camera, of which others are
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

    /// Sets facts by hand; those that were given become facts of the scene.
    pub(crate) fn align(&mut self, backend: &mut AnyRenderer, by: &Alignment) -> Result<Aligned> {
        self.check_splats()?;
        let mut metadata = self.given.clone().or(self.scene.metadata.clone());
        // A height that was given is that in the world.
        metadata.ground = self.given.ground.map(|_| self.survey.ground.value).or(metadata.ground);
        if self.given.ground.is_none() && self.survey.ground.source != FactSource::File {
            // It is along another up than the given one.
            (metadata.ground, metadata.ground_confidence) = (None, None);
        }
        let scene = Arc::make_mut(&mut self.scene);
        let before = std::mem::replace(&mut scene.metadata, metadata);
        let aligned = match align(scene, by) {
            Ok(aligned) => aligned,
            Err(error) => {
                scene.metadata = before;
                return Err(error.into());
            }
        };
        self.given = Metadata::default();
        self.renew(backend, aligned.after.clone());
        Ok(aligned)
    }

    /// Surveys the place anew with other facts.
    pub(crate) fn set_facts(&mut self, backend: &mut AnyRenderer, facts: PlaceFacts) -> Result<()> {
        self.check_splats()?;
        Arc::make_mut(&mut self.scene).metadata = facts.scene;
        self.given = facts.given;
        let survey = Survey::of(&self.scene, &self.given);
        self.renew(backend, survey);
        Ok(())
    }

    /// Sets the lamps and lit windows; all else of the place stays as it was found.
    pub(crate) fn set_lamps(&mut self, lamps: Vec<Lamp>, windows: Vec<LitWindow>) -> Result<()> {
        let metadata = Metadata { lamps: Some(lamps), windows: Some(windows), ..self.scene.metadata.clone() };
        if let Some(fault) = metadata.fault() {
            return Err(Error::Unsupported(fault));
        }
        Arc::make_mut(&mut self.scene).metadata = metadata;
        let lamps = PlaceLamps::of(&self.scene, &self.survey);
        self.site = site_of(&self.survey, &lamps);
        self.light.set_lamps(lamps);
        Ok(())
    }

    /// Returns an error if the splats, of which facts are found, were released.
    fn check_splats(&self) -> Result<()> {
        if self.is_released {
            return Err(Error::Unsupported("the splats were released: facts cannot change any more".into()));
        }
        Ok(())
    }

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

    /// Returns the point of the nearest surface at the point `(x, y)` (px) of a camera's picture,
    /// world axes; `None` where there is only sky.
    pub(crate) fn surface_at(
        &self,
        backend: &mut AnyRenderer,
        camera: &Camera,
        [x, y]: [f64; 2],
    ) -> Result<Option<DVec3>> {
        self.check_splats()?;
        let is_inside =
            (0.0..=f64::from(camera.width)).contains(&x) && (0.0..=f64::from(camera.height)).contains(&y);
        if !is_inside {
            return Ok(None);
        }
        // A small picture about the point, which is in its middle: a finer one than the camera's,
        // since pixels blur depth where a surface is seen at a low angle.
        let finer = SURFACE_HEIGHT.div_ceil(camera.height.max(1));
        let fine = camera.resized(camera.width * finer, camera.height * finer);
        let (x, y) = (x * f64::from(finer), y * f64::from(finer));
        let reach = fine.height / 45;
        let side = 2 * reach + 1;
        let middle = f64::from(side) / 2.0;
        let part =
            Camera { width: side, height: side, cx: fine.cx - x + middle, cy: fine.cy - y + middle, ..fine };
        let outputs = Outputs { median_depth: MedianDepth::On, ..Outputs::default() };
        let config = self.config(outputs);
        let without_sky = WithoutSky::of(&self.scene);
        let sets = [SetView::plain(self.set).with_attributes(Some(&without_sky))];
        let mut frame = Frame::default();
        backend.render(&DrawPass::new(&sets, &part, &config), &mut frame)?;
        Ok(middle_depth(&frame.median_depth).map(|depth| {
            let ray = fine.ray(x, y);
            camera.center() + ray * (depth / ray.dot(camera.forward()))
        }))
    }

    /// The configuration of a pass with some outputs.
    fn config(&self, outputs: Outputs) -> RenderConfig {
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

    /// The place as [`view`] looks for cameras in it.
    pub(crate) fn view_search<'a>(
        &'a self,
        backend: &'a mut AnyRenderer,
        options: view::ViewOptions,
    ) -> view::ViewSearch<'a> {
        view::ViewSearch {
            renderer: backend,
            set: self.set,
            scene: &self.scene,
            survey: &self.survey,
            options,
        }
    }

    /// The assets that the instant `time` of a weather needs and that are not made yet.
    #[must_use]
    pub fn missing_assets(&self, weather: &Weather, time: f64) -> MissingAssets {
        self.lacking(weather, &self.prepare_weather(weather, time))
    }

    /// The folder of prepared assets; `None` if they are not kept.
    #[must_use]
    pub fn asset_folder(&self) -> Option<&Path> {
        self.cache.folder()
    }

    /// The names of the files of prepared assets that the instant `time` of a weather uses, whether
    /// they are there or not; none if assets are not kept.
    #[must_use]
    pub fn asset_files(&self, weather: &Weather, time: f64) -> Vec<String> {
        let prepared = self.prepare_weather(weather, time);
        let mut keys = self.asset_keys(weather, &prepared, true);
        if !prepared.cover().is_empty() {
            // Snow is laid out on ground that is on disk.
            keys.extend(AssetNeeds::of(weather, &self.site).cover.map(AssetKey::Cover));
        }
        let name = |key: &AssetKey| self.cache.name(&key.file()?);
        let mut names: Vec<String> = keys.iter().filter_map(name).collect();
        names.sort();
        names.dedup();
        names
    }

    /// The assets that an instant of a weather uses, in the order in which they are made. The light
    /// of the capture is among them if the surfaces that get wet are to be found by it.
    fn asset_keys(&self, weather: &Weather, prepared: &PreparedWeather, finds_wet: bool) -> Vec<AssetKey> {
        let needs = AssetNeeds::of(weather, &self.site);
        let wet = prepared.wetness().filter(|_| needs.wetness.is_some());
        let mut keys = Vec::new();
        let change = prepared.light();
        if needs.light && (change.is_some() || wet.is_some() && finds_wet) {
            keys.push(AssetKey::Light(()));
        }
        if let Some(change) = change {
            let capture = self.store.get::<CaptureLight>(());
            let takes_sun = capture.is_none_or(|capture| capture.takes_another_sun(change.is_diffuse));
            keys.extend(change.sun.filter(|_| takes_sun).map(AssetKey::SunShadows));
            let lamps = change.lamps.and_then(|(source, _)| self.light.lamps.get(source));
            keys.extend(lamps.cloned().map(AssetKey::Lamps));
        }
        if let Some(wet) = wet {
            keys.extend([AssetKey::Shelter(wet.rain.fall), AssetKey::Wet(())]);
        }
        keys.extend(prepared.fall().filter(|_| needs.shelter).map(AssetKey::Shelter));
        let requests = prepared.cover();
        let lying = needs.cover.filter(|_| !requests.is_empty());
        let lying = lying.map(|airflow| LyingKey::Physical(airflow, requests.to_vec()));
        let lying = lying.into_iter().chain(needs.paper_cover.map(LyingKey::Paper));
        keys.extend(lying.map(AssetKey::Lying));
        keys
    }

    /// The assets that a prepared instant of a weather needs and that are not made yet.
    fn lacking(&self, weather: &Weather, prepared: &PreparedWeather) -> MissingAssets {
        let keys = self.asset_keys(weather, prepared, !self.store.has(&AssetKey::Wet(())));
        MissingAssets::of(keys.into_iter().filter(|key| !self.is_laid(key)), &self.store)
    }

    /// Returns true for what lies on the place as the renderer holds it.
    fn is_laid(&self, key: &AssetKey) -> bool {
        let AssetKey::Lying(what) = key else { return false };
        self.lying.as_ref().is_some_and(|lying| lying.what == *what)
    }

    /// Returns true if a small picture does without what is missing, since there is something like
    /// it.
    #[must_use]
    pub fn has_similar(&self, missing: &MissingAssets) -> bool {
        missing.asked.iter().all(|key| match key {
            AssetKey::Shelter(_) => self.store.last::<Shelter>().is_some(),
            _ => key.drafts_do_without(),
        })
    }

    /// Takes an asset from disk, or what it is made of, and collects what is not there in `absent`.
    fn read_cached(&mut self, key: &AssetKey, known: &mut AssetStore, absent: &mut Vec<AssetKey>) {
        if self.store.has(key) || known.has(key) || absent.contains(key) {
            return;
        }
        match key.read(&self.cache, self.scene.splats.len()) {
            Some(asset) if key.keep() == Keep::No => known.add(key.clone(), asset),
            Some(asset) => self.take_asset(key.clone(), asset),
            None => {
                absent.push(key.clone());
                for need in key.needs() {
                    self.read_cached(&need, known, absent);
                }
            }
        }
    }

    /// Returns the inputs for `missing`, and removes from it what was found on disk. Renders the
    /// photos' views if surfaces are to be found in them.
    pub(crate) fn asset_source(
        &mut self,
        backend: &mut AnyRenderer,
        missing: &mut MissingAssets,
    ) -> Result<AssetSource> {
        if missing.has_nan() {
            return Err(Error::Unsupported(
                "the weather gives a direction that is not a number (NaN): change its parameters".into(),
            ));
        }
        let (mut known, mut absent) = (AssetStore::default(), Vec::new());
        for key in &missing.asked {
            self.read_cached(key, &mut known, &mut absent);
        }
        *missing = MissingAssets::of(missing.asked.drain(..), &self.store);
        let mut views = SurfaceViews::default();
        if !self.scene.splats.is_empty() {
            let mut seen = |detail| photo_views(backend, self.set, &self.scene, &self.survey, detail);
            if absent.contains(&AssetKey::Occluders(())) {
                views.shelter = seen(ViewDetail::SHELTER)?;
            }
            if absent.contains(&AssetKey::Surfaces(())) {
                views.cover = seen(ViewDetail::COVER)?;
            }
        }
        known.add_all(&self.store);
        Ok(AssetSource {
            scene: Arc::clone(&self.scene),
            views,
            known,
            site: self.site,
            known_sun: KnownSun {
                direction: self.survey.sun.as_ref().map(|sun| sun.direction.to_array()),
                elevation: self.survey.sun_elevation,
            },
            threads: backend.threads(),
            is_up_known: !matches!(self.survey.up.source, FactSource::Estimated | FactSource::Assumed),
            cache: self.cache.clone(),
            path: self.weather_path(),
            scene_number: self.scene_number,
        })
    }

    /// Takes the light of the capture. Shadows tell more than colours whether there were clouds.
    fn take_light(&mut self, light: &CaptureLight) {
        let by_shadows = match (light.is_overcast, self.site.captured_sky) {
            (true, _) => CapturedSky::Overcast,
            (false, CapturedSky::Overcast) if light.sun.is_some() => CapturedSky::Clear,
            (false, CapturedSky::Overcast) => CapturedSky::Burned,
            (false, by_color) => by_color,
        };
        // In both: the site is made from the survey anew when lamps change.
        self.survey.captured_sky = by_shadows;
        self.site.captured_sky = by_shadows;
    }

    /// Takes assets that were made.
    pub(crate) fn insert(&mut self, backend: &mut AnyRenderer, assets: Assets) -> Result<()> {
        if assets.scene_number != self.scene_number {
            return Ok(());
        }
        for (key, asset) in assets.made {
            match key {
                AssetKey::Lying(what) => {
                    if let Some(lying) = asset.downcast().ok().and_then(Arc::into_inner) {
                        self.lay(backend, what, lying)?;
                    }
                }
                key => self.take_asset(key, asset),
            }
        }
        Ok(())
    }

    /// Keeps an asset, and what it says of the place.
    fn take_asset(&mut self, key: AssetKey, asset: AnyAsset) {
        self.warnings.extend(doubts_of_asset(&asset));
        if let Some(light) = asset.downcast_ref::<CaptureLight>() {
            self.take_light(light);
        }
        self.store.add(key, asset);
    }

    /// Loads what lies in the place of what lay before.
    fn lay(&mut self, backend: &mut AnyRenderer, what: LyingKey, lying: LyingCover) -> Result<()> {
        self.clear_cover(backend);
        let set = backend.load(&lying.splats)?;
        let LyingCover { splats, buried, settled, .. } = lying;
        let depths = settled.into_iter().map(|settled| settled.depth).collect();
        self.lying = Some(Lying { what, set, buried, light: CoverLight::of(splats), depths });
        Ok(())
    }

    /// Takes away what lies.
    fn clear_cover(&mut self, backend: &mut AnyRenderer) {
        if let Some(old) = self.lying.take() {
            backend.unload(old.set);
        }
    }

    /// Makes what an instant of a weather needs, and waits for it.
    pub(crate) fn prepare(
        &mut self,
        backend: &mut AnyRenderer,
        mut missing: MissingAssets,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        if missing.is_empty() {
            return Ok(());
        }
        self.warnings.append(&mut self.doubts);
        if missing.asked.iter().any(|key| matches!(key, AssetKey::Cover(_) | AssetKey::Lying(_))) {
            self.warnings.extend(self.ground_doubt.take());
        }
        let source = self.asset_source(backend, &mut missing)?;
        let assets = missing.make(source, progress)?;
        self.insert(backend, assets)
    }

    /// Makes what all instants of a weather may need of the splats, so that they can be released.
    pub(crate) fn prepare_all(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        self.check_light(weather)?;
        // Without a shot each camera has splats of its own, whose assets are made when it is there.
        if self.levels.is_some() && !self.focus_on_shot(backend)? {
            return Ok(());
        }
        if uses_thinned(weather) {
            self.make_thinned(backend)?;
        }
        if flood_follows_camera(weather) {
            self.near_ground();
        }
        let needs = AssetNeeds::of(weather, &self.site);
        self.prepare(backend, self.missing_assets(weather, 0.0), progress)?;
        let mut keys = Vec::new();
        if needs.light {
            keys.push(AssetKey::Light(()));
        }
        if weather.moves_sun() {
            keys.push(AssetKey::Casters(()));
        }
        let lamps = |source| Some(AssetKey::Lamps(self.light.lamps.get(source)?.clone()));
        keys.extend(weather.lamp_sources().into_iter().filter_map(lamps));
        if let Some(fall) = needs.wetness {
            // Ground that is dry at first may get wet later.
            keys.extend([AssetKey::Shelter(fall), AssetKey::Wet(())]);
        }
        keys.extend(needs.cover.map(AssetKey::Cover));
        self.prepare(backend, MissingAssets::of(keys, &self.store), progress)?;
        // A fall that turns, or begins later, needs maps of other directions; those are made
        // without the splats.
        let turns = needs.shelter && !weather.is_constant();
        let occluders = turns.then_some(AssetKey::Occluders(()));
        self.prepare(backend, MissingAssets::of(occluders, &self.store), progress)
    }

    /// Returns the water on the ground at an instant of a weather; `None` where nothing is wet.
    ///
    /// # Errors
    /// As [`crate::Renderer::render`].
    pub(crate) fn water_state(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<WaterState>> {
        let missing = self
            .missing_assets(weather, time)
            .only(|key| matches!(key, AssetKey::Light(()) | AssetKey::Wet(()) | AssetKey::Shelter(_)));
        self.prepare(backend, missing, progress)?;
        let prepared = self.prepare_weather(weather, time);
        self.water.find(&prepared, &mut self.store, &self.site, backend.pool());
        Ok(self.water.state())
    }

    /// Hands what sensors other than cameras need of an instant of a weather to `scan`: the
    /// threads, the weather at the place, the shelter of what falls and the wetness of the splats.
    /// What is missing is made first.
    pub(crate) fn for_sensors<R>(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
        scan: impl FnOnce(&rayon::ThreadPool, &PreparedWeather, Option<&Shelter>, Option<&WetGains<'_>>) -> R,
    ) -> Result<R> {
        // Light is of no use to them, but to tell the surfaces that get wet, which ask for it.
        let missing = self.missing_assets(weather, time);
        let missing = missing.only(|key| matches!(key, AssetKey::Wet(()) | AssetKey::Shelter(_)));
        let prepared = self.prepare_sensors(backend, weather, time, missing, progress)?;
        let shelter = prepared.fall().and_then(|fall| self.store.take_up::<Shelter>(fall));
        self.water.find(&prepared, &mut self.store, &self.site, backend.pool());
        let wet = self.water.wetness(&prepared);
        Ok(scan(backend.pool(), &prepared, shelter.as_deref(), wet.as_ref()))
    }

    /// Hands what radars need of an instant of a weather to `scan`: the threads, the weather at the
    /// place, and the shelter of the rain. What is missing is made first.
    pub(crate) fn for_radars<R>(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
        scan: impl FnOnce(&rayon::ThreadPool, &PreparedWeather, Option<&Shelter>) -> R,
    ) -> Result<R> {
        let rains = self.prepare_weather(weather, time).rain_rate() > 0.0;
        let missing = self.missing_assets(weather, time);
        let missing = missing.only(|key| rains && matches!(key, AssetKey::Shelter(_)));
        let prepared = self.prepare_sensors(backend, weather, time, missing, progress)?;
        let fall = prepared.fall().filter(|_| rains);
        let shelter = fall.and_then(|fall| self.store.take_up::<Shelter>(fall));
        Ok(scan(backend.pool(), &prepared, shelter.as_deref()))
    }

    /// Makes what is missing for sensors other than cameras, and prepares the weather.
    fn prepare_sensors(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        missing: MissingAssets,
        progress: &mut dyn Progress,
    ) -> Result<PreparedWeather> {
        if self.is_released {
            return Err(Error::Unsupported("the splats were released: sensors need them".into()));
        }
        self.prepare(backend, missing, progress)?;
        let prepared = self.prepare_weather(weather, time);
        if prepared.flood().is_some() {
            let fault = "lidars and radars do not see floods yet: leave it out with --set flood=off";
            return Err(Error::Unsupported(fault.into()));
        }
        Ok(prepared)
    }

    /// Thins the scene for what drops on the lens show and films and waves mirror, if that is not
    /// done and the splats are there.
    fn make_thinned(&mut self, backend: &mut AnyRenderer) -> Result<()> {
        if self.thinned.is_none() && !self.is_released {
            let (splats, chosen) =
                thin(&self.scene.splats, self.survey.center.to_array(), self.survey.radius);
            self.thinned = Some(ThinnedSet { set: backend.load(&splats)?, chosen });
        }
        Ok(())
    }

    /// Prepares an instant of a weather for a camera.
    fn prepared_at(&mut self, weather: &Weather, time: f64, camera: &Camera) -> PreparedWeather {
        let mut prepared = self.prepare_weather(weather, time);
        if prepared.flood().is_some_and(|flood| flood.ground.is_none()) {
            prepared.stand_flood_on(self.ground_under(camera).unwrap_or(0.0));
        }
        prepared
    }

    /// The weather of a shot that starts with a camera: what follows the camera by itself is what
    /// it is there. A flood whose `ground` is `auto` stands at one level over the whole shot then.
    #[must_use]
    pub fn weather_of_shot(&mut self, weather: &Weather, camera: &Camera) -> Weather {
        if !flood_follows_camera(weather) {
            return weather.clone();
        }
        let ground = self.ground_under(camera);
        // Without any, and at a height out of range, it stays as it is.
        ground
            .and_then(|ground| weather.clone().set("flood.ground", ground).ok())
            .unwrap_or_else(|| weather.clone())
    }

    /// Height of the ground straight under a camera over the ground of the site, m; `None` where
    /// there is none near by.
    fn ground_under(&mut self, camera: &Camera) -> Option<f64> {
        let eye = camera.center();
        if let Some((_, height)) = self.last_ground.filter(|(known, _)| *known == eye) {
            return height;
        }
        let Site { ground, metres_per_unit, .. } = self.site;
        let height = self.near_ground().height_under(eye, metres_per_unit);
        let height = height.map(|height| (height - ground) * metres_per_unit);
        self.last_ground = Some((eye, height));
        height
    }

    /// Checks that the light of a weather can be.
    fn check_light(&self, weather: &Weather) -> Result<()> {
        light_fault(weather, &self.site).map_or(Ok(()), |fault| Err(Error::Unsupported(fault)))
    }

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
        if !prepared.falling().is_empty() {
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

    /// The level surfaces of the place, found when they are first asked for.
    fn near_ground(&mut self) -> &NearGround {
        self.near_ground.get_or_insert_with(|| NearGround::of(&self.scene.splats, self.survey.up.value))
    }

    /// Checks that the water of an instant can be drawn from an eye.
    fn check_water(&mut self, weather: &Weather, prepared: &PreparedWeather, camera: &Camera) -> Result<()> {
        let Some(track) = weather.at(0.0).track("flood", "level").cloned() else { return Ok(()) };
        if self.survey.ground.source == FactSource::Assumed
            && flood_follows_camera(weather)
            && self.ground_under(camera).is_none()
        {
            let fault = "flood.level is over the ground, and the height of the ground is not known here: give --ground, or \
                         flood.ground";
            return Err(Error::Unsupported(fault.into()));
        }
        if !prepared.paper_falls().is_empty() {
            let fault = "flood cannot be drawn together with rain or snow of fidelity `paper`: use fidelity `physical`";
            return Err(Error::Unsupported(fault.into()));
        }
        if track.most() <= 0.0 && !self.warnings.iter().any(|warning| warning.starts_with("flood.level")) {
            self.warnings.push("flood.level is not above the ground: no water is drawn".into());
        }
        let Some(map) = prepared.water(None) else { return Ok(()) };
        let over = prepared.flood().and_then(|flood| flood.ground).unwrap_or(0.0);
        let ground = self.site.ground * self.site.metres_per_unit + over;
        let eye = map.height_of(camera.center().to_array());
        match map.heights() {
            Some([_, high]) if eye <= high => Err(Error::Unsupported(format!(
                "the camera is under water: flood.level is {:.2} m over the ground, the eye {:.2} m; raise the camera or lower the level",
                high - ground,
                eye - ground,
            ))),
            _ => Ok(()),
        }
    }

    /// Finds the gains of the light, if it changes and the capture's is known.
    fn relight(&mut self, prepared: &PreparedWeather, pool: &rayon::ThreadPool) {
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

    /// Draws the splat that has the median depth at each pixel, without any weather: see
    /// [`Frame::median_splat`].
    pub(crate) fn draw_median_splats(
        &self,
        backend: &mut AnyRenderer,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<Stats> {
        let outputs = Outputs { median_depth: MedianDepth::Splat, ..Outputs::default() };
        let config = self.config(outputs);
        Ok(backend.render(&DrawPass::new(&[SetView::plain(self.set)], camera, &config), frame)?)
    }

    /// Returns the snow or dust that lies at one instant of a weather, for baking.
    pub(crate) fn lying_cover(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<LyingCover>> {
        let prepared = self.prepare_weather(weather, time);
        if let Some(paper) = prepared.paper_cover() {
            let snow = backend.pool().install(|| paper.snow(&self.scene.splats, &self.site));
            return Ok(Some(LyingCover::on_top(snow)));
        }
        let requests = prepared.cover();
        let airflow = AssetNeeds::of(weather, &self.site).cover;
        let Some(airflow) = airflow.filter(|_| !requests.is_empty()) else { return Ok(None) };
        let missing = MissingAssets::of([AssetKey::Cover(airflow)], &self.store);
        self.prepare(backend, missing, progress)?;
        let cover = self.store.take_up::<Mutex<Cover>>(airflow);
        Ok(cover.map(|cover| backend.pool().install(|| lock(&cover).lay_all(requests))))
    }

    /// Returns the splats of the scene in the light of an instant of a weather, and wet; `None`
    /// where it changes neither.
    pub(crate) fn relit_splats(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
    ) -> Result<Option<Splats>> {
        let prepared = self.prepare_weather(weather, time);
        if prepared.light().is_none() && prepared.wetness().is_none() {
            return Ok(None);
        }
        let missing = self.missing_assets(weather, time);
        let missing = missing.only(|key| !matches!(key, AssetKey::Lying(_)));
        self.prepare(backend, missing, progress)?;
        // The light of the photos says more of the site.
        let prepared = self.prepare_weather(weather, time);
        self.relight(&prepared, backend.pool());
        self.water.find(&prepared, &mut self.store, &self.site, backend.pool());
        let relit = self.light.gains(&prepared).map(|gains| gains.applied(&self.scene.splats));
        let Some(wet) = self.water.gains(&prepared, None) else { return Ok(relit) };
        let mut splats = relit.unwrap_or_else(|| self.scene.splats.clone());
        wet.apply(&mut splats);
        Ok(Some(splats))
    }

    /// Returns the light of the capture, and finds it first if it is not known.
    pub(crate) fn capture_light(
        &mut self,
        backend: &mut AnyRenderer,
        progress: &mut dyn Progress,
    ) -> Result<Arc<CaptureLight>> {
        let missing = MissingAssets::of([AssetKey::Light(())], &self.store);
        self.prepare(backend, missing, progress)?;
        self.store.take_up(()).ok_or_else(|| Error::Unsupported("the light was not found".into()))
    }

    /// Takes the splats out of the renderer.
    pub fn unload(mut self, backend: &mut AnyRenderer) {
        self.clear_cover(backend);
        if let Some(thin) = self.thinned.take() {
            backend.unload(thin.set);
        }
        backend.unload(self.set);
        if let Some(levels) = &mut self.levels {
            levels.clear(backend);
        }
    }
}

/// The doubts that an asset raises about the place, one line each.
fn doubts_of_asset(asset: &AnyAsset) -> Vec<String> {
    if let Some(lamps) = asset.downcast_ref::<LampShadows>() {
        let says = "stands inside of something: the surfaces around it look away from it";
        let doubt = |[x, y, z]: [f32; 3]| format!("the lamp at {x:.2}, {y:.2}, {z:.2} {says}");
        return lamps.enclosed().map(doubt).collect();
    }
    let bare = asset.downcast_ref::<Mutex<Cover>>().is_some_and(|cover| lock(cover).is_bare());
    let says = "nothing can lie here: no surface looks up at the sky; give --up if up is wrong";
    bare.then(|| says.into()).into_iter().collect()
}

/// Finds the surface of the water on the ground: not where snow or dust lies on it.
fn find_puddles(
    water: &mut PlaceWater,
    store: &mut AssetStore,
    lying: Option<&Lying>,
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

/// Least height of the picture of which a part is rendered to find a surface, px.
const SURFACE_HEIGHT: u32 = 2160;
/// Share by which depths differ that are of one surface.
const ONE_SURFACE: f64 = 0.1;

/// Returns the depth in the middle of a square of median depths, of which 0 is nothing. Depths of
/// splats are steps; the reciprocal depth of a plane is linear over the picture, so that its mean
/// over points to both sides is that in the middle.
fn middle_depth(depths: &[f32]) -> Option<f64> {
    let middle = f64::from(*depths.get(depths.len() / 2)?);
    if middle <= 0.0 {
        return None;
    }
    let is_near = |depth: f64| (depth / middle - 1.0).abs() < ONE_SURFACE;
    let pairs = depths.iter().zip(depths.iter().rev()).map(|(a, b)| [f64::from(*a), f64::from(*b)]);
    let near: Vec<f64> = pairs.filter(|pair| pair.iter().all(|depth| is_near(*depth))).flatten().collect();
    Some(near.len() as f64 / near.iter().map(|depth| depth.recip()).sum::<f64>())
}

/// Returns true if a weather has a flood whose level counts from the ground under the camera.
fn flood_follows_camera(weather: &Weather) -> bool {
    weather.at(0.0).track("flood", "ground").is_some_and(|track| track.at(0.0).number().is_none())
}

/// Returns the facts of a surveyed place that weather uses.
fn site_of(survey: &Survey, lamps: &PlaceLamps) -> Site {
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

/// Fails if `place` was loaded by another renderer.
pub(crate) fn check_owner(place: &PreparedPlace, renderer: u64) -> Result<()> {
    if place.renderer == renderer { Ok(()) } else { Err(Error::OtherRenderer) }
}
