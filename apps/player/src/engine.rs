//! The renderer and the place of the page, with what a frame of the viewer needs.

use crate::files::SiteFiles;
use crate::page::Page;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weather_magician::assets::MissingAssets;
use weather_magician::levels::LevelBudget;
use weather_magician::{Patience, PlaceOptions, PreparedPlace, Renderer};
use web_time::Instant;
use wm_base::files::fetched;
use wm_image::color::Dither;
use wm_image::{PictureSize, png};
use wm_render::Device;
use wm_scene::formats::{ReadOptions, read_scene};
use wm_scene::levels::{INDEX_NAME, LevelIndex};
use wm_scene::survey::Survey;
use wm_scene::{Scene, SceneView};
use wm_viewer::View;
use wm_viewer::catalog::Catalog;
use wm_viewer::encode::to_bytes;
use wm_viewer::pace::Pace;
use wm_viewer::paint::{FrameReport, PaintOptions, ViewPainter, half_depth};
use wm_viewer::site::{DEFAULT_MEMORY_BYTES, SiteFile, SiteView};
use wm_viewer::state::ViewState;

/// Files of levels that are fetched before the view is drawn again, at least.
const FETCHED_FILES: usize = 8;
/// Time after which a view is drawn again with what was fetched, s.
const FETCH_SECONDS: f64 = 2.0;

/// Draws the views of one place.
pub(crate) struct Engine {
    page: Page,
    files: SiteFiles,
    renderer: Renderer,
    place: PreparedPlace,
    painter: ViewPainter,
    pace: Pace,
    /// The view of the last frame.
    view: Option<Arc<View>>,
    /// Files of levels that it lacked, those first that it needs most.
    wanted: Vec<PathBuf>,
    /// Most bytes of fetched files that are kept for later views.
    kept: u64,
}

/// A picture of a view, and its header.
pub(crate) struct DrawnPicture {
    /// The header of the frame.
    pub(crate) head: Value,
    /// Width and height, px.
    pub(crate) size: (u32, u32),
    /// Bytes `[H, W, 3]`.
    pub(crate) rgb: Vec<u8>,
    /// Something is missing that [`Engine::prepare`] gets.
    pub(crate) lacks: bool,
}

impl Engine {
    /// Reads the scene of a site.
    ///
    /// # Errors
    /// A file cannot be fetched or read, or the device cannot be used, in one line.
    pub(crate) async fn open(
        page: Page,
        files: SiteFiles,
        site: &SiteFile,
        device: &Device,
    ) -> Result<Self, String> {
        let told = page.clone();
        let warn = move |error: &wm_render::RenderError| told.note(&error.to_string());
        let mut renderer = Renderer::in_browser(device, warn).await.map_err(error_text)?;
        files.keep_all(&[PathBuf::from(&site.scene)]).await?;
        let options = PlaceOptions {
            assets: Some("assets".into()),
            asset_digest: Some(site.digest.parse()?),
            ..PlaceOptions::default()
        };
        let path = Path::new(&site.scene);
        let memory = site.memory.unwrap_or(DEFAULT_MEMORY_BYTES);
        let place = if site.scene == INDEX_NAME {
            let budget = LevelBudget { memory, splats: None };
            let index = LevelIndex::open(path).map_err(error_text)?;
            loop {
                let options = PlaceOptions { facts: site.metadata.clone(), ..options.clone() };
                let opened = renderer.load_levels(index.clone(), &options, &budget, false);
                // What it reads first is fetched, and read then.
                match (opened, fetched::take_wanted()) {
                    (Err(_), wanted) if !wanted.is_empty() => files.keep_all(&wanted).await?,
                    (opened, _) => break opened.map_err(error_text)?,
                }
            }
        } else {
            let read = read_scene(path, &ReadOptions::default()).map_err(error_text)?;
            fetched::remove(path);
            let view = |view: &SiteView| SceneView { name: view.name.clone(), camera: view.camera };
            let views = site.views.iter().map(view).collect();
            let scene = Scene { views, metadata: site.metadata.clone(), ..read };
            scene.check_finite().map_err(error_text)?;
            renderer.load_with(scene, &options).map_err(error_text)?
        };
        let (painter, pace) = (ViewPainter::default(), Pace::default());
        // The splats that were read of them take more: some 250 bytes each, of which a file has
        // some 25.
        let (view, wanted, kept) = (None, Vec::new(), memory / 4);
        Ok(Self { page, files, renderer, place, painter, pace, view, wanted, kept })
    }

    /// The renderer, in words.
    pub(crate) fn describe(&self) -> String {
        self.renderer.describe()
    }

    /// The facts of the place.
    pub(crate) fn survey(&self) -> &Survey {
        self.place.survey()
    }

    /// Checks a state.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub(crate) fn view(&self, state: ViewState, catalog: &Catalog) -> Result<Arc<View>, String> {
        View::new(state, catalog, self.view.as_deref()).map(Arc::new)
    }

    /// Draws a view with the assets that there are: small while it is `moving`.
    ///
    /// # Errors
    /// In one line.
    pub(crate) async fn render(
        &mut self,
        view: &Arc<View>,
        seq: u64,
        moving: bool,
    ) -> Result<DrawnPicture, String> {
        let started = Instant::now();
        self.view = Some(Arc::clone(view));
        let lacks = !moving && !self.missing(view)?.is_empty();
        let (size, patience, dither) = match (moving, lacks) {
            (true, _) => (self.pace.size(view.state.size), Patience::Draft, Dither::Off),
            (false, true) => (view.size(), Patience::Draft, Dither::Ordered),
            (false, false) => (view.size(), Patience::Whole, Dither::Ordered),
        };
        let options = PaintOptions { size, patience, dither };
        let Self { painter, renderer, place, .. } = self;
        let (rgb, stats) = painter.draw(renderer, place, view, None, options).await.map_err(error_text)?;
        // Files of levels that were not there are known only now.
        self.wanted = fetched::take_wanted();
        if !moving {
            fetched::keep_within(self.kept, &self.place.spare_files());
        }
        let lacks = lacks || !(moving || self.wanted.is_empty());
        let seconds = started.elapsed().as_secs_f64();
        if moving {
            self.pace.learn(seconds, 1, 0.0);
        }
        let report =
            FrameReport { seq, size, is_whole: !moving && !lacks, stats: &stats, seconds: [seconds, 0.0] };
        let mut head = report.header(view, self.place.site(), Value::Null);
        // It may have been given up.
        head["device"] = self.describe().into();
        Ok(DrawnPicture { head, size, rgb, lacks })
    }

    /// Returns the assets of a view that are missing.
    fn missing(&mut self, view: &View) -> Result<MissingAssets, String> {
        self.renderer.focus(&mut self.place, &view.weather, &view.camera()).map_err(error_text)?;
        Ok(self.place.missing_assets(&view.weather, view.state.time))
    }

    /// Fetches or makes what the last view lacked.
    ///
    /// # Errors
    /// In one line.
    pub(crate) async fn prepare(&mut self) -> Result<(), String> {
        let done = self.get_ready().await;
        self.page.status("");
        done
    }

    async fn get_ready(&mut self) -> Result<(), String> {
        let wanted = std::mem::take(&mut self.wanted);
        if !wanted.is_empty() {
            let started = Instant::now();
            for (number, files) in wanted.chunks(FETCHED_FILES).enumerate() {
                // The view is drawn with these, and notes the others again.
                if number > 0 && started.elapsed().as_secs_f64() > FETCH_SECONDS {
                    return Ok(());
                }
                let left = wanted.len() - number * FETCHED_FILES;
                self.page.status(&format!("fetching the scene, {left} files"));
                self.files.keep_all(files).await?;
            }
        }
        let Some(view) = self.view.clone() else { return Ok(()) };
        let mut missing = self.missing(&view)?;
        // Assets are made of the splats about the camera, once those are there.
        self.wanted = fetched::take_wanted();
        if missing.is_empty() || !self.wanted.is_empty() {
            return Ok(());
        }
        self.page.status(missing.description());
        // Of what the site has, what this instant uses.
        let prepared = self.place.asset_files(&view.weather, view.state.time);
        let kept = self.files.keep_prepared(&prepared).await;
        let source = self.renderer.asset_source(&mut self.place, &mut missing);
        kept.iter().for_each(|path| fetched::remove(path));
        // What the site does not have is made.
        let _ = fetched::take_wanted();
        let source = source.map_err(error_text)?;
        if missing.is_empty() {
            return Ok(());
        }
        let assets = missing.make(source, &mut ()).map_err(error_text)?;
        self.renderer.insert_assets(&mut self.place, assets).map_err(error_text)
    }

    /// Returns the point of the scene at a point of a view's picture, 0-1 of its sides.
    ///
    /// # Errors
    /// In one line.
    pub(crate) async fn pick(&mut self, view: &View, at: [f64; 2]) -> Result<Option<[f64; 3]>, String> {
        let Self { painter, renderer, place, .. } = self;
        painter.pick(renderer, place, view, at).await.map_err(error_text)
    }

    /// Returns the bytes of the PNG file of a view, without its divider.
    ///
    /// # Errors
    /// In one line.
    pub(crate) async fn picture(&mut self, view: &Arc<View>) -> Result<Vec<u8>, String> {
        self.view = Some(Arc::clone(view));
        loop {
            while !self.missing(view)?.is_empty() {
                self.prepare().await?;
            }
            let Self { painter, renderer, place, .. } = self;
            let half = half_depth(place.survey());
            let frame = &painter.render(renderer, place, view).await.map_err(error_text)?.frame;
            let wanted = fetched::take_wanted();
            if wanted.is_empty() {
                let bytes = to_bytes(frame, view.state.output, half, Dither::Ordered);
                return png::encode_rgb8(&bytes, PictureSize::new(frame.width, frame.height))
                    .map_err(error_text);
            }
            self.wanted = wanted;
            self.prepare().await?;
        }
    }
}

fn error_text(error: impl std::fmt::Display) -> String {
    error.to_string()
}
