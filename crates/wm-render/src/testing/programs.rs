//! The programs of the GPU, for tests that read their texts.

use crate::config::{Geometry, MedianDepth};
use crate::differentiable::Channels;
use crate::gpu::buffers::ParticleBlend;
use crate::gpu::source::{Program, Subgroups};
use crate::stages::compare::gpu as losses;
use crate::stages::composite::gpu::{self as composite, BackgroundForm};
use crate::stages::intersect::gpu as intersect;
use crate::stages::optimize::gpu as learning;
use crate::stages::particles::gpu::FALL;
use crate::stages::prefix_sum::gpu as prefix_sum;
use crate::stages::project::gpu::{ParameterForm, cull_program, project_program};
use crate::stages::project_backward::gpu as gradients;
use crate::stages::rasterize::gpu as blending;
use crate::stages::rasterize_backward::gpu as blending_backward;
use crate::stages::rays::{RayOutputs, gpu as rays};
use crate::stages::shade::gpu::{AirText, groups_program};
use crate::stages::sort::gpu as sort;
use std::borrow::Cow;

/// The programs with an air of this text.
pub(crate) fn air_programs(air: &str) -> [Program; 3] {
    let project = |air| project_program(ParameterForm::Activated, &air);
    let text = || Cow::Owned(air.to_owned());
    [project(AirText::Color(text())), project(AirText::Share(text())), groups_program(text())]
}

/// Every program, but for those with the air of a weather.
pub(crate) fn all() -> Vec<Program> {
    let mut all = vec![
        project_program(ParameterForm::Stored, &AirText::Photos),
        cull_program(ParameterForm::Activated),
        cull_program(ParameterForm::Stored),
        prefix_sum::SPINE_VISIBLE,
        prefix_sum::SPINE_ENTRIES,
        sort::COUNT,
        sort::SCAN,
        sort::SCATTER,
        intersect::INTERSECT,
        intersect::RANGES,
        blending::weights_program(),
        FALL,
        losses::SIMILARITY,
        losses::SIMILARITY_BACKWARD,
        losses::COLORS_BACKWARD,
        losses::GRID_MOMENTS,
        losses::PATCHES,
        losses::PATCH_TOTALS,
        losses::PATCHES_BACKWARD,
        losses::INVERSE_DEPTHS,
        losses::SMOOTH_BACKWARD,
        gradients::GATHER,
        learning::OPTIMIZE,
        learning::ADD_GRADIENTS,
        learning::EXPLORE,
        learning::REARRANGE,
        rays::touch_program(),
        rays::visible_program(),
        rays::sums_program(),
    ];
    all.extend(
        [AirText::Clear, AirText::FullShare].map(|air| project_program(ParameterForm::Activated, &air)),
    );
    for channels in Channels::ALL {
        all.extend([blending::sums_program(channels), composite::finish_program(channels)]);
        all.extend([losses::pixels_program(channels), gradients::backward_program(channels)]);
        all.push(blending_backward::by_sums_program(channels));
        let used = [Subgroups::Used, Subgroups::Unused];
        all.extend(used.map(|used| blending_backward::backward_program(channels, used)));
    }
    for median in [MedianDepth::Off, MedianDepth::On] {
        for geometry in [Geometry::None, Geometry::Depth, Geometry::DepthNormal] {
            all.push(blending::frame_program(geometry, median, false));
        }
        for geometry in [Geometry::Depth, Geometry::DepthNormal] {
            all.push(blending::frame_program(geometry, median, true));
        }
    }
    for particles in
        [ParticleBlend::None, ParticleBlend::InColor, ParticleBlend::Separate, ParticleBlend::Apart]
    {
        let nodes = [4, 8].map(BackgroundForm::Nodes);
        for form in [BackgroundForm::Color, BackgroundForm::Picture].into_iter().chain(nodes) {
            all.push(composite::composite_program(form, particles));
        }
    }
    for (color, normal) in [(false, false), (true, false), (false, true), (true, true)] {
        let asked = RayOutputs { color, normal, value: false };
        all.push(rays::blend_program(asked));
        // Without sums there are no features to find.
        if asked.features() > 0 {
            all.push(rays::features_program(asked));
        }
    }
    all
}
