//! Particles on the GPU: the CPU gathers and projects them, a workgroup adds up each drop's cover
//! in whole numbers by atomics, so that no order counts.

use crate::gpu::buffers::Room;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::Program;

/// The text that blends particles over a pixel.
pub(crate) const OVER: &str = include_str!("over.wgsl");
/// Adds up the cover of particles.
pub(crate) const FALL: Program = Program::new("fall", &[include_str!("fall.wgsl")]);

/// Adds up the cover of `count` drops before the scene in `room`, to sums that were 0.
pub(crate) fn fall(recorder: &mut Recorder<'_>, drops: &wgpu::Buffer, count: u32, room: &Room) {
    let buffers = [drops, &room.alpha, &room.depths, &room.falling];
    let bindings = with_buffers(vec![(0, recorder.view())], buffers);
    recorder.dispatch(FALL, Groups::Direct(count), bindings);
}
