//! Reads back counts, times and pictures in one buffer, which is mapped once.

use super::buffers::{GrowingBuffer, Room};
use super::device::Gpu;
use super::error::GpuError;
use super::pass::GpuPass;
use super::recorder::{Clock, Recorder, Stage, Ticks};
use super::source::COUNTER_WORDS;
use crate::frame::Frame;
use crate::renderer::Stats;
#[cfg(not(target_arch = "wasm32"))]
use std::sync::mpsc::channel;
#[cfg(not(target_arch = "wasm32"))]
use std::time::Duration;
use wgpu::BufferUsages;

/// The counts of one pass on the GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PassCounts {
    /// Splats in view, including those beyond the capacity.
    pub(crate) visible: u32,
    /// Entries of tile lists of the splats that had room, including those beyond the capacity.
    pub(crate) entries: u32,
    /// Records that all tiles walked.
    pub(crate) walked: u32,
}

/// The results of several passes that are read back together: for each pass its counts, its times
/// and its pictures.
pub(crate) struct Readback {
    staging: wgpu::Buffer,
    /// The start of those of each pass, and the end of all.
    starts: Vec<u64>,
    /// Passes that are recorded.
    recorded: usize,
}

impl Readback {
    const COUNTER_BYTES: u64 = 4 * COUNTER_WORDS;

    /// Makes room for what `passes` send back out of `room`.
    pub(crate) fn new(
        gpu: &Gpu,
        staging: &mut GrowingBuffer,
        clock: Option<&Clock>,
        passes: &[GpuPass<'_>],
        room: &Room,
    ) -> Result<Self, GpuError> {
        let head = Self::COUNTER_BYTES + clock.map_or(0, |_| size_of::<Ticks>() as u64);
        let mut starts = vec![0];
        for pass in passes {
            let pictures = pass.pictures(room).iter().map(|(.., bytes)| bytes).sum::<u64>();
            // Times are whole numbers of 8 bytes; nothing else asks for more than the copies do.
            starts.push(starts[starts.len() - 1] + head + pictures);
        }
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let staging = staging.fit_unbound(gpu, "the way back", starts[passes.len()], usage)?;
        Ok(Self { staging, starts, recorded: 0 })
    }

    /// Records the copies of the results of the next pass, after its commands.
    pub(crate) fn record(&mut self, recorder: &mut Recorder<'_>, pass: &GpuPass<'_>, room: &Room) {
        let mut at = self.starts[self.recorded];
        self.recorded += 1;
        recorder.tell_times();
        let times = recorder.times().map(|times| (times, 0, size_of::<Ticks>() as u64));
        let sources = [(&room.lists.counters, 0, Self::COUNTER_BYTES)].into_iter().chain(times);
        for (buffer, offset, bytes) in sources.chain(pass.pictures(room)) {
            if bytes > 0 {
                recorder.encoder().copy_buffer_to_buffer(buffer, offset, &self.staging, at, bytes);
            }
            at += bytes;
        }
    }

    /// Submits the commands and waits for the results.
    pub(crate) async fn submit(self, gpu: &Gpu, recorder: Recorder<'_>) -> Result<ReadbackResults, GpuError> {
        let Self { staging, starts, recorded } = self;
        let bytes = starts[recorded];
        recorder.submit();
        gpu.count(|work| work.returned += bytes);
        mapped(gpu, &staging, bytes).await?;
        let view = staging.slice(..bytes).get_mapped_range();
        let view = view.map_err(|error| GpuError::Refused(error.to_string()))?;
        Ok(ReadbackResults { view: Some(view), staging, starts, taken: 0 })
    }
}

/// The mapped results; the memory is unmapped when this is dropped.
pub(crate) struct ReadbackResults {
    /// `None` only while it is dropped.
    view: Option<wgpu::BufferView>,
    staging: wgpu::Buffer,
    starts: Vec<u64>,
    /// Passes whose pictures were taken.
    taken: usize,
}

impl Drop for ReadbackResults {
    fn drop(&mut self) {
        self.view = None;
        self.staging.unmap();
    }
}

impl ReadbackResults {
    fn bytes(&self) -> &[u8] {
        self.view.as_deref().unwrap_or_default()
    }

    /// The counts of each pass.
    pub(crate) fn counted(&self) -> impl Iterator<Item = PassCounts> {
        let passes = self.starts.len() - 1;
        (0..passes).map(|pass| self.counted_in(pass))
    }

    fn counted_in(&self, pass: usize) -> PassCounts {
        let mut counters = [0u32; COUNTER_WORDS as usize];
        let from = &self.bytes()[self.starts[pass] as usize..];
        let to: &mut [u8] = bytemuck::cast_slice_mut(&mut counters);
        to.copy_from_slice(&from[..to.len()]);
        let [_, _, visible, entries, walked] = counters;
        PassCounts { visible, entries, walked }
    }

    /// Takes what the next pass sent: its pictures, whose arrays have their sizes, and its times.
    /// `hidden` takes the expected depth where the frame has none and something on the CPU needs
    /// it.
    pub(crate) fn take(
        &mut self,
        frame: &mut Frame,
        hidden: &mut [f32],
        clock: Option<&Clock>,
        stats: &mut Stats,
    ) -> PassCounts {
        let pass = self.taken;
        self.taken += 1;
        let (start, end) = (self.starts[pass] as usize, self.starts[pass + 1] as usize);
        let mut rest = &self.bytes()[start + Readback::COUNTER_BYTES as usize..end];
        let mut fill = |to: &mut [u8]| {
            let (own, later) = rest.split_at(to.len());
            to.copy_from_slice(own);
            rest = later;
        };
        if let Some(clock) = clock {
            let mut ticks = Clock::ticks();
            fill(bytemuck::cast_slice_mut(&mut ticks));
            let seconds = |stage| clock.seconds(&ticks, stage);
            stats.project += seconds(Stage::Project);
            stats.sort += seconds(Stage::Sort);
            stats.intersect += seconds(Stage::Intersect);
            stats.rasterize += seconds(Stage::Rasterize);
            stats.fall += seconds(Stage::Fall);
            stats.composite += seconds(Stage::Composite);
        }
        let mut arrays = frame.arrays_mut().map(|array| &mut array[..]);
        let depth = &mut arrays[2];
        if depth.is_empty() {
            *depth = hidden;
        }
        arrays.into_iter().for_each(|array| fill(bytemuck::cast_slice_mut(array)));
        self.counted_in(pass)
    }
}

/// A part of a buffer, from an offset on, and where it goes.
pub(crate) type Part<'a> = (&'a wgpu::Buffer, u64, &'a mut [u8]);

/// Submits the commands, waits, and copies the results.
pub(crate) fn copy(
    gpu: &Gpu,
    mut recorder: Recorder<'_>,
    staging: &mut GrowingBuffer,
    parts: &mut [Part<'_>],
) -> Result<(), GpuError> {
    let bytes = parts.iter().map(|(.., array)| array.len() as u64).sum();
    let staging =
        staging.fit_unbound(gpu, "the way back", bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST)?;
    let mut at = 0;
    recorder.tell_times();
    for (buffer, offset, array) in parts.iter().filter(|(.., array)| !array.is_empty()) {
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

/// Waits until the first `bytes` of a buffer can be read: a native interface blocks.
#[cfg(not(target_arch = "wasm32"))]
async fn mapped(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
    wait(gpu, buffer, bytes)
}

/// Waits until the first `bytes` of a buffer can be read.
#[cfg(target_arch = "wasm32")]
async fn mapped(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
    use std::sync::{Arc, Mutex, PoisonError};
    use std::task::{Poll, Waker};
    type MapState = (Option<Result<(), wgpu::BufferAsyncError>>, Option<Waker>);
    let state: Arc<Mutex<MapState>> = Arc::default();
    let shared = Arc::clone(&state);
    buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |result| {
        let mut state = shared.lock().unwrap_or_else(PoisonError::into_inner);
        state.0 = Some(result);
        state.1.take().into_iter().for_each(Waker::wake);
    });
    let result = std::future::poll_fn(|context| {
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        state.1 = Some(context.waker().clone());
        state.0.take().map_or(Poll::Pending, Poll::Ready)
    });
    let result = result.await;
    gpu.check()?;
    result.map_err(|error| GpuError::Refused(error.to_string()))
}

/// A browser never blocks: results that are needed at once are computed by the CPU there.
#[cfg(target_arch = "wasm32")]
pub(crate) fn wait(_: &Gpu, _: &wgpu::Buffer, _: u64) -> Result<(), GpuError> {
    Err(GpuError::Refused("a browser does not wait for its GPU".to_owned()))
}

/// Waits until the first `bytes` of a buffer can be read.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) fn wait(gpu: &Gpu, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
    let (told, mapped) = channel();
    buffer.slice(..bytes).map_async(wgpu::MapMode::Read, move |result| {
        let _ = told.send(result);
    });
    gpu.finish()?;
    // Another thread that polls the same device may have taken it upon itself to tell, and be about
    // to.
    match mapped.recv_timeout(Duration::from_secs(10)) {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(GpuError::Refused(error.to_string())),
        Err(_) => Err(GpuError::Refused("nothing came back".to_owned())),
    }
}
