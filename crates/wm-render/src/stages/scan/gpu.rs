//! One workgroup over all sums, see the contract.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::Program;

/// Prefix sums of `sums` in place, by one of the two programs of `spine.wgsl`; counts and sizes of dispatches go to the
/// other two.
pub(crate) fn spine(
    recorder: &mut Recorder<'_>,
    program: &Program,
    sums: &wgpu::Buffer,
    (counters, dispatches): (&wgpu::Buffer, &wgpu::Buffer),
) {
    let bindings = vec![
        (0, recorder.view()),
        (1, counters.as_entire_binding()),
        (2, dispatches.as_entire_binding()),
        (3, sums.as_entire_binding()),
    ];
    recorder.dispatch(program, Groups::Direct(1), bindings);
}
