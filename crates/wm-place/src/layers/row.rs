//! The row of a layer, and the passes that the rows of a set ask for.

use super::Layers;
use crate::drawing::Drawing;
use crate::picture::Picture;
use crate::render::LaterFrame;
use std::borrow::Cow;
use std::pin::Pin;
use wm_image::png::ChannelBits;
use wm_render::parts::PicturePart;
use wm_render::{Outputs, Stats};

/// A layer, as everything that handles layers knows it.
pub(crate) struct Row {
    /// The name, as in `--also`.
    pub name: &'static str,
    /// A few words for help, after the name; empty if it says all.
    pub note: &'static str,
    /// The names of the channels in an EXR file.
    pub channels: &'static [&'static str],
    pub source: Source,
    pub span: LayerSpan,
    pub form: LayerForm,
    /// The values, `[H, W, C]`.
    pub values: fn(&Picture) -> Cow<'_, [f32]>,
}

/// The pictures that are drawn for a layer.
#[derive(Clone, Copy)]
pub(crate) enum Source {
    /// The picture's own pass: sets the outputs that it needs.
    Frame(fn(&mut Outputs)),
    /// A part of the picture, with passes of its own.
    Part(PicturePart),
    /// Pictures of their own, after the first one.
    Later(DrawLater),
    /// The pictures of another layer.
    With(Layers),
}

/// Draws a layer into a picture; returns what its colours took.
pub(crate) type DrawLater = for<'a> fn(
    &'a mut Drawing<'_>,
    &'a LaterFrame<'_>,
    &'a mut Picture,
) -> Pin<Box<dyn Future<Output = crate::Result<Stats>> + 'a>>;

/// The time that a layer is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerSpan {
    /// An exposure, or an instant.
    Exposure,
    /// An instant.
    Instant,
    /// From an instant to that of the next frame, which a request must name.
    ToNext,
    /// From an instant back to that of the frame before, if there is one.
    ToPrevious,
}

/// The form of a layer in a PNG file, and in the channels of an EXR file that holds it alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerForm {
    /// Display-referred colour.
    Color,
    /// Linear light.
    Light,
    /// Metres.
    Depth,
    /// World axes.
    Normal,
    /// One share a pixel.
    Share(ChannelBits),
    /// Shares of red, green and blue.
    ColorShares,
    /// Colour and coverage; a PNG has the coverage alone.
    Particles,
    /// Vectors, px.
    Flow,
    /// States of optical flow.
    States,
    /// IDs of 16 bits.
    Ids,
}

/// IDs of 16 bits as floats, which represent them exactly.
pub(crate) fn ids_as_f32(names: &[u16]) -> Cow<'_, [f32]> {
    names.iter().map(|name| f32::from(*name)).collect()
}

/// The passes that some layers need.
#[derive(Clone, Debug)]
pub struct LayerPasses {
    /// Something of the picture itself is wanted: colour, or what is drawn with it.
    pub picture: bool,
    /// The outputs of the pass over the scene.
    pub outputs: Outputs,
    /// The parts that air and particles add.
    pub parts: Vec<PicturePart>,
    /// The steps of the paper's rain and snow.
    pub(crate) stages: bool,
    /// The layers that draw pictures of their own.
    pub(crate) later: Layers,
}

impl LayerPasses {
    /// Returns the passes that layers need.
    #[must_use]
    pub fn of(layers: Layers) -> Self {
        let stages = layers.contains(Layers::PAPER_STAGES);
        let mut passes = Self {
            picture: stages,
            outputs: Outputs::default(),
            parts: Vec::new(),
            stages,
            later: Layers::NONE,
        };
        for layer in layers.iter() {
            match layer.row().source {
                Source::Frame(set) => {
                    passes.picture = true;
                    set(&mut passes.outputs);
                }
                Source::Part(part) => {
                    passes.picture = true;
                    passes.parts.push(part);
                }
                Source::Later(_) => passes.later |= layer.into(),
                Source::With(other) => passes.later |= other,
            }
        }
        passes
    }
}
