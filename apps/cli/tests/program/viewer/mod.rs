//! The viewer: its pictures, what it refuses, and its page in a real browser.

mod align;
mod axe;
mod client;
mod frames;
mod lidar;
mod links;
mod page;
mod running;
mod security;
mod site;
mod socket;
mod training;
mod webdriver;

use crate::common::{Workshop, yard, yard_metadata};
use std::path::PathBuf;

/// The yard as a scene file.
fn yard_scene() -> (Workshop, PathBuf) {
    let workshop = Workshop::new();
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    (workshop, scene)
}

/// A viewer that shows the yard, with its folder.
fn yard_viewer() -> (Workshop, client::Viewer) {
    let (workshop, scene) = yard_scene();
    let viewer = client::Viewer::of(&scene, &["--port=0"]).loaded();
    (workshop, viewer)
}
