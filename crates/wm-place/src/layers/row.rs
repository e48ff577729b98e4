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

/// Draws a layer into a picture. Returns the counts and times of its colours; those of depth and of
/// labels do not count.
pub(crate) type DrawLater = for<'a> fn(
    &'a mut Drawing<'_>,
    &'a LaterFrame<'_>,
    &'a mut Picture,
) -> Pin<Box<dyn Future<Output = crate::Result<Stats>> + 'a>>;

/// The time that a layer shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LayerSpan {
    /// An exposure, or an instant.
    Exposure,
    /// An instant.
    Instant,
    /// The way from an instant to that of the next frame, which a request must name.
    ToNext,
    /// The way from an instant back to that of the frame before, if there is one.
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
    /// One share per pixel.
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
