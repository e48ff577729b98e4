//! Rays through splats on any device.

#[cfg(feature = "gpu")]
use crate::error::RenderError;
#[cfg(feature = "gpu")]
use crate::gpu::{Gpu, GpuError, GpuRaySplats};
use crate::simd::SimdPath;
use crate::stages::rays::{RayHits, RayOutputs, RayTracer, Rays, cpu::RaySplats};
use rayon::prelude::*;
#[cfg(feature = "gpu")]
use std::sync::Arc;
use std::sync::OnceLock;
use wm_scene::Splats;

/// Splats that rays can meet, on the device of a renderer
/// ([`AnyRenderer::ray_splats`](crate::AnyRenderer::ray_splats)). Where a GPU fails, the CPU traces
/// the same rays and all that follow; [`AnyRenderer::check_rays`](crate::AnyRenderer::check_rays)
/// has the reason.
#[derive(Debug)]
pub struct AnyRaySplats<'a> {
    splats: &'a Splats,
    is_met: Vec<bool>,
    /// A value for each splat.
    values: Vec<f32>,
    /// Created when the CPU first traces rays.
    cpu: OnceLock<RaySplats<'a>>,
    #[cfg(feature = "gpu")]
    gpu: Option<GpuRaySplats>,
    #[cfg(feature = "gpu")]
    fault: OnceLock<GpuError>,
}

impl<'a> AnyRaySplats<'a> {
    /// On the CPU: the splats for which `is_met` returns true, each with a value.
    pub(crate) fn on_cpu(
        splats: &'a Splats,
        is_met: impl Fn(usize) -> bool + Sync + Send,
        value: impl Fn(usize) -> f32 + Sync + Send,
    ) -> Self {
        Self {
            splats,
            is_met: (0..splats.len()).into_par_iter().map(is_met).collect(),
            values: (0..splats.len()).into_par_iter().map(value).collect(),
            cpu: OnceLock::new(),
            #[cfg(feature = "gpu")]
            gpu: None,
            #[cfg(feature = "gpu")]
            fault: OnceLock::new(),
        }
    }

    /// Moves the splats to a GPU, if it has room.
    #[cfg(feature = "gpu")]
    pub(crate) fn move_to(&mut self, gpu: &Arc<Gpu>) -> Result<(), GpuError> {
        self.gpu = Some(GpuRaySplats::new(
            Arc::clone(gpu),
            self.splats,
            |index| self.is_met[index],
            |index| self.values[index],
        )?);
        Ok(())
    }

    /// Gives up the GPU if it has failed, and returns the reason.
    #[cfg(feature = "gpu")]
    pub(crate) fn give_up_gpu(&mut self) -> Option<RenderError> {
        let fault = self.fault.take()?;
        self.gpu = None;
        Some(fault.into())
    }

    fn on_gpu(&self, rays: &Rays, asked: RayOutputs) -> Option<RayHits> {
        #[cfg(feature = "gpu")]
        if let (Some(gpu), None) = (&self.gpu, self.fault.get()) {
            match gpu.trace(rays, asked) {
                Ok(hits) => return Some(hits),
                Err(error) => {
                    // The first of several errors is kept.
                    let _ = self.fault.set(error);
                }
            }
        }
        #[cfg(not(feature = "gpu"))]
        let _ = (rays, asked);
        None
    }
}

impl RayTracer for AnyRaySplats<'_> {
    fn trace(&self, rays: &Rays, asked: RayOutputs, path: SimdPath) -> RayHits {
        self.on_gpu(rays, asked).unwrap_or_else(|| {
            let cpu = self.cpu.get_or_init(|| {
                RaySplats::new(self.splats, |index| self.is_met[index])
                    .with_values(|index| self.values[index])
            });
            cpu.trace(rays, asked, path)
        })
    }
}
