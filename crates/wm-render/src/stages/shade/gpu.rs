//! The air on the GPU: part of the projection (`crate::stages::project::gpu`), and here by itself.

#[cfg(any(test, feature = "testing"))]
use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::Program;
#[cfg(any(test, feature = "testing"))]
use crate::gpu::source::WORKGROUP;
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
    pub(crate) fn new(shading: Shading, air: Option<&WgslSource>) -> Self {
        match (shading, air.map(|air| air.wgsl.clone())) {
            (Shading::Color, None) => Self::Clear,
            (Shading::Color, Some(text)) => Self::Color(text),
            (Shading::Transmittance, None) => Self::FullShare,
            (Shading::Transmittance, Some(text)) => Self::Share(text),
        }
    }

    /// Adds the texts that define `through_air` to a program with [`COLOR`].
    pub(crate) fn added_to(&self, program: Program) -> Program {
        match self {
            Self::Clear => program.with(CLEAR_AIR),
            Self::Photos => program.with(PHOTO_AIR).with(include_str!("color_through_photo_air.wgsl")),
            Self::FullShare => program.with(FULL_SHARE),
            Self::Color(air) => {
                program.with(AIR).with(air.clone()).with(include_str!("color_through_air.wgsl"))
            }
            Self::Share(air) => {
                program.with(AIR).with(air.clone()).with(include_str!("share_through_air.wgsl"))
            }
        }
    }
}

/// Changes the colours of groups of splats to those seen through the air of this text: tests alone
/// shade groups without a projection.
#[cfg(any(test, feature = "testing"))]
pub(crate) fn groups_program(air: Cow<'static, str>) -> Program {
    AirText::Color(air)
        .added_to(Program::new("shade_groups", &[crate::gpu::source::COLOR, include_str!("groups.wgsl")]))
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
    recorder.dispatch(groups_program(air.wgsl.clone()), size, bindings);
}
