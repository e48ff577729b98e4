//! State that the server and the render worker share.

use super::locked::locked;
use super::request_queue::RequestQueue;
use super::videos::VideoList;
use super::workshop::Workshop;
use axum::body::Bytes;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};
use wm_scene::survey::Survey;
use wm_viewer::{Catalog, ViewState};

/// The scene as clients know it.
#[derive(Clone)]
pub(super) struct Loaded {
    /// The names and facts.
    pub(super) catalog: Arc<Catalog>,
    /// The initial state.
    pub(super) start: ViewState,
}

/// State shared by the server and the render worker.
#[derive(Default)]
pub(super) struct ViewerContext {
    pub(super) queue: RequestQueue,
    pub(super) videos: VideoList,
    pub(super) workshop: Workshop,
    /// Set once the scene is loaded, and when its facts change.
    loaded: Mutex<Option<Loaded>>,
    /// The error if the scene cannot be loaded.
    pub(super) failed: OnceLock<String>,
    /// The latest state of any client.
    state: Mutex<Option<ViewState>>,
    thumbnails: Mutex<BTreeMap<String, Bytes>>,
}

impl ViewerContext {
    pub(super) fn is_loaded(&self) -> bool {
        locked(&self.loaded).is_some()
    }

    pub(super) fn loaded(&self) -> Loaded {
        locked(&self.loaded).clone().expect("called only after the scene is loaded")
    }

    pub(super) fn set_loaded(&self, loaded: Loaded) {
        *locked(&self.loaded) = Some(loaded);
    }

    pub(super) fn catalog(&self) -> Arc<Catalog> {
        self.loaded().catalog
    }

    /// Takes other facts of the scene: the initial view is level under the new up, and thumbnails
    /// are rendered again. Returns the message that tells pages.
    pub(super) fn set_facts(&self, survey: &Survey, fact_words: Vec<String>, is_unsaved: bool) -> Value {
        let Loaded { catalog, mut start } = self.loaded();
        start.camera = start.camera.levelled(survey.up.value);
        if *survey != catalog.survey {
            locked(&self.thumbnails).clear();
        }
        let catalog = Catalog { survey: survey.clone(), fact_words, is_unsaved, ..(*catalog).clone() };
        let message = json!({ "type": "facts", "facts": catalog.facts(), "start": start.camera });
        self.set_loaded(Loaded { catalog: Arc::new(catalog), start });
        message
    }

    /// The initial state.
    pub(super) fn initial_state(&self) -> ViewState {
        self.loaded().start
    }

    /// The latest state of any client.
    pub(super) fn state(&self) -> ViewState {
        let state = locked(&self.state);
        state.clone().unwrap_or_else(|| self.initial_state())
    }

    pub(super) fn set_state(&self, state: &ViewState) {
        *locked(&self.state) = Some(state.clone());
    }

    /// The reason why there is no scene: it is still loading, or could not be read.
    pub(super) fn loading_text(&self) -> String {
        self.failed.get().cloned().unwrap_or_else(|| "the scene is being read".into())
    }

    /// The first message to a page.
    pub(super) fn greeting(&self) -> String {
        let kind = match (self.is_loaded(), self.failed.get()) {
            (true, _) => "ready",
            (_, Some(_)) => "failed",
            _ => "loading",
        };
        json!({ "type": kind, "text": self.loading_text() }).to_string()
    }

    pub(super) fn thumbnail(&self, name: &str) -> Option<Bytes> {
        locked(&self.thumbnails).get(name).cloned()
    }

    pub(super) fn thumbnail_names(&self) -> Vec<String> {
        locked(&self.thumbnails).keys().cloned().collect()
    }

    pub(super) fn set_thumbnail(&self, name: String, bytes: Bytes) {
        locked(&self.thumbnails).insert(name, bytes);
    }
}
