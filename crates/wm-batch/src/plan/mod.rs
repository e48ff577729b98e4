//! The plan of a data set: a TOML file.

mod file;

use super::store::hex;
use super::weathers::WeatherSource;
use crate::{LayerNeeds, Layout};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};
use wm_place::levels::LevelBudget;
use wm_place::output::{LayerFile, PictureFormat, layers_of};
use wm_place::rig::Rig;
use wm_place::{Layers, MotionSpec};
use wm_scene::Metadata;

/// Most frames of a set: file names have eight digits.
pub(super) const MAX_FRAMES: u64 = 100_000_000;
/// The layout of this program's own files.
pub const FRAMES_LAYOUT: &str = "frames";
/// The plan of a data set: scenes, paths, weathers, sensors and times, from which every frame
/// follows.
#[derive(Clone, Debug)]
pub struct BatchPlan {
    /// The file, for messages.
    pub file: String,
    /// The name: letters, digits, `-` and `_`.
    pub name: String,
    /// A description in one line.
    pub about: String,
    /// The seed of weathers, of what falls and of noise.
    pub seed: u64,
    /// Frames of a clip.
    pub frames: u32,
    /// Frames a second.
    pub frame_rate: f64,
    /// Frames of a block: what is made in one go and marked as done.
    pub block: u32,
    /// The time of the first frame, seconds since 1970 (UTC).
    pub(crate) start: i64,
    /// The layouts that are written, apart from [`FRAMES_LAYOUT`].
    pub layouts: Vec<&'static Layout>,
    /// True if the layout [`FRAMES_LAYOUT`] is written.
    pub(crate) writes_frames: bool,
    /// The format of its pictures.
    pub(crate) picture: PictureFormat,
    /// The pictures beside the colour in that layout.
    pub(crate) also: Vec<LayerFile>,
    /// True if the same view without weather is written beside each of its pictures.
    pub(crate) pairs: bool,
    /// The names of the labels of splats, from 1.
    pub labels: Vec<String>,
    /// The parts of the set and their shares, which sum to 1.
    pub splits: Vec<(String, f64)>,
    /// The scenes.
    pub scenes: Vec<PlanScene>,
    /// The paths.
    pub(crate) paths: Vec<PlanPath>,
    /// The sensors.
    pub(crate) rig: PlanRig,
    /// The weathers.
    pub(crate) weathers: Vec<WeatherSource>,
    /// The SHA-256 of all that the frames follow from, but for the scenes, in hexadecimal digits.
    pub digest: String,
}

/// A scene of a plan.
#[derive(Clone, Debug)]
pub struct PlanScene {
    /// The name: letters, digits, `-` and `_`.
    pub name: String,
    /// The file.
    pub file: PathBuf,
    /// Facts that win over those of the file.
    pub(crate) facts: Metadata,
    /// The most that it may take if it is in levels of detail.
    pub(crate) budget: LevelBudget,
}

/// A path, or the cameras of a scene's photos.
#[derive(Clone, Debug)]
pub(crate) struct PlanPath {
    /// The name: letters, digits, `-` and `_`.
    pub(crate) name: String,
    /// The scene; `None` for all of them.
    pub(crate) scene: Option<String>,
    /// The way.
    pub(crate) kind: PlanPathKind,
}

/// The way of a [`PlanPath`].
#[derive(Clone, Debug)]
pub(crate) enum PlanPathKind {
    /// The rig moves.
    Motion(MotionSpec),
    /// The rig stands where each photo was taken, every `every`-th of them.
    Photos {
        /// Steps between photos.
        every: u32,
    },
}

/// The sensors of a plan.
#[derive(Clone, Debug)]
pub(crate) enum PlanRig {
    /// A rig.
    Rig(Box<Rig>),
    /// One camera of this size, px, and vertical field of view, degrees.
    Camera {
        /// Width and height, px.
        size: (u32, u32),
        /// Degrees.
        fov: f64,
    },
    /// One camera as the photos were taken with.
    Photos,
}

impl BatchPlan {
    /// The layers that the plan's files and layouts have of a camera.
    pub(crate) fn layers(&self) -> Layers {
        let mut layers = layers_of(&self.also);
        let layouts = self.layouts.iter().map(|layout| layout.needs);
        let needs = layouts.fold(LayerNeeds::default(), LayerNeeds::or);
        for (layer, is_needed) in [
            (Layers::CLEAR, needs.clean || self.pairs),
            (Layers::SURFACE_DEPTH, needs.depth),
            (Layers::FLOW | Layers::FLOW_MASK, needs.flow),
        ] {
            if is_needed {
                layers |= layer;
            }
        }
        layers
    }
}

/// Letters, digits, `-` and `_`, of a text; others become `-`.
pub(super) fn slug(text: &str) -> String {
    let clean: String =
        text.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' }).collect();
    let clean: Vec<&str> = clean.split('-').filter(|part| !part.is_empty()).collect();
    let mut clean = clean.join("-");
    clean.truncate(48);
    clean
}

impl BatchPlan {
    /// A digest of all that frames follow from, but for the scenes: of what was read, not of how it
    /// was written.
    fn own_digest(&self, folder: &Path) -> String {
        let layouts: Vec<&str> = self.layouts.iter().map(|layout| layout.name).collect();
        let scenes: Vec<_> =
            self.scenes.iter().map(|scene| (&scene.name, &scene.facts, scene.budget)).collect();
        let text = format!(
            "{} {:?} {:?} {:?} {layouts:?} {scenes:?} {:?} {:?} {:?}",
            env!("CARGO_PKG_VERSION"),
            (&self.name, &self.about, self.seed, self.frames, self.frame_rate, self.block, self.start),
            (self.writes_frames, self.picture, &self.also, self.pairs),
            (&self.labels, &self.splits),
            &self.paths,
            &self.rig,
            &self.weathers,
        );
        // The same plan in another folder is the same plan; without a folder (`plan.toml`) paths
        // are as they were written.
        let text = match folder.as_os_str().is_empty() {
            true => text,
            false => text.replace(&format!("{}/", folder.display()), ""),
        };
        hex(&Sha256::digest(text.as_bytes()))
    }
}
