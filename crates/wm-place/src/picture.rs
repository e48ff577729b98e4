//! A rendered picture.

use crate::PictureLayer;
use std::collections::BTreeMap;
use wm_render::Frame;
use wm_render::hooks::Particle;
use wm_render::parts::PictureParts;
use wm_weather::paper::PaperStages;

/// A rendered frame, with the parts that were asked for.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Colour, geometry and what falls.
    pub frame: Frame,
    /// The scene without weather, the transmittance and the airlight, as far as they were asked
    /// for.
    pub parts: PictureParts,
    /// The water that it shows, if that was asked for.
    pub water: WaterLayers,
    /// The view without any weather, `[H, W, 3]` in the encoding of the frame.
    pub clear: Vec<f32>,
    /// The flow to the next frame.
    pub flow: SceneFlow,
    /// The labels of what is seen.
    pub labels: LabelLayers,
    /// The steps of the paper's rain and snow.
    pub stages: PaperStages,
    /// Metres in a unit of the frame's depth; 0 if nobody set it.
    pub metres_per_unit: f64,
    /// Names and values that are written into a file beside its pixels: the scene, the weather, the
    /// camera.
    pub tags: Vec<(String, String)>,
    /// The values of the other layers that are pictures of their own; the depth of surfaces is in
    /// scene units.
    pub(crate) later: BTreeMap<PictureLayer, Vec<f32>>,
    /// Arrays that the frame was made with and nobody asked for: memory for the next one.
    pub(crate) spare: SpareArrays,
    /// The particles of a picture that shows nothing else (`PinholeContent::Particles`), with their
    /// velocity relative to the camera, scene units a second.
    pub(crate) falling: Vec<(Particle, [f64; 3])>,
}

impl Picture {
    /// Removes the layers that are pictures of their own.
    pub(crate) fn clear_later(&mut self) {
        self.clear.clear();
        self.later.clear();
        (self.flow, self.labels) = Default::default();
    }

    /// The values of a layer among `later`; empty if it was not drawn.
    pub(crate) fn later(&self, layer: PictureLayer) -> &[f32] {
        self.later.get(&layer).map_or(&[], Vec::as_slice)
    }
}

/// Memory of arrays of a frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpareArrays {
    front: Vec<f32>,
    depth: Vec<f32>,
    particles: Vec<f32>,
}

impl SpareArrays {
    /// Lends the arrays to a frame where it has none.
    pub(crate) fn lend(&mut self, frame: &mut Frame) {
        for (spare, array) in self.arrays(frame) {
            if array.is_empty() {
                *array = std::mem::take(spare);
            }
        }
    }

    /// Takes arrays of a frame, those of depth and particles if they are not wanted.
    pub(crate) fn take(&mut self, frame: &mut Frame, wants_depth: bool, wants_particles: bool) {
        let wanted = [false, wants_depth, wants_particles];
        for ((spare, array), wanted) in self.arrays(frame).into_iter().zip(wanted) {
            if !wanted {
                *spare = std::mem::take(array);
            }
        }
    }

    fn arrays<'a>(&'a mut self, frame: &'a mut Frame) -> [(&'a mut Vec<f32>, &'a mut Vec<f32>); 3] {
        [
            (&mut self.front, &mut frame.front),
            (&mut self.depth, &mut frame.depth),
            (&mut self.particles, &mut frame.particles),
        ]
    }
}

/// The water in a picture, `[H, W]` each; empty where it was not asked for or the picture shows
/// none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaterLayers {
    /// The share of each pixel that is water's surface, 0-1.
    pub cover: Vec<f32>,
    /// The share of each pixel's light that the water mirrors: that times the reflectance, 0-1.
    pub reflected: Vec<f32>,
    /// View z of the surface, scene units; 0 where there is none.
    pub depth: Vec<f32>,
}

/// The flow from one picture to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneFlow {
    /// Pixels to the right and down from each pixel's middle, `[H, W, 2]`; NaN where
    /// [`FlowState::Unknown`](crate::flow::FlowState::Unknown).
    pub vectors: Vec<f32>,
    /// The [`FlowState`](crate::flow::FlowState) of each pixel as its number, `[H, W]`.
    pub states: Vec<u8>,
}

/// The labels in a picture, `[H, W]`; empty where the place has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LabelLayers {
    /// The class of what each pixel shows, 0 for none.
    pub label: Vec<u16>,
    /// The thing that each pixel shows, 0 for none.
    pub instance: Vec<u16>,
}
