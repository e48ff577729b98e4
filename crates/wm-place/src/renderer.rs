//! The renderer of the library: a device, and the places that it holds.
//!
//! `Renderer::load` takes the scene by value, since loading labels its splats of the sky: a copy of
//! millions of splats would be hidden in it. Frames take `&mut` of the place, since the place keeps
//! what frames find, such as assets and lying snow, and a mutable place makes that cost visible. A
//! place names splat sets in the memory of its renderer, so another renderer refuses it.

use crate::Result;
use crate::frame::FrameInputs;
use crate::picture::Picture;
use std::sync::atomic::{AtomicU64, Ordering};
use wm_render::{AnyRenderer, CpuConfig, Device, Pictures, RenderBackend, RenderError, Stats};

/// Renders places in weather, on a GPU or on the CPU. It keeps its working memory from frame to
/// frame.
pub struct Renderer {
    backend: AnyRenderer,
    memory: Pictures,
    /// Pinhole pictures of the last frame through a lens: memory for the next one.
    pub(crate) sides: Vec<Picture>,
    /// The last frame without weather: memory for the next one.
    pub(crate) clear: Picture,
    id: u64,
}

impl Renderer {
    /// A renderer on a real GPU where there is one, else on the CPU with all its threads.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the threads cannot be started.
    pub fn auto() -> Result<Self> {
        Self::new(&Device::Auto, CpuConfig::default(), |_| {})
    }

    /// A renderer on the CPU with all its threads: the same bytes on every run.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the threads cannot be started.
    pub fn cpu() -> Result<Self> {
        Self::new(&Device::Cpu, CpuConfig::default(), |_| {})
    }

    /// A renderer on `device`; `cpu` says how the CPU does its work or its part of it. With
    /// [`Device::Auto`] the CPU goes on if the GPU fails; `warn` is called with the reason.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if the device cannot be used.
    pub fn new(
        device: &Device,
        cpu: CpuConfig,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self> {
        Ok(Self::on(AnyRenderer::new(device, cpu, warn)?))
    }

    fn on(backend: AnyRenderer) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Self { backend, memory: Pictures::default(), sides: Vec::new(), clear: Picture::default(), id }
    }

    /// The number that tells it from other renderers.
    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    /// The back end, for draw passes of your own.
    pub fn backend_mut(&mut self) -> &mut AnyRenderer {
        &mut self.backend
    }

    /// The back end.
    #[must_use]
    pub fn backend(&self) -> &AnyRenderer {
        &self.backend
    }

    /// The back end, and the memory of its pictures.
    pub(crate) fn drawing(&mut self) -> (&mut AnyRenderer, &mut Pictures) {
        (&mut self.backend, &mut self.memory)
    }

    /// The device in words.
    #[must_use]
    pub fn describe(&self) -> String {
        self.backend.describe()
    }

    /// A renderer in a browser: on its GPU if that is a real one, or is asked for, else on the CPU.
    /// `warn` is called with the reason why the GPU is not used.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if `device` asks for a GPU, and there is none or it cannot be used.
    #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
    pub async fn in_browser(
        device: &Device,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self> {
        Ok(Self::on(AnyRenderer::in_browser(device, CpuConfig::default(), warn).await?))
    }

    /// Draws a frame of splat sets of your own in a weather, by the same plan as [`Self::render`].
    ///
    /// # Errors
    /// [`crate::Error::Render`].
    pub fn draw(&mut self, inputs: &FrameInputs<'_>, picture: &mut Picture) -> Result<Stats> {
        Ok(inputs.draw(&mut self.backend, &mut self.memory, picture)?)
    }
}
