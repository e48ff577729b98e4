//! The scenes that a run holds open.

use super::set::SetWorld;
use wm_place::{CameraMotion, PreparedPlace};

/// A scene that is open.
pub(super) struct OpenPlace {
    /// Index into the scenes of the plan.
    pub(super) scene: usize,
    /// The SHA-256 of its file.
    pub(super) digest: String,
    pub(super) place: PreparedPlace,
    pub(super) world: SetWorld,
    /// The motion of each way, found when it is first needed.
    pub(super) motions: Vec<Option<CameraMotion>>,
}

/// The scenes that are open, the last used at the end.
#[derive(Default)]
pub(super) struct OpenPlaces(Vec<OpenPlace>);

impl OpenPlaces {
    /// The scene that was used last.
    pub(super) fn last(&self) -> Option<&OpenPlace> {
        self.0.last()
    }

    /// The scene that was used last.
    pub(super) fn last_mut(&mut self) -> Option<&mut OpenPlace> {
        self.0.last_mut()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut OpenPlace> {
        self.0.iter_mut()
    }

    /// Adds a scene at the end.
    pub(super) fn push(&mut self, open: OpenPlace) {
        self.0.push(open);
    }

    /// Removes the scene that has been unused for longest where more than `most` are open.
    pub(super) fn pop_beyond(&mut self, most: usize) -> Option<OpenPlace> {
        (self.0.len() > most).then(|| self.0.remove(0))
    }

    /// Moves a scene to the end; returns false if it is not open.
    pub(super) fn touch(&mut self, scene: usize) -> bool {
        let found = self.0.iter().position(|open| open.scene == scene);
        if let Some(found) = found {
            let open = self.0.remove(found);
            self.0.push(open);
        }
        found.is_some()
    }
}
