//! Without any adapter: every text is valid WGSL, and mirrors the structures of the Rust code.

use super::*;
use crate::stages::optimize::gpu::{EXPLORE, OPTIMIZE};
use crate::stages::project::Record;
use crate::stages::project::gpu::{ParameterForm, cull_program, project_program};
use crate::stages::rasterize_backward::gpu::backward_program;
use crate::stages::shade::gpu::AirText;
use crate::testing::programs::{air_programs, all};
use wgpu::naga::front::wgsl;
use wgpu::naga::proc::Layouter;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu::naga::{AddressSpace, Module, ScalarKind, StorageAccess, TypeInner};

fn every() -> Vec<Program> {
    let air = "fn evaluate_air(direction: vec3<f32>, distance: f32) -> AirOnRay {
        return AirOnRay(vec3<f32>(exp(-air[0] * min(distance, FAR_AWAY))), direction);
    }";
    [all(), air_programs(air).into()].concat()
}

fn parsed(program: &Program) -> Module {
    let text = program.text();
    wgsl::parse_str(&text).unwrap_or_else(|error| panic!("{program:?}: {}", error.emit_to_string(&text)))
}

#[test]
fn every_program_is_valid() {
    for program in every() {
        let module = parsed(&program);
        let uses_subgroups = Channels::ALL.map(|channels| backward_program(channels, Subgroups::Used));
        let capabilities = match uses_subgroups.contains(&program) {
            true => Capabilities::SUBGROUP,
            false => Capabilities::empty(),
        };
        Validator::new(ValidationFlags::all(), capabilities)
            .validate(&module)
            .unwrap_or_else(|error| panic!("{program:?}: {}", error.emit_to_string(&program.text())));
        assert!(module.entry_points.iter().any(|point| point.name == program.entry), "{program:?}");
    }
}

/// WebGPU's defaults: what every adapter has.
#[test]
fn every_program_fits_small_adapters() {
    for program in every() {
        let module = parsed(&program);
        let mut layouter = Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let buffers =
            module.global_variables.iter().filter(|(_, v)| matches!(v.space, AddressSpace::Storage { .. }));
        assert!(buffers.count() <= 8, "{program:?} binds too many buffers");
        let shared = module.global_variables.iter().filter(|(_, v)| v.space == AddressSpace::WorkGroup);
        let bytes: u32 = shared.map(|(_, v)| layouter[v.ty].size).sum();
        assert!(bytes <= 16_384, "{program:?} shares {bytes} bytes");
        for point in &module.entry_points {
            assert!(point.workgroup_size.iter().product::<u32>() <= 256);
        }
    }
}

/// Nothing that is only read may be written, and the other way round: stages that run side by side
/// rely on it.
#[test]
fn no_program_writes_the_splats() {
    // But those by which they learn.
    let learn = [OPTIMIZE, EXPLORE];
    for program in every().into_iter().filter(|program| !learn.contains(program)) {
        for (_, variable) in parsed(&program).global_variables.iter() {
            let AddressSpace::Storage { access } = variable.space else { continue };
            let name = variable.name.as_deref().unwrap_or_default();
            if ["splats", "sh_rest", "attributes", "air", "drops", "background"].contains(&name) {
                assert!(!access.contains(StorageAccess::STORE), "{program:?} writes {name}");
            }
        }
    }
}

/// `Record` is the CPU's, number for number.
#[test]
fn records_are_as_long_as_the_cpus() {
    let module = parsed(&project_program(ParameterForm::Activated, &AirText::Clear));
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).unwrap();
    let (handle, record) =
        module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Record")).expect("it is there");
    assert_eq!(layouter[handle].size as usize, size_of::<Record>());
    let TypeInner::Struct { members, .. } = &record.inner else { panic!("no structure") };
    let offsets: Vec<u32> = members.iter().map(|member| member.offset).collect();
    assert_eq!(offsets, [0, 16, 32, 48]);
    for member in members {
        let is_four = matches!(module.types[member.ty].inner,
            TypeInner::Vector { size: wgpu::naga::VectorSize::Quad, scalar } if scalar.kind == ScalarKind::Float);
        assert!(is_four);
    }
}

#[test]
fn sizes_of_counted_structures_are_what_rust_says() {
    let module = parsed(&cull_program(ParameterForm::Activated));
    let mut layouter = Layouter::default();
    layouter.update(module.to_ctx()).unwrap();
    let size = |name: &str| {
        let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
        layouter[found.expect("it is there").0].size
    };
    assert_eq!(size("Block"), 4 * BLOCK_WORDS);
    assert_eq!(u64::from(size("Counters")), 4 * COUNTER_WORDS);
}
