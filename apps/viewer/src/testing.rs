//! States and views of an empty scene, for tests.

use crate::catalog::Catalog;
use crate::state::ViewState;
use crate::view::View;
use glam::DVec3;
use std::sync::Arc;
use wm_scene::survey::Survey;
use wm_scene::{Camera, Metadata, Scene};
use wm_weather::Weather;

/// Returns a catalog for an empty scene.
pub fn catalog() -> Catalog {
    Catalog {
        stem: "nothing".into(),
        words: vec!["nothing.ply".into()],
        fact_words: Vec::new(),
        is_unsaved: false,
        run_words: Vec::new(),
        survey: Survey::of(&Scene::default(), &Metadata::default()),
        near: 0.1,
        splats: 0,
        renderer: String::new(),
        views: Vec::new(),
        weather: Weather::clear(),
        panoramas: Default::default(),
        has_video: false,
    }
}

/// Returns a state with an unrotated camera at the origin.
pub fn state() -> ViewState {
    catalog().initial_state(&Camera::posed((60, 40), 50.0, DVec3::ZERO, glam::DMat3::IDENTITY))
}

/// Returns the checked view of [`state`].
pub fn view() -> Arc<View> {
    Arc::new(View::new(state(), &catalog(), None).unwrap())
}
