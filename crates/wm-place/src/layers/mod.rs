//! The layers that a frame is rendered with.
//!
//! A layer is one entry of `layers!`: its variant, its constant and its row, which has the name,
//! the words of help, the channels, what is drawn for it, its form as a PNG and its values in a
//! finished picture. The passes of a frame follow from the set of layers that a request asks for. A
//! layer that is a picture of its own has its row beside the function that draws it.

mod row;
mod set;

pub use row::LayerPasses;
pub(crate) use row::{LayerForm, LayerSpan, Row, Source};
pub use set::Layers;

use crate::picture::Picture;
use crate::{flow, labels, render};
use row::Source::{Frame, Part};
use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;
use wm_image::png::ChannelBits;
use wm_render::parts::PicturePart;
use wm_render::{Geometry, MedianDepth, ParticlePass, WaterPass};
use wm_scene::splats::LabelKind;

macro_rules! layers {
    ($($(#[$doc:meta])* $layer:ident $set:ident = $row:expr;)+) => {
        /// A layer of a picture.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum PictureLayer {
            $($(#[$doc])* $layer,)+
        }

        impl Layers {
            $($(#[$doc])* pub const $set: Self = Self::one(PictureLayer::$layer);)+
        }

        /// The rows of all layers, in the order in which messages list them and layers that are
        /// pictures of their own are drawn.
        static ROWS: &[(PictureLayer, Row)] = &[$((PictureLayer::$layer, $row)),+];
    };
}

layers! {
    /// The colour.
    Color COLOR = row("rgb", "", RGB, Frame(|_| {}), LayerForm::Color, |p| (&p.frame.rgb).into());
    /// Expected depth, metres.
    Depth DEPTH =
        row("depth", "metres", &["Z"], EXPECTED_DEPTH, LayerForm::Depth, |p| p.metres(&p.frame.depth));
    /// Median depth, metres.
    MedianDepth MEDIAN_DEPTH =
        row("median-depth", "", &["Z"], MEDIAN_DEPTH, LayerForm::Depth, |p| p.metres(&p.frame.median_depth));
    /// Normals, world axes, as blended: length 1 on one flat surface.
    Normal NORMAL =
        row("normal", "", &["X", "Y", "Z"], NORMALS, LayerForm::Normal, |p| (&p.frame.normal).into());
    /// Coverage, 0-1.
    Alpha ALPHA =
        row("alpha", "", &["A"], Frame(|_| {}), SHARE_16, |p| (&p.frame.alpha).into());
    /// The share of the scene's light that the air lets through.
    Transmittance TRANSMITTANCE = row(
        "transmittance", "of the air: one more render", RGB, Part(PicturePart::Transmittance),
        LayerForm::ColorShares, |p| (&p.parts.transmittance).into(),
    );
    /// Falling particles, and their coverage.
    Particles PARTICLES = row(
        "particles", "rain and snow in the air, with their coverage", &["R", "G", "B", "A"],
        Frame(|outputs| outputs.particles = ParticlePass::On),
        LayerForm::Particles, |p| (&p.frame.particles).into(),
    );
    /// The scene without air and without falling particles, linear RGB.
    Clean CLEAN = row(
        "clean", "without air and particles: one more", RGB, Part(PicturePart::Clean),
        LayerForm::Light, |p| (&p.parts.clean).into(),
    );
    /// The light that the air adds, linear RGB.
    Airlight AIRLIGHT = row(
        "airlight", "light that the air adds: three more", RGB, Part(PicturePart::Airlight),
        LayerForm::Light, |p| (&p.parts.airlight).into(),
    );
    /// Visible water: the share of a pixel that its surface covers, 0-1.
    Water WATER =
        row("water", "its share of a pixel", &["A"], WATER_SURFACE, SHARE_8, |p| p.or_zeros(&p.water.cover));
    /// Reflections: the share of a pixel's light that the water mirrors, 0-1.
    Reflection REFLECTION = row(
        "reflection", "of a pixel's light", &["A"], WATER_SURFACE,
        SHARE_8, |p| p.or_zeros(&p.water.reflected),
    );
    /// Depth of the water's surface, metres, 0 where there is none.
    WaterDepth WATER_DEPTH = row(
        "water-depth", "metres", &["Z"], WATER_SURFACE,
        LayerForm::Depth, |p| p.metres(&p.or_zeros(&p.water.depth)),
    );
    /// Optical flow of falling rain, snow and hail to the next frame, px to the right and down; NaN
    /// where nothing falls.
    ParticleFlow PARTICLE_FLOW = flow::particles::ROW;
    /// Optical flow of the scene to the next frame, px to the right and down.
    Flow FLOW = flow::ROW;
    /// The fate of each pixel of the flow: the numbers of [`crate::flow::FlowState`].
    FlowMask FLOW_MASK = flow::MASK_ROW;
    /// Motion vectors of temporal upscalers: from each pixel to where the frame before showed the
    /// same point, px to the right and down; 0 in the first frame, and for points that the frame
    /// before could not show.
    Motion MOTION = flow::motion::ROW;
    /// The label of what each pixel shows, 0 for none.
    Label LABEL = labels::LABEL_ROW;
    /// The instance ID of the object that each pixel shows, 0 for none.
    Instance INSTANCE = labels::INSTANCE_ROW;
    /// Depth of the surfaces, metres, without what falls and without the scene's own sky: the
    /// expected depth where it agrees with the median, else the median; 0 in the sky.
    SurfaceDepth SURFACE_DEPTH = flow::DEPTH_ROW;
    /// The view without any weather, in the light and under the sky of the photos.
    Clear CLEAR = render::CLEAR_ROW;
}

pub(crate) const RGB: &[&str] = &["R", "G", "B"];
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
    name: &'static str,
    note: &'static str,
    channels: &'static [&'static str],
    source: Source,
    form: LayerForm,
    values: fn(&Picture) -> Cow<'_, [f32]>,
) -> Row {
    Row { name, note, channels, source, span: LayerSpan::Exposure, form, values }
}

impl PictureLayer {
    /// Returns all layers.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        ROWS.iter().map(|(layer, _)| *layer)
    }

    pub(crate) fn row(self) -> &'static Row {
        &ROWS[self as usize].1
    }

    /// Returns the name, as in `--also`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().name
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

impl fmt::Display for PictureLayer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PictureLayer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.contains('.') {
            return Err(format!("`{text}`: a layer in memory has no format; leave out the extension"));
        }
        Self::find(text, PictureLayer::all())
    }
}

impl PictureLayer {
    /// Returns the layer of a name among some; the error lists their names.
    pub(crate) fn find(text: &str, among: impl Iterator<Item = Self> + Clone) -> Result<Self, String> {
        among.clone().find(|layer| layer.name() == text).ok_or_else(|| {
            let names: Vec<&str> = among.map(Self::name).collect();
            let (last, most) = names.split_last().expect("there are layers");
            format!("`{text}` is not a picture output: use {} or {last}", most.join(", "))
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_asked_for_is_rendered() {
        let passes = |names: &str| -> LayerPasses {
            let layers: Layers = names.split(',').map(|name| name.parse::<PictureLayer>().unwrap()).collect();
            LayerPasses::of(layers)
        };
        assert_eq!(passes("alpha").outputs.geometry, Geometry::None);
        assert_eq!(passes("depth,alpha").outputs.geometry, Geometry::Depth);
        assert_eq!(passes("normal,depth").outputs.geometry, Geometry::DepthNormal);
        assert_eq!(passes("median-depth").outputs.median_depth, MedianDepth::On);
        assert_eq!(passes("transmittance,alpha").outputs.particles, ParticlePass::Off);
        assert_eq!(passes("particles").outputs.particles, ParticlePass::On);
        assert_eq!(
            passes("depth,clean,transmittance").parts,
            [PicturePart::Transmittance, PicturePart::Clean]
        );
        let later = passes("surface-depth,flow-mask,label");
        assert!(!later.picture);
        assert_eq!(later.later, Layers::SURFACE_DEPTH | Layers::FLOW | Layers::LABEL);
        assert!(passes("rgb").picture && passes("water").picture);
    }

    #[test]
    fn sets_have_their_layers() {
        let set = Layers::COLOR | Layers::DEPTH;
        assert!(set.contains(Layers::DEPTH) && !set.contains(Layers::NORMAL));
        assert_eq!(set.iter().collect::<Vec<_>>(), [PictureLayer::Color, PictureLayer::Depth]);
        assert_eq!(set.without(Layers::COLOR), Layers::DEPTH);
        assert_eq!(Layers::default(), Layers::COLOR);
        assert!(PictureLayer::all().all(|layer| layer.name().parse() == Ok(layer)));
    }
}
