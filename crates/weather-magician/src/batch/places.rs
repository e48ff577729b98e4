//! The scenes that a run holds open, and the ways of the rig in them.

use super::clips::PlannedClip;
use super::plan::PlanPathKind;
use super::run::BatchRun;
use super::set::SetWorld;
use super::store::scene_digest_of;
use crate::rig::RigDevice;
use crate::view::ViewOptions;
use crate::{CameraMotion, Error, PlaceOptions, PreparedPlace, Result};

/// A scene that is open.
pub(super) struct OpenPlace {
    /// Index into the scenes of the plan.
    pub scene: usize,
    /// The SHA-256 of its file.
    pub digest: String,
    pub place: PreparedPlace,
    pub world: SetWorld,
    /// The motion of each way, once it was asked for.
    motions: Vec<Option<CameraMotion>>,
}

/// The scenes that are open, the last used at the end.
#[derive(Default)]
pub(super) struct OpenPlaces(Vec<OpenPlace>);

impl OpenPlaces {
    /// The scene that was used last.
    pub fn last(&self) -> Option<&OpenPlace> {
        self.0.last()
    }

    /// The same.
    pub fn last_mut(&mut self) -> Option<&mut OpenPlace> {
        self.0.last_mut()
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut OpenPlace> {
        self.0.iter_mut()
    }

    /// Moves a scene to the end; returns false if it is not open.
    fn touch(&mut self, scene: usize) -> bool {
        let found = self.0.iter().position(|open| open.scene == scene);
        if let Some(found) = found {
            let open = self.0.remove(found);
            self.0.push(open);
        }
        found.is_some()
    }
}

impl BatchRun {
    /// Makes a scene the last of the open ones, of which there are at most `most` then: those that
    /// were not used for the longest time are closed.
    pub(super) fn open(&mut self, scene: usize, most: usize) -> Result<()> {
        let is_open = self.places.touch(scene);
        // Closed first: two scenes at once may not fit.
        while self.places.0.len() + usize::from(!is_open) > most.max(1) {
            let mut closed = self.places.0.remove(0);
            self.warnings.append(&mut closed.place.take_warnings());
            self.renderer.unload(closed.place)?;
        }
        if is_open {
            return Ok(());
        }
        let of = &self.plan.scenes[scene];
        let digest = scene_digest_of(&of.file)?;
        let options = PlaceOptions {
            facts: of.facts.clone(),
            assets: (self.assets)(&of.file),
            ..PlaceOptions::default()
        };
        let mut place = self.renderer.open(&of.file, &options, &of.budget)?;
        let world = SetWorld::of(&place);
        let warnings = place.take_warnings();
        self.warnings.extend(warnings.into_iter().map(|warning| format!("{}: {warning}", of.name)));
        self.places.0.push(OpenPlace { scene, digest, place, world, motions: Vec::new() });
        Ok(())
    }

    /// The motion of the rig along a way, from time 0 on.
    pub(super) fn motion(&mut self, clip: &PlannedClip) -> Result<CameraMotion> {
        let way = self.clips.way(clip).clone();
        let open = self.places.last_mut().ok_or(Error::Stopped)?;
        if let Some(Some(motion)) = open.motions.get(clip.way) {
            return Ok(motion.clone());
        }
        let options = match &self.rig.sensors.iter().find_map(|sensor| match &sensor.device {
            RigDevice::Camera { intrinsics, .. } => Some(**intrinsics),
            _ => None,
        }) {
            Some(camera) => {
                ViewOptions { size: Some((camera.width, camera.height)), ..ViewOptions::default() }
            }
            None => ViewOptions::default(),
        };
        let OpenPlace { place, .. } = open;
        let seconds = f64::from(self.plan.frames) / self.plan.frame_rate;
        let motion = match (&self.plan.paths[way.path].kind, way.photo) {
            (PlanPathKind::Motion(spec), _) => {
                let mut chosen = Vec::new();
                let mut say = |text: String| chosen.push(format!("path \"{}\" begins at {text}", way.name));
                let motion = spec.motion(&mut self.renderer, place, &options, &mut say)?;
                self.warnings.append(&mut chosen);
                motion
            }
            (PlanPathKind::Photos { .. }, photo) => {
                let view = photo.and_then(|photo| place.scene().views.get(photo)).map(|view| view.camera);
                let view =
                    view.ok_or_else(|| Error::Unsupported(format!("{}: a photo is gone", self.plan.file)))?;
                CameraMotion::from(view)
            }
        };
        let motion = motion.driven(seconds, place.site().metres_per_unit)?;
        if open.motions.len() <= clip.way {
            open.motions.resize(clip.way + 1, None);
        }
        open.motions[clip.way] = Some(motion.clone());
        Ok(motion)
    }
}
