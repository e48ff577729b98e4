//! The way back: counts, times and pictures in one buffer, mapped once.

use super::buffers::{Growing, Memory, Room};
use super::device::Gpu;
use super::error::GpuError;
use super::recorder::{Clock, Recorder, Stage};
use super::source::COUNTER_WORDS;
use crate::frame::Frame;
use crate::renderer::{RenderError, Stats};
use std::sync::mpsc::channel;
use std::time::Duration;
use wgpu::BufferUsages;

/// What the GPU counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Counted {
    /// Splats in view, whether there was room or not.
    pub visible: u32,
    /// Entries of tile lists likewise, of the splats that had room.
    pub entries: u32,
    /// Records that all tiles walked.
    pub walked: u32,
}

/// Submits the commands and waits for what they made. `hidden` takes the expected depth where the frame has none and
/// something on the CPU needs it.
pub(crate) fn submit(
    gpu: &Gpu,
    recorder: Recorder<'_>,
    (room, memory): (&Room, &mut Memory),
    clock: Option<&Clock>,
    (frame, hidden): (&mut Frame, &mut Vec<f32>),
    stats: &mut Stats,
) -> Result<Counted, RenderError> {
    let depth = if frame.depth.is_empty() { hidden } else { &mut frame.depth };
    let pixels = (4 * frame.alpha.len()) as u64;
    let mut counters = [0u32; COUNTER_WORDS as usize];
    let mut ticks = Clock::ticks();
    let mut parts: Vec<Part<'_>> = vec![(&room.counters, 0, bytemuck::cast_slice_mut(&mut counters))];
    if let Some(clock) = clock {
        parts.push((&clock.times, 0, bytemuck::cast_slice_mut(&mut ticks)));
    }
    for (buffer, offset, array) in [
        (&room.rgb, 0, &mut frame.rgb),
        (&room.alpha, 0, &mut frame.alpha),
        (&room.depths, 0, depth),
        (&room.depths, pixels, &mut frame.median_depth),
        (&room.normal, 0, &mut frame.normal),
        (&room.apart, 0, &mut frame.particles),
    ] {
        if !array.is_empty() {
            parts.push((buffer, offset, bytemuck::cast_slice_mut(array)));
        }
    }
    copy(gpu, recorder, &mut memory.staging, &mut parts)?;
    if let Some(clock) = clock {
        let seconds = |stage| clock.seconds(&ticks, stage);
        stats.project += seconds(Stage::Project);
        stats.sort += seconds(Stage::Sort);
        stats.intersect += seconds(Stage::Intersect);
        stats.rasterize += seconds(Stage::Rasterize);
        stats.fall += seconds(Stage::Fall);
        stats.composite += seconds(Stage::Composite);
    }
    let [_, _, visible, entries, walked] = counters;
    Ok(Counted { visible, entries, walked })
}

/// A part of a buffer, from an offset on, and where it goes.
pub(crate) type Part<'a> = (&'a wgpu::Buffer, u64, &'a mut [u8]);

/// Submits the commands, waits, and copies what they made.
pub(crate) fn copy(
    gpu: &Gpu,
    mut recorder: Recorder<'_>,
    staging: &mut Growing,
    parts: &mut [Part<'_>],
) -> Result<(), GpuError> {
    let bytes = parts.iter().map(|(.., array)| array.len() as u64).sum();
    let staging =
        staging.fit_unbound(gpu, "the way back", bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST)?;
    let mut at = 0;
    recorder.tell_times();
    for (buffer, offset, array) in &*parts {
        recorder.encoder().copy_buffer_to_buffer(buffer, *offset, &staging, at, array.len() as u64);
        at += array.len() as u64;
    }
    recorder.submit();
    gpu.count(|work| work.returned += bytes);
    wait(gpu, &staging, bytes)?;
    let slice = staging.slice(..bytes);
    let view = slice.get_mapped_range().map_err(|error| GpuError::Refused(error.to_string()))?;
    let mut at = 0;
    for (.., array) in parts {
        array.copy_from_slice(&view[at..at + array.len()]);
        at += array.len();
    }
    drop(view);
    staging.unmap();
    Ok(())
}

/// Waits until the first `bytes` of a buffer can be read.
pub(crate) fn wait(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
    let (told, mapped) = channel();
    buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |result| {
        let _ = told.send(result);
    });
    gpu.finish()?;
    // Another thread that polls the same device may have taken it upon itself to tell, and be about to.
    match mapped.recv_timeout(Duration::from_secs(10)) {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(GpuError::Refused(error.to_string())),
        Err(_) => Err(GpuError::Refused("nothing came back".to_owned())),
    }
}
