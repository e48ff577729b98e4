//! The renderer of the library: a device, and the places that it holds.
//!
//! `Renderer::load` takes the scene by value, since loading labels its splats of the sky: a copy of
//! millions of splats would be hidden in it. Frames take `&mut` of the place, since the place keeps
//! what frames find, such as assets and lying snow, and a mutable place makes that cost visible. A
//! place names splat sets in the memory of its renderer, so another renderer refuses it.

use crate::assets::{AssetSource, Assets, MissingAssets};
use crate::frame::FrameInputs;
use crate::levels::LevelBudget;
use crate::picture::Picture;
use crate::place::{PlaceFacts, PlaceOptions, PreparedPlace, check_owner};
use crate::view;
use crate::{CameraMotion, Error, Progress, Result};
use glam::DVec3;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use wm_render::{AnyRenderer, CpuConfig, Device, Pictures, RenderBackend, RenderError, Stats};
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::levels::LevelIndex;
use wm_scene::survey::{Aligned, Alignment};
use wm_scene::{Camera, Lamp, LitWindow, Scene, Splats};
use wm_weather::Weather;
use wm_weather::cover::LyingCover;
use wm_weather::light::CaptureLight;
use wm_weather::wetness::WaterState;

/// Renders places in weather, on a GPU or on the CPU. It keeps its working memory from frame to
/// frame.
pub struct Renderer {
    backend: AnyRenderer,
    memory: Pictures,
    /// Pinhole pictures of the last frame through a lens: memory for the next one.
    pub(crate) sides: Vec<Picture>,
    /// The last frame without weather: memory for the next one.
    pub(crate) clear: Picture,
    id: u64,
}

impl Renderer {
    /// A renderer on a real GPU where there is one, else on the CPU with all its threads.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the threads cannot be started.
    pub fn auto() -> Result<Self> {
        Self::new(&Device::Auto, CpuConfig::default(), |_| {})
    }

    /// A renderer on the CPU with all its threads: the same bytes on every run.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the threads cannot be started.
    pub fn cpu() -> Result<Self> {
        Self::new(&Device::Cpu, CpuConfig::default(), |_| {})
    }

    /// A renderer on `device`; `cpu` says how the CPU does its work or its part of it. With
    /// [`Device::Auto`] the CPU goes on if the GPU fails; `warn` is called with the reason.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the device cannot be used.
    pub fn new(
        device: &Device,
        cpu: CpuConfig,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self> {
        Ok(Self::on(AnyRenderer::new(device, cpu, warn)?))
    }

    fn on(backend: AnyRenderer) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Self { backend, memory: Pictures::default(), sides: Vec::new(), clear: Picture::default(), id }
    }

    /// The number that tells it from other renderers.
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// The back end, for draw passes of your own.
    pub fn backend_mut(&mut self) -> &mut AnyRenderer {
        &mut self.backend
    }

    /// The back end.
    #[must_use]
    pub fn backend(&self) -> &AnyRenderer {
        &self.backend
    }

    /// The back end, and the memory of its pictures.
    pub(crate) fn drawing(&mut self) -> (&mut AnyRenderer, &mut Pictures) {
        (&mut self.backend, &mut self.memory)
    }

    /// The device in words.
    #[must_use]
    pub fn describe(&self) -> String {
        self.backend.describe()
    }

    /// A renderer in a browser: on its GPU if that is a real one, or is asked for, else on the CPU.
    /// `warn` is called with the reason why the GPU is not used.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if `device` asks for a GPU, and there is none or it cannot be used.
    #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
    pub async fn in_browser(
        device: &Device,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self> {
        Ok(Self::on(AnyRenderer::in_browser(device, CpuConfig::default(), warn).await?))
    }

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
    pub fn load_with(&mut self, scene: Scene, options: &PlaceOptions) -> Result<PreparedPlace> {
        PreparedPlace::load(&mut self.backend, self.id, scene, options)
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
        PreparedPlace::load_levels(&mut self.backend, self.id, index, options, (budget, repairs))
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
        check_owner(place, self.id)?;
        place.align(&mut self.backend, by)
    }

    /// Replaces the facts of a place, such as by those that [`PreparedPlace::facts`] returned
    /// before. Assets of the old facts are not used any more, nor those that are still being made.
    ///
    /// # Errors
    /// [`crate::Error::Unsupported`] after [`PreparedPlace::release_splats`].
    pub fn set_facts(&mut self, place: &mut PreparedPlace, facts: PlaceFacts) -> Result<()> {
        check_owner(place, self.id)?;
        place.set_facts(&mut self.backend, facts)
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
        check_owner(place, self.id)?;
        place.set_lamps(lamps, windows)
    }

    /// Returns the point of the scene (scene units) that is seen at the point `[x, y]` (px) of a
    /// camera's picture, by the median depth without weather; `None` where less than half of the
    /// light is that of surfaces, such as in the sky.
    ///
    /// # Errors
    /// As [`Self::render`]; [`crate::Error::Unsupported`] after [`PreparedPlace::release_splats`].
    pub fn surface_at(
        &mut self,
        place: &PreparedPlace,
        camera: &Camera,
        at: [f64; 2],
    ) -> Result<Option<DVec3>> {
        check_owner(place, self.id)?;
        place.surface_at(&mut self.backend, camera, at)
    }

    /// Frees a place's memory in the renderer.
    ///
    /// # Errors
    /// [`crate::Error::OtherRenderer`] if another renderer holds it.
    pub fn unload(&mut self, place: PreparedPlace) -> Result<()> {
        check_owner(&place, self.id)?;
        place.unload(&mut self.backend);
        Ok(())
    }

    /// Draws a frame of splat sets of your own in a weather, by the same plan as [`Self::render`].
    ///
    /// # Errors
    /// [`crate::Error::Render`].
    pub fn draw(&mut self, inputs: &FrameInputs<'_>, picture: &mut Picture) -> Result<Stats> {
        Ok(inputs.draw(&mut self.backend, &mut self.memory, picture)?)
    }

    /// Takes the splats about a camera for those that a weather is prepared with, of a place in
    /// levels of detail: [`Self::render`] does so itself. Assets that are being made on another
    /// thread are of the splats of before then: [`Self::insert_assets`] leaves them out.
    ///
    /// # Errors
    /// [`crate::Error::Format`] if a file cannot be read.
    pub fn focus(&mut self, place: &mut PreparedPlace, weather: &Weather, camera: &Camera) -> Result<()> {
        check_owner(place, self.id)?;
        place.focus(&mut self.backend, weather, camera)
    }

    /// Takes the splats along a sensor's way for the weather's, of a place in levels of detail.
    pub(crate) fn focus_along(&mut self, place: &mut PreparedPlace, motion: &CameraMotion) -> Result<()> {
        check_owner(place, self.id)?;
        place.focus_along(&mut self.backend, motion)
    }

    /// Makes what a weather may need of the place at any time, so that no frame waits and
    /// [`PreparedPlace::release_splats`] may follow.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub fn prepare(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        check_owner(place, self.id)?;
        place.prepare_all(&mut self.backend, weather, progress)
    }

    /// Returns the inputs for [`MissingAssets::make`] on another thread, and removes from `missing`
    /// what is found on disk.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn asset_source(
        &mut self,
        place: &mut PreparedPlace,
        missing: &mut MissingAssets,
    ) -> Result<AssetSource> {
        check_owner(place, self.id)?;
        place.asset_source(&mut self.backend, missing)
    }

    /// Gives a place the assets that were made for it.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if there is more lying snow than the renderer holds.
    pub fn insert_assets(&mut self, place: &mut PreparedPlace, assets: Assets) -> Result<()> {
        check_owner(place, self.id)?;
        place.insert(&mut self.backend, assets)
    }

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
        check_owner(place, self.id)?;
        place.lying_cover(&mut self.backend, weather, time, progress)
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
        check_owner(place, self.id)?;
        place.relit_splats(&mut self.backend, weather, time, progress)
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
        check_owner(place, self.id)?;
        place.capture_light(&mut self.backend, progress)
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
        check_owner(place, self.id)?;
        place.water_state(&mut self.backend, weather, time, progress)
    }

    /// A place to look for cameras in.
    pub fn view_search<'a>(
        &'a mut self,
        place: &'a PreparedPlace,
        options: view::ViewOptions,
    ) -> view::ViewSearch<'a> {
        place.view_search(&mut self.backend, options)
    }
}
