//! One workgroup over all sums, see the contract.

use crate::gpu::buffers::Lists;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::Program;

/// Prefix sums over one workgroup.
pub(crate) const WORKGROUP_SUMS: &str = include_str!("workgroup.wgsl");
/// The texts of both programs.
const SPINE: &[&str] = &[WORKGROUP_SUMS, include_str!("spine.wgsl")];
/// Sums over the blocks of splats.
pub(crate) const SPINE_VISIBLE: Program = Program::new("spine_visible", SPINE);
/// Sums over the splats in view, 256 at a time.
pub(crate) const SPINE_ENTRIES: Program = Program::new("spine_entries", SPINE);

/// Prefix sums of `sums` in place, by one of the two programs; counts and sizes of dispatches go to
/// those of `lists`.
pub(crate) fn spine(recorder: &mut Recorder<'_>, program: Program, lists: &Lists, sums: &wgpu::Buffer) {
    let bindings = with_buffers(vec![(0, recorder.view())], [&lists.counters, &lists.dispatches, sums]);
    recorder.dispatch(program, Groups::Direct(1), bindings);
}
