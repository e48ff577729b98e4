//! The layers that a frame is rendered with.
//!
//! A layer is one row of [`ROWS`]: its name, its channels, what is drawn for it, its values in a
//! finished picture and its form as a PNG. The passes of a frame follow from the set of layers that
//! a request asks for.

use crate::camera_model::CameraModel;
use crate::picture::Picture;
use crate::{Error, Result};
use std::borrow::Cow;
use std::fmt;
use std::ops::{BitOr, BitOrAssign};
use std::str::FromStr;
use wm_image::png::ChannelBits;
use wm_render::parts::PicturePart;
use wm_render::{Geometry, MedianDepth, Outputs, ParticlePass, WaterPass};
use wm_scene::splats::LabelKind;
use wm_weather::{Fidelity, Weather};

/// A layer of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PictureLayer {
    /// The colour.
    Color,
    /// The same view without any weather, in the light and under the sky of the photos.
    Clear,
    /// Expected depth, metres.
    Depth,
    /// Median depth, metres.
    MedianDepth,
    /// Depth of the surfaces, metres, without what falls and without the scene's own sky: the
    /// expected depth where it agrees with the median, else the median; 0 in the sky.
    SurfaceDepth,
    /// Normals, world axes, as blended: length 1 on one flat surface.
    Normal,
    /// Coverage, 0-1.
    Alpha,
    /// The share of the scene's light that the air lets through.
    Transmittance,
    /// Falling particles, and their coverage.
    Particles,
    /// The scene without air and without falling particles, linear RGB.
    Clean,
    /// The light that the air adds, linear RGB.
    Airlight,
    /// Visible water: the share of a pixel that its surface covers, 0-1.
    Water,
    /// Reflections: the share of a pixel's light that the water mirrors, 0-1.
    Reflection,
    /// Depth of the water's surface, metres, 0 where there is none.
    WaterDepth,
    /// Optical flow of the scene to the next frame, px to the right and down.
    Flow,
    /// The fate of each pixel of the flow: the numbers of [`crate::flow::FlowState`].
    FlowMask,
    /// Optical flow of falling rain, snow and hail to the next frame, px to the right and down.
    ParticleFlow,
    /// The label of what each pixel shows, 0 for none.
    Label,
    /// The instance ID of the object that each pixel shows, 0 for none.
    Instance,
}

/// What is drawn for a layer.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// An output of the picture's own pass.
    Frame(Outputs),
    /// A part of the picture, with passes of its own.
    Part(PicturePart),
    /// Pictures of their own, after the first one: their field among the passes.
    Later(fn(&mut LayerPasses) -> &mut bool),
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

/// The values of a layer, `[H, W, C]`.
type Values = fn(&Picture) -> Cow<'_, [f32]>;

/// A layer, as everything that handles layers knows it.
struct Row {
    layer: PictureLayer,
    name: &'static str,
    channels: &'static [&'static str],
    source: Source,
    form: LayerForm,
    values: Values,
}

const PLAIN: Outputs = Outputs {
    geometry: Geometry::None,
    median_depth: MedianDepth::Off,
    particles: ParticlePass::Off,
    water: WaterPass::Off,
};

const RGB: &[&str] = &["R", "G", "B"];

/// All layers, in the order in which messages list them.
static ROWS: [Row; 19] = {
    use LayerForm as F;
    use PictureLayer as P;
    use Source::{Frame, Later, Part};
    let depth = Frame(Outputs { geometry: Geometry::Depth, ..PLAIN });
    let median = Frame(Outputs { median_depth: MedianDepth::On, ..PLAIN });
    let normal = Frame(Outputs { geometry: Geometry::DepthNormal, ..PLAIN });
    let particles = Frame(Outputs { particles: ParticlePass::On, ..PLAIN });
    let water = Frame(Outputs { water: WaterPass::On, ..PLAIN });
    let alpha = F::Share(ChannelBits::Sixteen);
    let cover = F::Share(ChannelBits::Eight);
    let flow = Later(|passes| &mut passes.flow);
    let labels = Later(|passes| &mut passes.labels);
    let (transmittance, clean, airlight) =
        (Part(PicturePart::Transmittance), Part(PicturePart::Clean), Part(PicturePart::Airlight));
    [
        row(P::Color, "rgb", RGB, Frame(PLAIN), F::Color, |p| p.frame.rgb.as_slice().into()),
        row(P::Depth, "depth", &["Z"], depth, F::Depth, |p| p.metres(&p.frame.depth)),
        row(P::MedianDepth, "median-depth", &["Z"], median, F::Depth, |p| p.metres(&p.frame.median_depth)),
        row(P::Normal, "normal", &["X", "Y", "Z"], normal, F::Normal, |p| p.frame.normal.as_slice().into()),
        row(P::Alpha, "alpha", &["A"], Frame(PLAIN), alpha, |p| p.frame.alpha.as_slice().into()),
        row(P::Transmittance, "transmittance", RGB, transmittance, F::ColorShares, |p| {
            p.parts.transmittance.as_slice().into()
        }),
        row(P::Particles, "particles", &["R", "G", "B", "A"], particles, F::Particles, |p| {
            p.frame.particles.as_slice().into()
        }),
        row(P::Clean, "clean", RGB, clean, F::Light, |p| p.parts.clean.as_slice().into()),
        row(P::Airlight, "airlight", RGB, airlight, F::Light, |p| p.parts.airlight.as_slice().into()),
        row(P::Water, "water", &["A"], water, cover, |p| p.or_zeros(&p.water.cover)),
        row(P::Reflection, "reflection", &["A"], water, cover, |p| p.or_zeros(&p.water.reflected)),
        row(P::WaterDepth, "water-depth", &["Z"], water, F::Depth, |p| p.metres(&p.or_zeros(&p.water.depth))),
        row(P::Flow, "flow", &["U", "V"], flow, F::Flow, |p| p.flow.vectors.as_slice().into()),
        row(P::FlowMask, "flow-mask", &["STATE"], flow, F::States, |p| {
            p.flow.states.iter().map(|state| f32::from(*state)).collect()
        }),
        row(
            P::ParticleFlow,
            "particle-flow",
            &["U", "V"],
            Later(|passes| &mut passes.particle_flow),
            F::Flow,
            |p| p.particle_flow.as_slice().into(),
        ),
        row(P::Label, "label", &["ID"], labels, F::Ids, |p| ids_as_f32(&p.labels.label)),
        row(P::Instance, "instance", &["ID"], labels, F::Ids, |p| ids_as_f32(&p.labels.instance)),
        row(
            P::SurfaceDepth,
            "surface-depth",
            &["Z"],
            Later(|passes| &mut passes.surface_depth),
            F::Depth,
            |p| p.metres(&p.surface_depth),
        ),
        row(P::Clear, "clear", RGB, Later(|passes| &mut passes.clear), F::Color, |p| {
            p.clear.as_slice().into()
        }),
    ]
};

const fn row(
    layer: PictureLayer,
    name: &'static str,
    channels: &'static [&'static str],
    source: Source,
    form: LayerForm,
    values: Values,
) -> Row {
    Row { layer, name, channels, source, form, values }
}

/// IDs of 16 bits as floats, which represent them exactly.
fn ids_as_f32(names: &[u16]) -> Cow<'_, [f32]> {
    names.iter().map(|name| f32::from(*name)).collect()
}

impl PictureLayer {
    /// Returns all layers.
    pub fn all() -> impl Iterator<Item = Self> + Clone {
        ROWS.iter().map(|row| row.layer)
    }

    fn row(self) -> &'static Row {
        ROWS.iter().find(|row| row.layer == self).expect("every layer has a row")
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

    /// Returns true if the layer leads from one frame to the next, so that a request must name both.
    #[must_use]
    pub fn needs_next_frame(self) -> bool {
        let passes = LayerPasses::of(self.into());
        passes.flow || passes.particle_flow
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

    fn metres(&self, depth: &[f32]) -> Cow<'static, [f32]> {
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

/// A set of layers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Layers(u32);

macro_rules! sets {
    ($($(#[$doc:meta])* $name:ident = $layer:ident;)*) => {
        impl Layers {
            $($(#[$doc])* pub const $name: Self = Self(1 << PictureLayer::$layer as u32);)*
        }
    };
}

sets! {
    /// The colour.
    COLOR = Color;
    /// [`PictureLayer::Clear`].
    CLEAR = Clear;
    /// [`PictureLayer::Depth`].
    DEPTH = Depth;
    /// [`PictureLayer::MedianDepth`].
    MEDIAN_DEPTH = MedianDepth;
    /// [`PictureLayer::SurfaceDepth`].
    SURFACE_DEPTH = SurfaceDepth;
    /// [`PictureLayer::Normal`].
    NORMAL = Normal;
    /// [`PictureLayer::Alpha`].
    ALPHA = Alpha;
    /// [`PictureLayer::Transmittance`].
    TRANSMITTANCE = Transmittance;
    /// [`PictureLayer::Particles`].
    PARTICLES = Particles;
    /// [`PictureLayer::Clean`].
    CLEAN = Clean;
    /// [`PictureLayer::Airlight`].
    AIRLIGHT = Airlight;
    /// [`PictureLayer::Water`].
    WATER = Water;
    /// [`PictureLayer::Reflection`].
    REFLECTION = Reflection;
    /// [`PictureLayer::WaterDepth`].
    WATER_DEPTH = WaterDepth;
    /// [`PictureLayer::Flow`].
    FLOW = Flow;
    /// [`PictureLayer::FlowMask`].
    FLOW_MASK = FlowMask;
    /// [`PictureLayer::ParticleFlow`].
    PARTICLE_FLOW = ParticleFlow;
    /// [`PictureLayer::Label`].
    LABEL = Label;
    /// [`PictureLayer::Instance`].
    INSTANCE = Instance;
}

impl Layers {
    /// The steps between the clear picture and the last of the paper's rain and snow:
    /// [`Picture::stages`].
    pub const PAPER_STAGES: Self = Self(1 << 31);

    /// Returns true if all layers of `other` are in the set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the layers of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the set without those of another.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the layers of the set.
    pub fn iter(self) -> impl Iterator<Item = PictureLayer> {
        PictureLayer::all().filter(move |layer| self.contains((*layer).into()))
    }
}

impl Default for Layers {
    /// The colour alone.
    fn default() -> Self {
        Self::COLOR
    }
}

impl From<PictureLayer> for Layers {
    fn from(layer: PictureLayer) -> Self {
        Self(1 << layer as u32)
    }
}

impl BitOr for Layers {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        self.with(other)
    }
}

impl BitOrAssign for Layers {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl FromIterator<PictureLayer> for Layers {
    /// These layers alone, without the colour if it is not among them.
    fn from_iter<T: IntoIterator<Item = PictureLayer>>(layers: T) -> Self {
        layers.into_iter().fold(Self(0), |set, layer| set | layer.into())
    }
}

impl fmt::Debug for Layers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stages = self.contains(Self::PAPER_STAGES).then_some("paper-stages");
        f.debug_set().entries(self.iter().map(PictureLayer::name).chain(stages)).finish()
    }
}

/// The passes that some layers need.
#[derive(Clone, Debug, Default)]
pub struct LayerPasses {
    /// Something of the picture itself is wanted: colour, or what is drawn with it.
    pub picture: bool,
    /// The outputs of the pass over the scene.
    pub outputs: Outputs,
    /// The parts that air and particles add.
    pub parts: Vec<PicturePart>,
    /// The steps of the paper's rain and snow.
    pub(crate) stages: bool,
    pub(crate) clear: bool,
    pub(crate) surface_depth: bool,
    pub(crate) flow: bool,
    pub(crate) particle_flow: bool,
    pub(crate) labels: bool,
}

impl LayerPasses {
    /// Returns the passes that layers need.
    #[must_use]
    pub fn of(layers: Layers) -> Self {
        let stages = layers.contains(Layers::PAPER_STAGES);
        let mut passes = Self { stages, picture: stages, ..Self::default() };
        for layer in layers.iter() {
            match layer.row().source {
                Source::Frame(outputs) => {
                    passes.picture = true;
                    passes.outputs = union(passes.outputs, outputs);
                }
                Source::Part(part) => {
                    passes.picture = true;
                    passes.parts.push(part);
                }
                Source::Later(pass) => *pass(&mut passes) = true,
            }
        }
        passes
    }
}

fn union(a: Outputs, b: Outputs) -> Outputs {
    let geometry = match (a.geometry, b.geometry) {
        (Geometry::DepthNormal, _) | (_, Geometry::DepthNormal) => Geometry::DepthNormal,
        (Geometry::Depth, _) | (_, Geometry::Depth) => Geometry::Depth,
        (Geometry::None, Geometry::None) => Geometry::None,
    };
    Outputs {
        geometry,
        median_depth: if a.median_depth == MedianDepth::Off { b.median_depth } else { a.median_depth },
        particles: if a.particles == ParticlePass::Off { b.particles } else { a.particles },
        water: if a.water == WaterPass::Off { b.water } else { a.water },
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
        if passes.particle_flow && model.lens.is_some() {
            return fault("layer particle-flow: is of pinholes alone; leave out the lens or the layer");
        }
        if passes.particle_flow && weather.fidelity == Fidelity::Paper {
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
        if (passes.flow || passes.particle_flow || passes.labels) && !model.shutter.is_instant() {
            return fault(
                "layers flow and label are those of one instant: use no exposure time and no readout",
            );
        }
        Ok(())
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
        assert!(!later.picture && later.surface_depth && later.flow && later.labels && !later.clear);
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
        // Every variant has one row.
        let all: Layers = PictureLayer::all().collect();
        assert_eq!(all.0, (1 << (PictureLayer::Instance as u32 + 1)) - 1);
    }
}
