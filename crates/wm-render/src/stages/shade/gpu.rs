//! The air on the GPU: part of the projection (`crate::stages::project::gpu`), and here by itself.

#[cfg(any(test, feature = "testing"))]
use crate::gpu::recorder::{Groups, Recorder};
#[cfg(any(test, feature = "testing"))]
use crate::gpu::source::WORKGROUP;
use crate::gpu::source::{COLOR, StagePrograms, texts};
#[cfg(any(test, feature = "testing"))]
use crate::hooks::GROUP;
use crate::hooks::WgslSource;
use crate::plan::Shading;
use std::borrow::Cow;

/// The text that shades one splat.
pub(crate) const SHADE: &str = include_str!("shade.wgsl");
/// The haze of photos.
pub(crate) const PHOTO_AIR: &str = include_str!("photo_air.wgsl");
/// The air's primitives.
const AIR: &str = include_str!("air.wgsl");
/// Clear air: colours stay as they are.
const CLEAR_AIR: &str =
    "fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> { return rgb; }";
/// Clear air: every share of light is 1.
const FULL_SHARE: &str = "fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> { return vec3<f32>(1.0); }";

/// The effect of the air on the colour of a splat.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum AirText {
    /// The colour itself: clear air.
    Clear,
    /// The colour through the air of this text.
    Color(Cow<'static, str>),
    /// The colour through the haze of photos, which is a part of the view.
    Photos,
    /// A share of 1: clear air.
    FullShare,
    /// The share of light that the air of this text lets through.
    Share(Cow<'static, str>),
}

impl AirText {
    /// The program's part for an air.
    #[must_use]
    pub(crate) fn new(shading: Shading, air: Option<&WgslSource>) -> Self {
        match (shading, air.map(|air| air.wgsl.clone())) {
            (Shading::Color, None) => Self::Clear,
            (Shading::Color, Some(text)) => Self::Color(text),
            (Shading::Transmittance, None) => Self::FullShare,
            (Shading::Transmittance, Some(text)) => Self::Share(text),
        }
    }

    /// The texts that define `through_air`, after [`COLOR`].
    pub(crate) fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Clear => texts([CLEAR_AIR]),
            Self::Photos => texts([PHOTO_AIR, include_str!("color_through_photo_air.wgsl")]),
            Self::FullShare => texts([FULL_SHARE]),
            Self::Color(air) => {
                vec![AIR.into(), air.clone(), include_str!("color_through_air.wgsl").into()]
            }
            Self::Share(air) => vec![AIR.into(), air.clone(), include_str!("share_through_air.wgsl").into()],
        }
    }
}

/// The programs of the air by itself.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ShadeProgram {
    /// Changes the colours of groups of splats to those seen through the air of this text.
    #[allow(dead_code, reason = "tests alone shade groups without a projection")]
    Groups(Cow<'static, str>),
}

impl StagePrograms for ShadeProgram {
    fn all() -> Vec<Self> {
        Vec::new()
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Groups(_) => "shade_groups",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        let Self::Groups(air) = self;
        let mut parts = texts([COLOR]);
        parts.extend(AirText::Color(air.clone()).parts());
        parts.push(include_str!("groups.wgsl").into());
        parts
    }
}

/// Changes the colours of `count` groups; see `groups.wgsl`.
#[cfg(any(test, feature = "testing"))]
pub(crate) fn shade_groups(
    recorder: &mut Recorder<'_>,
    air: &WgslSource,
    parameters: &wgpu::Buffer,
    groups: &wgpu::Buffer,
    count: u32,
) {
    let bindings = vec![(0, groups.as_entire_binding()), (8, parameters.as_entire_binding())];
    let size = Groups::Direct((count * GROUP as u32).div_ceil(WORKGROUP));
    recorder.dispatch(ShadeProgram::Groups(air.wgsl.clone()), size, bindings);
}
