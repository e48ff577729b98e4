//! The row of a layer.

use super::Layers;
use crate::drawing::Drawing;
use crate::frame_camera::FrameCamera;
use crate::picture::Picture;
use crate::shot::PinholeShot;
use std::borrow::Cow;
use std::pin::Pin;
use wm_image::png::ChannelBits;
use wm_render::parts::PicturePart;
use wm_render::{Outputs, Stats};
use wm_scene::Camera;

/// The channels of colours.
pub(super) const RGB: &[&str] = &["R", "G", "B"];

/// A layer, as everything that handles layers knows it.
pub(crate) struct Row {
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

/// A frame, for layers that are pictures of their own.
pub(crate) struct LaterFrame<'a> {
    pub shot: PinholeShot<'a>,
    pub camera: FrameCamera<'a>,
    /// The number of the frame.
    pub index: u32,
    /// The next frame, if the request names one: layers that lead to it need it.
    pub next: Option<PinholeShot<'a>>,
    /// The camera of the frame before; `None` in the first.
    pub previous: Option<Camera>,
}
