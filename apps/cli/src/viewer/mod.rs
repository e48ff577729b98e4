//! The viewer: renders a scene for a page in the browser.
//!
//! Two threads: the `server` (one tokio thread) accepts requests and sends bytes; the
//! `render_worker` (the program's main thread) owns the renderer and the scene and renders one
//! frame after the other. Between them is the `request_queue`: the latest request of each page, and
//! commands. Everything else is in the crate `wm_viewer`, which needs no server: all that a picture
//! depends on is in a `state`; a client may only use names that are in the `catalog`.
//!
//! Complete pictures are rendered as `render` does it, so that the command that the page shows
//! gives the same bytes.
//!
//! Who may ask is decided by the head of a request (`guard.rs`), and how many may wait for that by
//! `listener.rs`.

mod client_queue;
mod context;
mod download;
mod facts;
mod guard;
mod listener;
mod locked;
mod render_worker;
mod request_queue;
mod routes;
pub(crate) mod server;
mod session;
pub(crate) mod training;
mod videos;
pub(crate) mod words;
mod workshop;

use crate::commands::render::camera::ViewpointArgs;
use crate::interrupt;
use crate::level_args::LevelArgs;
use crate::names::stem_of;
use crate::scene::{OpenScene, OwnSkyArgs, RunArgs, SceneArgs};
use anyhow::Result;
use context::{Loaded, ViewerContext};
use facts::FactEditor;
use render_worker::RenderWorker;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use weather_magician::{PreparedPlace, Renderer, Weather};
use wm_viewer::Catalog;
use wm_viewer::page::PageKind;
use wm_weather::Panorama;

/// Time for which the page of a scene that cannot be read is served, so that it can show the error.
const FAREWELL: Duration = Duration::from_secs(10);

/// The scene to show, and how.
pub(crate) struct ViewerOptions<'a> {
    /// The scene file and its facts.
    pub(crate) scene: &'a SceneArgs,
    /// The treatment of its sky.
    pub(crate) sky: OwnSkyArgs,
    /// The budget of a scene in levels of detail.
    pub(crate) levels: LevelArgs,
    /// The camera at the start.
    pub(crate) viewpoint: &'a ViewpointArgs,
    /// The device and other options of the run.
    pub(crate) run: &'a RunArgs,
    /// The weather at the start.
    pub(crate) weather: Weather,
    /// The weather's panoramas and further ones, by the paths that weather files use for them.
    pub(crate) panoramas: BTreeMap<String, Arc<Panorama>>,
}

/// Serves the page of a scene until Ctrl-C.
///
/// # Errors
/// No port is free, or the scene cannot be read; the page shows this error too.
pub(crate) fn run(options: ViewerOptions<'_>, server: &server::ServerArgs) -> Result<()> {
    let context = Arc::new(ViewerContext::default());
    let address = server::serve(server, PageKind::Server, routes::routes(Arc::clone(&context)))?;
    println!("{address}");
    eprintln!("open this address in a browser; press Ctrl-C to quit");
    // What killed viewers left is removed. What is refused is told when a folder is needed.
    let _ = context.workshop.open();
    let outcome = show(options, &context);
    context.workshop.clear();
    outcome
}

/// Reads the scene, and renders it until Ctrl-C.
fn show(options: ViewerOptions<'_>, context: &Arc<ViewerContext>) -> Result<()> {
    let (renderer, place, facts) = match open(options, context) {
        Ok(stage) => {
            context.queue.broadcast(&context.greeting());
            stage
        }
        Err(error) => {
            let _ = context.failed.set(format!("{error:#}"));
            context.queue.broadcast(&context.greeting());
            let end = Instant::now() + FAREWELL;
            while Instant::now() < end && !interrupt::asked() {
                std::thread::sleep(Duration::from_millis(50));
            }
            return Err(error);
        }
    };
    RenderWorker::new(Arc::clone(context), renderer, place, facts).run()
}

/// Reads the scene and loads it.
fn open(
    options: ViewerOptions<'_>,
    context: &ViewerContext,
) -> Result<(Renderer, PreparedPlace, FactEditor)> {
    let mut loaded = OpenScene::in_levels(
        options.scene,
        options.run,
        options.viewpoint.views.as_ref(),
        options.sky,
        options.levels,
    )?;
    let given_words = words::given_words(&options.scene.facts);
    let mut facts = FactEditor::new(options.scene.scene.clone(), options.sky.sky, &loaded.place, given_words);
    facts.restore(&mut loaded.renderer, &mut loaded.place);
    let camera = options.viewpoint.start(&mut loaded)?;
    let OpenScene { renderer, place } = loaded;
    let catalog = Catalog {
        stem: stem_of(&options.scene.scene),
        words: words::scene_words(options.scene, options.sky, options.viewpoint.views.as_ref())
            .into_iter()
            .chain(options.levels.words().into_iter().map(Into::into))
            .collect(),
        fact_words: facts.words(&place),
        is_unsaved: facts.is_unsaved(),
        run_words: words::run_words(options.run),
        survey: place.survey().clone(),
        near: camera.near,
        splats: place.splats() as usize,
        renderer: renderer.describe(),
        views: place.scene().views.iter().map(|view| (view.name.clone(), view.camera)).collect(),
        weather: options.weather,
        panoramas: options.panoramas,
        has_video: cfg!(feature = "h264"),
    };
    let start = catalog.initial_state(&camera);
    context.set_loaded(Loaded { catalog: Arc::new(catalog), start });
    Ok((renderer, place, facts))
}
