//! Where to render: one renderer for the CPU and for GPUs.

use crate::cpu::CpuRenderer;
use crate::frame::Frame;
#[cfg(feature = "gpu")]
use crate::gpu::{self, Gpu, GpuConfig, GpuRenderer};
use crate::renderer::{CpuConfig, Job, RenderError, Renderer, SetId, Stats};
use crate::simd::SimdPath;
use std::fmt;
use std::str::FromStr;
use wm_scene::Splats;

/// Where to render.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// On a real GPU where there is one, else on the CPU; never on a GPU in software.
    #[default]
    Auto,
    /// On the CPU.
    Cpu,
    /// On a GPU: the first real one, or the first whose name holds this.
    Gpu(Option<String>),
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(None) => f.write_str("gpu"),
            Self::Gpu(Some(name)) => write!(f, "gpu:{name}"),
        }
    }
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.strip_prefix("gpu:").map(str::trim)) {
            ("auto", _) => Ok(Self::Auto),
            ("cpu", _) => Ok(Self::Cpu),
            ("gpu", _) => Ok(Self::Gpu(None)),
            (_, Some(name)) if !name.is_empty() => Ok(Self::Gpu(Some(name.to_owned()))),
            _ => Err(format!("`{text}` is no device: use auto, cpu, gpu, or gpu: and a part of its name")),
        }
    }
}

/// A renderer on the device that was chosen. One that was chosen by itself goes on with the CPU where the GPU
/// fails or lacks an effect; for that it keeps the splats.
pub struct AnyRenderer {
    config: CpuConfig,
    path: SimdPath,
    body: Body,
    warn: fn(&RenderError),
}

enum Body {
    Cpu(Box<CpuRenderer>),
    #[cfg(feature = "gpu")]
    Gpu {
        gpu: Box<GpuRenderer>,
        kept: Option<Vec<Option<Splats>>>,
    },
}

impl AnyRenderer {
    /// A renderer on `device`; `config` says how the CPU does its work or its part of it. `warn` is called with why
    /// the GPU is given up.
    ///
    /// # Errors
    /// [`RenderError`] if the device cannot be had.
    pub fn new(device: &Device, config: CpuConfig, warn: fn(&RenderError)) -> Result<Self, RenderError> {
        let path = SimdPath::select(config.simd).ok_or(RenderError::NoSimd(config.simd.name()))?;
        let body = match device {
            Device::Cpu => None,
            #[cfg(feature = "gpu")]
            Device::Auto => on_gpu(gpu::Choice::Auto, config)
                .inspect_err(|error| {
                    // That there is none is no news.
                    if !matches!(error, RenderError::Gpu(gpu::GpuError::NoAdapter { .. })) {
                        warn(error);
                    }
                })
                .ok()
                .map(|gpu| Body::Gpu { gpu, kept: Some(Vec::new()) }),
            #[cfg(feature = "gpu")]
            Device::Gpu(name) => {
                let choice = name.clone().map_or(gpu::Choice::Auto, gpu::Choice::Named);
                Some(Body::Gpu { gpu: on_gpu(choice, config)?, kept: None })
            }
            #[cfg(not(feature = "gpu"))]
            Device::Auto => None,
            #[cfg(not(feature = "gpu"))]
            Device::Gpu(_) => return Err(RenderError::NoGpu),
        };
        let body = body.map_or_else(|| CpuRenderer::new(config).map(|cpu| Body::Cpu(Box::new(cpu))), Ok)?;
        Ok(Self { config, path, body, warn })
    }

    /// The SIMD path of the CPU's work.
    #[must_use]
    pub fn path(&self) -> SimdPath {
        self.path
    }

    /// The threads of the CPU's work.
    #[must_use]
    pub fn pool(&self) -> &rayon::ThreadPool {
        match &self.body {
            Body::Cpu(cpu) => cpu.pool(),
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => gpu.pool(),
        }
    }

    /// Their number.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.pool().current_num_threads()
    }

    /// Whether frames are drawn on a GPU.
    #[must_use]
    pub fn is_gpu(&self) -> bool {
        !matches!(self.body, Body::Cpu(_))
    }

    /// What the bytes of a picture depend on: not the number of threads.
    #[must_use]
    pub fn arithmetic(&self) -> String {
        match &self.body {
            Body::Cpu(cpu) => format!("cpu, {}", cpu.path()),
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => format!("{}, {}", gpu.describe(), self.path),
        }
    }

    fn renderer(&mut self) -> &mut dyn Renderer {
        match &mut self.body {
            Body::Cpu(cpu) => &mut **cpu,
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => &mut **gpu,
        }
    }

    /// Goes on with the CPU, if `error` is the GPU's and the splats are there.
    #[cfg(feature = "gpu")]
    fn fall_back(&mut self, error: RenderError) -> Result<(), RenderError> {
        let Body::Gpu { kept, .. } = &mut self.body else { return Err(error) };
        let (RenderError::Gpu(_), Some(sets)) = (&error, kept.take()) else { return Err(error) };
        (self.warn)(&error);
        let mut cpu = CpuRenderer::new(self.config)?;
        // Every set under its old name: those that are gone leave theirs free.
        let mut gone = Vec::new();
        for splats in &sets {
            let set = cpu.load(splats.as_ref().unwrap_or(&Splats::default()))?;
            if splats.is_none() {
                gone.push(set);
            }
        }
        gone.into_iter().for_each(|set| cpu.unload(set));
        self.body = Body::Cpu(Box::new(cpu));
        Ok(())
    }

    #[cfg(not(feature = "gpu"))]
    fn fall_back(&mut self, error: RenderError) -> Result<(), RenderError> {
        let _ = (self.config, self.warn);
        Err(error)
    }
}

#[cfg(feature = "gpu")]
fn on_gpu(choice: gpu::Choice, config: CpuConfig) -> Result<Box<GpuRenderer>, RenderError> {
    let gpu = Gpu::open(&GpuConfig { choice, most_binding: None })?;
    Ok(Box::new(GpuRenderer::new(gpu, config)?))
}

impl Renderer for AnyRenderer {
    fn describe(&self) -> String {
        match &self.body {
            Body::Cpu(cpu) => cpu.describe(),
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => gpu.describe(),
        }
    }

    fn load(&mut self, splats: &Splats) -> Result<SetId, RenderError> {
        let set = match self.renderer().load(splats) {
            Ok(set) => set,
            Err(error) => {
                self.fall_back(error)?;
                return self.renderer().load(splats);
            }
        };
        #[cfg(feature = "gpu")]
        if let Body::Gpu { kept: Some(kept), .. } = &mut self.body {
            kept.resize(kept.len().max(set.0 + 1), None);
            kept[set.0] = Some(splats.clone());
        }
        Ok(set)
    }

    fn unload(&mut self, set: SetId) {
        self.renderer().unload(set);
        #[cfg(feature = "gpu")]
        if let Body::Gpu { kept: Some(kept), .. } = &mut self.body
            && let Some(splats) = kept.get_mut(set.0)
        {
            *splats = None;
        }
    }

    fn render(&mut self, job: &Job<'_>, frame: &mut Frame) -> Result<Stats, RenderError> {
        match self.renderer().render(job, frame) {
            Err(error) => {
                self.fall_back(error)?;
                self.renderer().render(job, frame)
            }
            done => done,
        }
    }
}

#[cfg(test)]
mod tests;
