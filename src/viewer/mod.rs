//! A scene in a browser: this program draws, a page shows and asks.
//!
//! Two threads: the `server` (one thread of tokio) takes requests and hands out bytes; the `painter` (the program's main thread)
//! owns the studio and draws, one thing after the other. Between them is the `desk`: of each page the last wish, and orders. All that a
//! picture depends on is a `state`, which a client may only fill with what is in the `catalog`.
//!
//! A whole picture goes the way that `render` goes, so that the command that the page prints gives the same bytes.

mod catalog;
mod desk;
mod encode;
mod guard;
mod listener;
mod pace;
mod painter;
mod routes;
pub mod server;
mod session;
mod state;
pub mod training;
mod videos;

use crate::commands::render::camera::LookArgs;
use crate::interrupt;
use crate::names::stem_of;
use crate::scene::{Loaded, RunArgs, SceneArgs};
use anyhow::Result;
use axum::body::Bytes;
use catalog::Catalog;
use desk::Desk;
use painter::Painter;
use serde_json::json;
use state::ViewState;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use videos::Videos;
use weather_magician::{PreparedPlace, Renderer};
use wm_weather::{Panorama, ParamValue, Weather};

/// How long the page of a scene that cannot be read stays, for who opens it to be told.
const FAREWELL: Duration = Duration::from_secs(10);

/// What is shown.
pub struct Asked<'a> {
    /// Which scene.
    pub scene: &'a SceneArgs,
    /// From where.
    pub look: &'a LookArgs,
    /// How it runs.
    pub run: &'a RunArgs,
    /// The weather at the start.
    pub weather: Weather,
    /// Further panoramas, by the paths that files name them by.
    pub panoramas: BTreeMap<String, Arc<Panorama>>,
}

/// What server and painter share.
#[derive(Default)]
pub struct Room {
    desk: Desk,
    videos: Videos,
    /// Once the scene is there.
    loaded: OnceLock<(Catalog, ViewState)>,
    /// Why it will not be.
    failed: OnceLock<String>,
    /// What was asked for last.
    state: Mutex<Option<ViewState>>,
    thumbnails: Mutex<BTreeMap<String, Bytes>>,
}

impl Room {
    fn is_loaded(&self) -> bool {
        self.loaded.get().is_some()
    }

    fn both(&self) -> &(Catalog, ViewState) {
        self.loaded.get().expect("asked for when the scene is there")
    }

    fn catalog(&self) -> &Catalog {
        &self.both().0
    }

    /// The state at the start.
    fn start(&self) -> ViewState {
        self.both().1.clone()
    }

    /// What was asked for last, by whomever.
    fn state(&self) -> ViewState {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.clone().unwrap_or_else(|| self.start())
    }

    fn set_state(&self, state: &ViewState) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = Some(state.clone());
    }

    /// Why there is no scene yet.
    fn loading(&self) -> String {
        self.failed.get().cloned().unwrap_or_else(|| "the scene is being read".into())
    }

    /// What a page is told first.
    fn greeting(&self) -> String {
        let kind = match (self.loaded.get(), self.failed.get()) {
            (Some(_), _) => "ready",
            (_, Some(_)) => "failed",
            _ => "loading",
        };
        json!({ "type": kind, "text": self.loading() }).to_string()
    }

    fn thumbnail(&self, name: &str) -> Option<Bytes> {
        self.thumbnails.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned()
    }

    fn thumbnail_names(&self) -> Vec<String> {
        self.thumbnails.lock().unwrap_or_else(PoisonError::into_inner).keys().cloned().collect()
    }

    fn keep_thumbnail(&self, name: String, bytes: Bytes) {
        self.thumbnails.lock().unwrap_or_else(PoisonError::into_inner).insert(name, bytes);
    }
}

/// Serves the page of a scene until Ctrl-C.
///
/// # Errors
/// Nothing can be listened on, or the scene cannot be read, which the page is told too.
pub fn run(asked: Asked<'_>, server: &server::ServerArgs) -> Result<()> {
    let room = Arc::new(Room::default());
    let address = server::serve(server, routes::routes(Arc::clone(&room)))?;
    println!("{address}");
    eprintln!("open this address in a browser; Ctrl-C ends");
    let (renderer, place) = match open(asked, &room) {
        Ok(stage) => {
            room.desk.tell_all(&room.greeting());
            stage
        }
        Err(error) => {
            let _ = room.failed.set(format!("{error:#}"));
            room.desk.tell_all(&room.greeting());
            let end = Instant::now() + FAREWELL;
            while Instant::now() < end && !interrupt::asked() {
                std::thread::sleep(Duration::from_millis(50));
            }
            return Err(error);
        }
    };
    let outcome = Painter::new(Arc::clone(&room), renderer, place).work();
    room.videos.clear();
    outcome
}

/// Reads the scene and loads it.
fn open(asked: Asked<'_>, room: &Room) -> Result<(Renderer, PreparedPlace)> {
    let mut loaded = Loaded::new(asked.scene, asked.run, asked.look.views.as_ref())?;
    let camera = asked.look.start(&mut loaded)?;
    let Loaded { renderer, place } = loaded;
    let mut panoramas = asked.panoramas;
    panoramas.extend(shown(&asked.weather));
    let catalog = Catalog {
        stem: stem_of(&asked.scene.scene),
        words: catalog::scene_words(asked.scene, asked.look.views.as_ref()),
        run_words: catalog::run_words(asked.run),
        survey: place.survey().clone(),
        near: camera.near,
        splats: place.scene().splats.len(),
        renderer: renderer.describe(),
        views: place.scene().views.iter().map(|view| (view.name.clone(), view.camera)).collect(),
        weather: asked.weather,
        panoramas,
    };
    let start = catalog.start(&camera);
    let _ = room.loaded.set((catalog, start));
    Ok((renderer, place))
}

/// The panoramas that a weather shows.
fn shown(weather: &Weather) -> BTreeMap<String, Arc<Panorama>> {
    let keys = weather.effects().flat_map(|(_, tracks)| tracks).flat_map(wm_weather::Track::keys);
    let picture = |key: &wm_weather::Keyframe| match &key.value {
        ParamValue::Image(picture) => {
            Some((picture.path().to_str()?.to_owned(), Arc::clone(picture.panorama()?)))
        }
        _ => None,
    };
    keys.filter_map(picture).collect()
}
