//! The background on the GPU. It is one colour, or a picture that the CPU paints and uploads: skies
//! and panoramas have no form for the GPU yet. Pixel effects run on the CPU, on the picture that
//! came back.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{COLOR, StagePrograms, TRAINING, WORKGROUP, switches, texts};
use crate::stages::particles::gpu::OVER;
use crate::stages::rasterize_backward::gpu::ForwardPictures;
use std::borrow::Cow;

/// The form of the background behind the splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum BackgroundForm {
    /// One colour.
    Color,
    /// Colours interpolated between nodes; the number of nodes along a side of each patch.
    Nodes(u32),
    /// A picture.
    Picture,
}

impl BackgroundForm {
    /// Every kind.
    pub(crate) const ALL: [Self; 4] = [Self::Color, Self::Nodes(4), Self::Nodes(8), Self::Picture];
}

/// The pictures that particles are drawn into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum ParticleBlend {
    /// There are none.
    #[default]
    None,
    /// Over the colour.
    InColor,
    /// Over the colour, and into a picture of their own.
    Separate,
    /// Into a picture of their own alone.
    Apart,
}

/// One colour behind everything.
const ONE_COLOR: &str =
    "fn behind(at: u32) -> vec3<f32> { return vec3<f32>(background[0], background[1], background[2]); }";
/// A picture behind it, `[H, W, 3]`.
const PICTURE: &str = "fn behind(at: u32) -> vec3<f32> {
    return vec3<f32>(background[3u * at], background[3u * at + 1u], background[3u * at + 2u]);
}";
/// No particles.
const NO_PARTICLES: &str = "fn with_falling(at: u32, rgb: vec3<f32>) -> vec3<f32> { return rgb; }";

/// The programs that finish pictures.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum CompositeProgram {
    /// Puts the background behind and the particles before the splats.
    Composite(BackgroundForm, ParticleBlend),
    /// Makes the pictures of a step of training from its sums.
    Finish(Channels),
}

impl StagePrograms for CompositeProgram {
    fn all() -> Vec<Self> {
        let mut all: Vec<Self> = Channels::ALL.map(Self::Finish).into();
        for particles in
            [ParticleBlend::None, ParticleBlend::InColor, ParticleBlend::Separate, ParticleBlend::Apart]
        {
            all.extend(BackgroundForm::ALL.map(|form| Self::Composite(form, particles)));
        }
        all
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Composite(..) => "composite",
            Self::Finish(_) => "finish",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Composite(form, particles) => {
                let mut parts = match form {
                    BackgroundForm::Color => texts([ONE_COLOR]),
                    BackgroundForm::Nodes(nodes) => {
                        vec![format!("const NODES = {nodes}u;").into(), include_str!("nodes.wgsl").into()]
                    }
                    BackgroundForm::Picture => texts([PICTURE]),
                };
                if *particles == ParticleBlend::None {
                    parts.push(NO_PARTICLES.into());
                } else {
                    let is_apart = matches!(particles, ParticleBlend::Separate | ParticleBlend::Apart);
                    let is_over = *particles != ParticleBlend::Apart;
                    parts.push(
                        format!("const APART: bool = {is_apart};\nconst OVER: bool = {is_over};").into(),
                    );
                    parts.extend(texts([COLOR, OVER]));
                }
                parts.push(include_str!("composite.wgsl").into());
                parts
            }
            Self::Finish(channels) => {
                vec![switches(*channels), TRAINING.into(), include_str!("finish.wgsl").into()]
            }
        }
    }
}

/// The buffers that `composite.wgsl` reads and writes.
pub(crate) struct Composite<'a> {
    pub(crate) rgb: &'a wgpu::Buffer,
    pub(crate) alpha: &'a wgpu::Buffer,
    pub(crate) background: &'a wgpu::Buffer,
    /// Sums of what falls, see `over.wgsl`.
    pub(crate) falling: &'a wgpu::Buffer,
    /// The picture of the particles by themselves.
    pub(crate) apart: &'a wgpu::Buffer,
}

impl Composite<'_> {
    /// Finishes `pixels` pixels.
    pub(crate) fn record(
        &self,
        recorder: &mut Recorder<'_>,
        pixels: u32,
        form: BackgroundForm,
        particles: ParticleBlend,
    ) {
        let mut bindings = with_buffers(vec![(0, recorder.view())], [self.rgb, self.alpha, self.background]);
        if particles != ParticleBlend::None {
            bindings.extend([(4, self.falling.as_entire_binding()), (5, self.apart.as_entire_binding())]);
        }
        let groups = Groups::Direct(pixels.div_ceil(WORKGROUP));
        recorder.dispatch(CompositeProgram::Composite(form, particles), groups, bindings);
    }
}

/// The buffers that `finish.wgsl` reads and writes: the pictures of a step of training.
pub(crate) struct Finish<'a> {
    pub(crate) kept: ForwardPictures<'a>,
    pub(crate) rgb: &'a wgpu::Buffer,
    pub(crate) depths: &'a wgpu::Buffer,
    pub(crate) normal: &'a wgpu::Buffer,
}

impl Finish<'_> {
    /// Finishes `pixels` pixels; `training` is the structure of that name.
    pub(crate) fn record(
        &self,
        recorder: &mut Recorder<'_>,
        pixels: u32,
        channels: Channels,
        training: wgpu::BindingResource<'_>,
    ) {
        let bindings = with_buffers(
            vec![(0, recorder.view()), (1, training)],
            [
                self.kept.rgb,
                self.kept.alpha,
                self.kept.depths,
                self.kept.normal,
                self.rgb,
                self.depths,
                self.normal,
            ],
        );
        recorder.dispatch(
            CompositeProgram::Finish(channels),
            Groups::Direct(pixels.div_ceil(WORKGROUP)),
            bindings,
        );
    }
}
