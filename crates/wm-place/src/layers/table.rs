//! The rows of all layers, and what follows from those of a set.

use super::clear;
use super::row::{LayerForm, LayerSpan, RGB, Row, Source};
use super::set::{Layers, PictureLayer};
use crate::camera_model::CameraModel;
use crate::picture::Picture;
use crate::{Error, Result, flow, labels};
use Source::{Frame, Part};
use std::borrow::Cow;
use wm_image::png::ChannelBits;
use wm_render::parts::PicturePart;
use wm_render::{Geometry, MedianDepth, Outputs, ParticlePass, WaterPass};
use wm_scene::splats::LabelKind;
use wm_weather::{Fidelity, Weather};

macro_rules! rows {
    ($($(#[$doc:meta])* $layer:ident $set:ident $name:literal = $row:expr;)+) => {
        /// The row of each layer, in the order of [`PictureLayer`].
        static ROWS: &[Row] = &[$($row),+];
    };
}

layers!(rows);

const SHARE_8: LayerForm = LayerForm::Share(ChannelBits::Eight);
const SHARE_16: LayerForm = LayerForm::Share(ChannelBits::Sixteen);
const WATER_SURFACE: Source = Frame(|outputs| outputs.water = WaterPass::On);
const MEDIAN_DEPTH: Source = Frame(|outputs| outputs.median_depth = MedianDepth::On);
const NORMALS: Source = Frame(|outputs| outputs.geometry = Geometry::DepthNormal);
/// The expected depth, which normals bring too.
const EXPECTED_DEPTH: Source = Frame(|outputs| {
    if outputs.geometry == Geometry::None {
        outputs.geometry = Geometry::Depth;
    }
});

/// The row of a layer that is drawn with the picture itself, at an instant or over an exposure.
const fn row(
    note: &'static str,
    channels: &'static [&'static str],
    source: Source,
    form: LayerForm,
    values: fn(&Picture) -> Cow<'_, [f32]>,
) -> Row {
    Row { note, channels, source, span: LayerSpan::Exposure, form, values }
}

impl PictureLayer {
    pub(crate) fn row(self) -> &'static Row {
        &ROWS[self as usize]
    }

    /// Returns the names of the channels in an EXR file.
    #[must_use]
    pub fn channels(self) -> &'static [&'static str] {
        self.row().channels
    }

    /// Returns a few words for help, after the name; empty if that says all.
    #[must_use]
    pub fn note(self) -> &'static str {
        self.row().note
    }

    pub(crate) fn form(self) -> LayerForm {
        self.row().form
    }

    /// Returns the kind of labels of a layer of names.
    #[must_use]
    pub fn label_kind(self) -> Option<LabelKind> {
        match self {
            Self::Label => Some(LabelKind::Label),
            Self::Instance => Some(LabelKind::Instance),
            _ => None,
        }
    }

    /// Returns true if the layer leads from one frame to another, which a request names too.
    #[must_use]
    pub fn needs_another_frame(self) -> bool {
        matches!(self.row().span, LayerSpan::ToNext | LayerSpan::ToPrevious)
    }

    /// Returns true if the layer is of an instant alone, and not of an exposure.
    #[must_use]
    pub fn is_of_instant(self) -> bool {
        self.row().span != LayerSpan::Exposure
    }
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
                Frame(set) => {
                    passes.picture = true;
                    set(&mut passes.outputs);
                }
                Part(part) => {
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

impl Layers {
    /// Checks that a camera and a weather can have the layers.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the layer.
    pub fn check(self, model: &CameraModel, weather: &Weather) -> Result<()> {
        let fault = |says: &str| Err(Error::Unsupported(says.into()));
        let passes = LayerPasses::of(self);
        if self.contains(Self::PARTICLE_FLOW) && model.lens.is_some() {
            return fault("layer particle-flow: is of pinholes alone; leave out the lens or the layer");
        }
        if self.contains(Self::PARTICLE_FLOW) && weather.fidelity == Fidelity::Paper {
            return fault(
                "layer particle-flow: rain and snow of fidelity paper have none; use fidelity physical",
            );
        }
        if !passes.parts.is_empty() && weather.fidelity == Fidelity::Paper {
            return fault(
                "layers transmittance, clean and airlight: weather of fidelity paper has none; use fidelity physical",
            );
        }
        if passes.stages && weather.fidelity != Fidelity::Paper {
            return fault("the steps of the paper's rain and snow need fidelity paper");
        }
        if !model.shutter.is_instant()
            && let Some(layer) = self.iter().find(|layer| layer.is_of_instant())
        {
            return fault(&format!("layer {layer} shows one instant: use no exposure time and no readout"));
        }
        Ok(())
    }
}

impl Picture {
    /// Returns the values of a layer that was rendered, `[H, W, C]` with the channels of
    /// [`PictureLayer::channels`]: metres, world axes, shares, px, names, and linear light but for
    /// the colours, which have the encoding of the frame. Empty if it was not asked
    /// for; layers of water are zeros in a picture that has none.
    #[must_use]
    pub fn layer(&self, layer: PictureLayer) -> Cow<'_, [f32]> {
        (layer.row().values)(self)
    }

    pub(crate) fn metres(&self, depth: &[f32]) -> Cow<'static, [f32]> {
        depth.iter().map(|z| (f64::from(*z) * self.metres_per_unit) as f32).collect()
    }

    /// Returns the values of a layer of water; zeros in a picture that shows none.
    fn or_zeros<'a>(&self, values: &'a [f32]) -> Cow<'a, [f32]> {
        match values {
            [] => Cow::Owned(vec![0.0; self.frame.pixels()]),
            values => Cow::Borrowed(values),
        }
    }
}
