//! A scene: splats, what is known of the place, and the views that came with it.

use crate::{Camera, Metadata, Splats};

/// What one scene file (or folder) holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The Gaussians.
    pub splats: Splats,
    /// What is known of the place.
    pub metadata: Metadata,
    /// The photographed views, if the file or folder has them, in their order.
    pub views: Vec<View>,
}

/// A named camera, such as that of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The photo's file name.
    pub name: String,
    /// Its camera.
    pub camera: Camera,
}
