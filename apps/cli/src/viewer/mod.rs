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

use crate::commands::view::ViewArgs;
use crate::interrupt;
use crate::names::stem_of;
use crate::scene::OpenScene;
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
const ERROR_PAGE_TIME: Duration = Duration::from_secs(10);

/// The panoramas that a page offers, by the paths that weather files use for them.
pub(crate) type Panoramas = BTreeMap<String, Arc<Panorama>>;

/// Serves the page of a scene until Ctrl-C.
///
/// # Errors
/// No port is free, or the scene cannot be read; the page shows this error too.
pub(crate) fn run(args: &ViewArgs, weather: Weather, panoramas: Panoramas) -> Result<()> {
    let context = Arc::new(ViewerContext::default());
    let address = server::serve(&args.server, PageKind::Server, routes::routes(Arc::clone(&context)))?;
    println!("{address}");
    eprintln!("open this address in a browser; press Ctrl-C to quit");
    // What killed viewers left is removed. What is refused is told when a folder is needed.
    let _ = context.workshop.open();
    let outcome = show(args, weather, panoramas, &context);
    context.workshop.clear();
    outcome
}

/// Reads the scene, and renders it until Ctrl-C.
fn show(args: &ViewArgs, weather: Weather, panoramas: Panoramas, context: &Arc<ViewerContext>) -> Result<()> {
    let (renderer, place, facts) = match open(args, weather, panoramas, context) {
        Ok(stage) => {
            context.queue.broadcast(&context.greeting());
            stage
        }
        Err(error) => {
            let _ = context.failed.set(format!("{error:#}"));
            context.queue.broadcast(&context.greeting());
            let end = Instant::now() + ERROR_PAGE_TIME;
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
    args: &ViewArgs,
    weather: Weather,
    panoramas: Panoramas,
    context: &ViewerContext,
) -> Result<(Renderer, PreparedPlace, FactEditor)> {
    let views = args.viewpoint.views.as_ref();
    let mut loaded = OpenScene::in_levels(&args.scene, &args.run, views, args.sky, args.levels)?;
    let given_words = words::given_words(&args.scene.facts);
    let mut facts = FactEditor::new(args.scene.scene.clone(), args.sky.sky, &loaded.place, given_words);
    facts.restore(&mut loaded.renderer, &mut loaded.place);
    let camera = args.viewpoint.start(&mut loaded)?;
    let OpenScene { renderer, place } = loaded;
    let catalog = Catalog {
        stem: stem_of(&args.scene.scene),
        words: words::scene_words(&args.scene, args.sky, views)
            .into_iter()
            .chain(args.levels.words().into_iter().map(Into::into))
            .collect(),
        fact_words: facts.words(&place),
        is_unsaved: facts.is_unsaved(),
        run_words: words::run_words(&args.run),
        survey: place.survey().clone(),
        near: camera.near,
        splats: place.splats() as usize,
        renderer: renderer.describe(),
        views: place.scene().views.iter().map(|view| (view.name.clone(), view.camera)).collect(),
        weather,
        panoramas,
        has_video: cfg!(feature = "h264"),
    };
    let start = catalog.initial_state(&camera);
    context.set_loaded(Loaded { catalog: Arc::new(catalog), start });
    Ok((renderer, place, facts))
}
