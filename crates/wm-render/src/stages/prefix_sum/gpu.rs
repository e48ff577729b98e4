//! One workgroup over all sums, see the contract.

use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{StagePrograms, texts};
use std::borrow::Cow;

/// Prefix sums over one workgroup.
pub(crate) const WORKGROUP_SUMS: &str = include_str!("workgroup.wgsl");

/// The programs of prefix sums.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum PrefixSumProgram {
    /// Over the blocks of splats.
    Visible,
    /// Over the splats in view, 256 at a time.
    Entries,
}

impl StagePrograms for PrefixSumProgram {
    fn all() -> Vec<Self> {
        vec![Self::Visible, Self::Entries]
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Visible => "spine_visible",
            Self::Entries => "spine_entries",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        texts([WORKGROUP_SUMS, include_str!("spine.wgsl")])
    }
}

/// Prefix sums of `sums` in place, by one of the two programs of `spine.wgsl`; counts and sizes of
/// dispatches go to the other two.
pub(crate) fn spine(
    recorder: &mut Recorder<'_>,
    program: PrefixSumProgram,
    sums: &wgpu::Buffer,
    counters: &wgpu::Buffer,
    dispatches: &wgpu::Buffer,
) {
    let bindings = with_buffers(vec![(0, recorder.view())], [counters, dispatches, sums]);
    recorder.dispatch(program, Groups::Direct(1), bindings);
}
