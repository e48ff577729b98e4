//! The structures are laid out as WGSL has them.

use super::*;
use crate::config::RenderConfig;
use crate::differentiable::Channels;
use crate::stages::compare::NO_EXPOSURE;
use crate::stages::compare::gpu::{COLORS_BACKWARD, PATCH_TOTALS};
use crate::stages::composite::gpu::finish_program;
use crate::stages::intersect::gpu::INTERSECT;
use crate::stages::optimize::gpu::{ADD_GRADIENTS, EXPLORE, OPTIMIZE, REARRANGE};
use crate::stages::optimize::{Rates, SplatTerms};
use crate::stages::project::gpu::{ParameterForm, cull_program};
use crate::stages::rays::RayOutputs;
use crate::stages::rays::Rays;
use crate::stages::rays::gpu::{features_program, touch_program};
use crate::stages::rays::packets::Packets;
use crate::stages::sort::gpu::COUNT;
use crate::testing::camera;
use wgpu::naga::front::wgsl;
use wgpu::naga::{Module, TypeInner};

fn members(module: &Module, name: &str) -> (Vec<(String, u32)>, u32) {
    let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
    let TypeInner::Struct { members, span } = &found.expect("it is there").1.inner else {
        panic!("{name} is no structure")
    };
    let named = members.iter().map(|member| (member.name.clone().unwrap_or_default(), member.offset));
    (named.collect(), *span)
}

#[test]
fn names_offsets_and_sizes_are_those_of_wgsl() {
    let (camera, config) = (camera(64, 48), RenderConfig::default());
    let pass = DrawPass::new(&[], &camera, &config);
    let rates =
        Rates { means: 0.1, quats: 0.2, log_scales: 0.3, logit_opacities: 0.4, sh_dc: 0.5, sh_rest: 0.6 };
    let photo = Comparison { exposure: NO_EXPOSURE, weights: [0.5; Term::COUNT], ..Comparison::default() };
    let step = Step { number: 7, rates, terms: SplatTerms::default(), size: (64, 48) };
    let packets = Packets::new(&Rays::from_one([0.0; 3], vec![[1.0, 0.0, 0.0]]));
    for (program, name, uniform) in [
        (
            cull_program(ParameterForm::Activated),
            "View",
            view(&ViewParameters::of(&pass), 0, 0, Capacity::default()),
        ),
        (cull_program(ParameterForm::Activated), "Chunk", chunk(Piece::default(), 0, None, Opacity::Stored)),
        (finish_program(Channels::Color), "Training", training([0.5; 3], DepthAlpha::Learns)),
        (COLORS_BACKWARD, "Comparison", comparison(&photo, 5, 4.0, 2)),
        (PATCH_TOTALS, "Geometry", geometry(&photo, 5, (2, 6))),
        (OPTIMIZE, "Step", optimize_step(&step, 5)),
        (ADD_GRADIENTS, "Learn", learn(Learn::ALL)),
        (EXPLORE, "Noise", noise(&Noise { seed: 3, size: 0.5, most: 0.1 })),
        (REARRANGE, "Move", rearrangement(3..5, 0..7, 14, MomentReset::Row(10, 14))),
        (COUNT, "Pass", sort_pass(8, true, false)),
        (INTERSECT, "Task", intersect_task(true)),
        (touch_program(), "View", view_of_lists(3, 0, Capacity::default())),
        (touch_program(), "RayTask", ray_task(&packets.groups[0], &(0..1), 5, true)),
        (
            features_program(RayOutputs { color: true, ..RayOutputs::default() }),
            "ColorPiece",
            color_piece(0, 5, 3),
        ),
    ] {
        let module = wgsl::parse_str(&program.text()).unwrap();
        let (wanted, span) = members(&module, name);
        let fields: Vec<(String, u32)> =
            uniform.fields.iter().map(|(name, offset)| ((*name).to_owned(), *offset)).collect();
        assert_eq!(fields, wanted, "{name}");
        let bytes = 4 * uniform.words.len() as u32;
        assert!(
            bytes <= span && span <= UNIFORM_SLOT_BYTES as u32 && span - bytes < 16,
            "{name}: {bytes} of {span} bytes"
        );
    }
}

#[test]
fn room_grows_by_need_and_a_quarter() {
    const AMPLE_BYTES: u64 = 1 << 40;
    let mut capacity = Capacity::default();
    capacity.start(1_000_000, AMPLE_BYTES, ItemBytes::FRAME);
    assert_eq!(capacity, Capacity { visible: 500_000, entries: 1_000_000 });
    assert!(!capacity.grow(400_000, 1_000_000, AMPLE_BYTES, ItemBytes::FRAME));
    assert!(capacity.grow(600_000, 2_000_000, AMPLE_BYTES, ItemBytes::FRAME));
    assert_eq!(capacity, Capacity { visible: 750_000, entries: 2_500_000 });
    capacity.start(10, AMPLE_BYTES, ItemBytes::FRAME);
    assert_eq!(capacity.visible, 750_000);
    // No guess is beyond what fits; a need may be, and is refused later.
    let mut small = Capacity::default();
    small.start(1_000_000, 6_400_000, ItemBytes::FRAME);
    assert_eq!(small, Capacity { visible: 100_000, entries: 1_000_000 });
    assert!(small.grow(90_000, 1_500_000, 6_400_000, ItemBytes::FRAME));
    assert_eq!(small, Capacity { visible: 100_000, entries: 1_600_000 });
    assert!(small.grow(200_000, 0, 6_400_000, ItemBytes::FRAME));
    assert_eq!(small.visible, 200_000);
}
