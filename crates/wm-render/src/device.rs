//! The choice of a device: one back end for the CPU and for GPUs.

use crate::config::{CpuConfig, SetId};
use crate::cpu::{CpuDifferentiable, CpuRenderer};
use crate::differentiable::{Differentiable, ForwardConfig, Resident, Upstream};
use crate::error::RenderError;
use crate::frame::Frame;
#[cfg(feature = "gpu")]
use crate::gpu::{self, Gpu, GpuConfig, GpuDifferentiable, GpuRenderer};
use crate::gradients::{Gradients, Learn};
use crate::plan::{DrawPass, FramePlan, Pictures};
use crate::ray_tracer::AnyRaySplats;
#[cfg(all(feature = "gpu", target_arch = "wasm32"))]
use crate::renderer::ExecuteFuture;
use crate::renderer::{RenderBackend, Stats};
use crate::simd::SimdPath;
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;
use wm_scene::{Camera, Splats};

/// The device that renders.
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

/// Called with the error for which the GPU is given up.
type GpuWarning = Box<dyn FnMut(&RenderError) + Send>;

/// A renderer on the chosen device. With [`Device::Auto`] it continues on the CPU where the GPU
/// fails or lacks an effect; for that it keeps the splats.
pub struct AnyRenderer {
    config: CpuConfig,
    path: SimdPath,
    body: Body,
    warn: GpuWarning,
}

enum Body {
    Cpu(Box<CpuRenderer>),
    #[cfg(feature = "gpu")]
    Gpu {
        gpu: Box<GpuRenderer>,
        kept: Option<Vec<Option<Splats>>>,
    },
    /// In a browser, which never waits for its GPU: the CPU draws what must come back at once. Both
    /// hold all sets, under the same names.
    #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
    Browser {
        gpu: Box<GpuRenderer>,
        cpu: Box<CpuRenderer>,
    },
}

impl AnyRenderer {
    /// A renderer on `device`; `config` says how the CPU does its work or its part of it. `warn` is
    /// called with why the GPU is given up.
    ///
    /// # Errors
    /// [`RenderError`] if the device cannot be had.
    pub fn new(
        device: &Device,
        config: CpuConfig,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self, RenderError> {
        let mut warn: GpuWarning = Box::new(warn);
        let path = SimdPath::select(config.simd).ok_or(RenderError::NoSimd(config.simd.name()))?;
        let body = match open(device, &mut *warn)? {
            Opened::Cpu => Body::Cpu(Box::new(CpuRenderer::new(config)?)),
            #[cfg(feature = "gpu")]
            Opened::Gpu(gpu) => {
                let gpu = Box::new(GpuRenderer::new(gpu, config)?);
                Body::Gpu { gpu, kept: (*device == Device::Auto).then(Vec::new) }
            }
        };
        Ok(Self { config, path, body, warn })
    }

    /// A renderer in a browser: on its GPU, with the CPU for what must come back at once, or on the
    /// CPU. `warn` is called with why the GPU is given up; the CPU goes on then.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if `device` asks for a GPU, and there is none or it cannot be used.
    #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
    pub async fn in_browser(
        device: &Device,
        config: CpuConfig,
        warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self, RenderError> {
        let choice = match device {
            Device::Cpu => return Self::new(device, config, warn),
            Device::Auto => gpu::AdapterChoice::Auto,
            Device::Gpu(_) => gpu::AdapterChoice::Any,
        };
        let mut warn: GpuWarning = Box::new(warn);
        let gpu = match Gpu::open_in_browser(&GpuConfig { choice, ..GpuConfig::default() }).await {
            Ok(gpu) => gpu,
            Err(error) if *device == Device::Auto => {
                warn(&error.into());
                return Self::new(&Device::Cpu, config, warn);
            }
            Err(error) => return Err(error.into()),
        };
        let path = SimdPath::select(config.simd).ok_or(RenderError::NoSimd(config.simd.name()))?;
        let gpu = Box::new(GpuRenderer::new(gpu, config)?);
        let body = Body::Browser { gpu, cpu: Box::new(CpuRenderer::new(config)?) };
        Ok(Self { config, path, body, warn })
    }

    /// The SIMD path of the CPU's work.
    #[must_use]
    pub fn path(&self) -> SimdPath {
        self.path
    }

    /// The threads of the CPU's work.
    #[must_use]
    pub fn pool(&self) -> &Arc<rayon::ThreadPool> {
        match &self.body {
            Body::Cpu(cpu) => &cpu.pool,
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => &gpu.pool,
            #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
            Body::Browser { cpu, .. } => &cpu.pool,
        }
    }

    /// Returns the number of threads of the CPU's work.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.pool().current_num_threads()
    }

    /// Returns true if frames are drawn on a GPU.
    #[must_use]
    pub fn is_gpu(&self) -> bool {
        !matches!(self.body, Body::Cpu(_))
    }

    /// Returns the memory that is allocated on a GPU, bytes; `None` on the CPU, and where the GPU's
    /// interface does not tell.
    #[must_use]
    pub fn device_memory(&self) -> Option<u64> {
        match &self.body {
            Body::Cpu(_) => None,
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => gpu.gpu.memory(),
            #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
            Body::Browser { .. } => None,
        }
    }

    /// Names everything that the bytes of a picture depend on; the number of threads is not part of
    /// it.
    #[must_use]
    pub fn arithmetic(&self) -> String {
        let device = if self.is_gpu() { self.describe() } else { "cpu".into() };
        format!("{device}, {}", self.path)
    }

    /// The splats for which `is_met` returns true, such as those that are no sky, each with a value
    /// for [`RayOutputs::value`](crate::RayOutputs::value), for rays from anywhere on this
    /// renderer's device.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the GPU has no room and was asked for; one that was chosen by itself
    /// leaves the rays to the CPU.
    pub fn ray_splats<'s>(
        &mut self,
        splats: &'s Splats,
        is_met: impl Fn(usize) -> bool + Sync + Send,
        value: impl Fn(usize) -> f32 + Sync + Send,
    ) -> Result<AnyRaySplats<'s>, RenderError> {
        #[allow(unused_mut)]
        let mut rays = self.pool().install(|| AnyRaySplats::on_cpu(splats, is_met, value));
        #[cfg(feature = "gpu")]
        if let Body::Gpu { gpu, kept } = &self.body
            && let Err(error) = gpu.pool.install(|| rays.move_to(&gpu.gpu))
        {
            let error = RenderError::from(error);
            if kept.is_none() {
                return Err(error);
            }
            (self.warn)(&error);
        }
        Ok(rays)
    }

    /// Checks that this renderer's GPU has traced the rays, after
    /// [`RayTracer::trace`](crate::RayTracer::trace).
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if it has failed and was asked for; of one that was chosen by itself
    /// only the warning is given, since the CPU has traced them instead.
    pub fn check_rays(&mut self, rays: &mut AnyRaySplats<'_>) -> Result<(), RenderError> {
        #[cfg(feature = "gpu")]
        if let Some(error) = rays.give_up_gpu() {
            if matches!(self.body, Body::Gpu { kept: None, .. }) {
                return Err(error);
            }
            (self.warn)(&error);
        }
        #[cfg(not(feature = "gpu"))]
        let _ = rays;
        Ok(())
    }

    fn renderer(&mut self) -> &mut dyn RenderBackend {
        match &mut self.body {
            Body::Cpu(cpu) => &mut **cpu,
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => &mut **gpu,
            #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
            Body::Browser { cpu, .. } => &mut **cpu,
        }
    }

    /// Does something again on the CPU where the GPU fails.
    fn retried<T>(
        &mut self,
        mut work: impl FnMut(&mut dyn RenderBackend) -> Result<T, RenderError>,
    ) -> Result<T, RenderError> {
        work(self.renderer()).or_else(|error| {
            self.fall_back(error)?;
            work(self.renderer())
        })
    }

    /// Continues on the CPU, if `error` is the GPU's and the splats were kept.
    #[cfg(feature = "gpu")]
    fn fall_back(&mut self, error: RenderError) -> Result<(), RenderError> {
        #[cfg(target_arch = "wasm32")]
        if error.is_of_gpu() && matches!(self.body, Body::Browser { .. }) {
            (self.warn)(&error);
            // A renderer without sets takes the place for a moment.
            let empty = Body::Cpu(Box::new(CpuRenderer::new(self.config)?));
            if let Body::Browser { cpu, .. } = std::mem::replace(&mut self.body, empty) {
                self.body = Body::Cpu(cpu);
            }
            return Ok(());
        }
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
        let _ = (self.config, &self.warn);
        Err(error)
    }
}

/// An opened device.
enum Opened {
    Cpu,
    #[cfg(feature = "gpu")]
    Gpu(Arc<Gpu>),
}

/// Opens the chosen device; `warn` is called with the reason if there is a GPU that cannot be used.
#[cfg(feature = "gpu")]
fn open(device: &Device, warn: &mut dyn FnMut(&RenderError)) -> Result<Opened, RenderError> {
    let start = |choice| Gpu::open(&GpuConfig { choice, ..GpuConfig::default() });
    match device {
        Device::Cpu => Ok(Opened::Cpu),
        Device::Auto => match start(gpu::AdapterChoice::Auto) {
            Ok(gpu) => Ok(Opened::Gpu(gpu)),
            // That there is none is no news.
            Err(gpu::GpuError::NoAdapter { .. }) => Ok(Opened::Cpu),
            Err(error) => {
                warn(&error.into());
                Ok(Opened::Cpu)
            }
        },
        Device::Gpu(name) => {
            let choice = name.clone().map_or(gpu::AdapterChoice::Auto, gpu::AdapterChoice::Named);
            Ok(Opened::Gpu(start(choice)?))
        }
    }
}

#[cfg(not(feature = "gpu"))]
fn open(device: &Device, _: &mut dyn FnMut(&RenderError)) -> Result<Opened, RenderError> {
    match device {
        Device::Cpu | Device::Auto => Ok(Opened::Cpu),
        Device::Gpu(_) => Err(RenderError::NoGpu),
    }
}

impl RenderBackend for AnyRenderer {
    fn describe(&self) -> String {
        match &self.body {
            Body::Cpu(cpu) => cpu.describe(),
            #[cfg(feature = "gpu")]
            Body::Gpu { gpu, .. } => gpu.describe(),
            #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
            Body::Browser { gpu, .. } => gpu.describe(),
        }
    }

    fn load(&mut self, splats: &Splats) -> Result<SetId, RenderError> {
        let set = self.retried(|renderer| renderer.load(splats))?;
        #[cfg(feature = "gpu")]
        if let Body::Gpu { kept: Some(kept), .. } = &mut self.body {
            kept.resize(kept.len().max(set.0 + 1), None);
            kept[set.0] = Some(splats.clone());
        }
        #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
        if let Body::Browser { gpu, .. } = &mut self.body {
            match gpu.load(splats) {
                Ok(same) => debug_assert_eq!(same, set, "both have loaded the same sets"),
                Err(error) => self.fall_back(error)?,
            }
        }
        Ok(set)
    }

    fn unload(&mut self, set: SetId) {
        self.renderer().unload(set);
        #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
        if let Body::Browser { gpu, .. } = &mut self.body {
            gpu.unload(set);
        }
        #[cfg(feature = "gpu")]
        if let Body::Gpu { kept: Some(kept), .. } = &mut self.body
            && let Some(splats) = kept.get_mut(set.0)
        {
            *splats = None;
        }
    }

    fn weigh(&mut self, pass: &DrawPass<'_>, weights: &mut Vec<f32>) -> Result<Stats, RenderError> {
        self.retried(|renderer| renderer.weigh(pass, weights))
    }

    fn execute(&mut self, plan: &FramePlan<'_>, pictures: &mut Pictures) -> Result<Stats, RenderError> {
        self.retried(|renderer| renderer.execute(plan, pictures))
    }

    #[cfg(all(feature = "gpu", target_arch = "wasm32"))]
    fn execute_async<'a>(
        &'a mut self,
        plan: &'a FramePlan<'_>,
        pictures: &'a mut Pictures,
    ) -> ExecuteFuture<'a> {
        Box::pin(async move {
            if let Body::Browser { gpu, .. } = &mut self.body {
                match gpu.execute_async(plan, pictures).await {
                    Err(error) => self.fall_back(error)?,
                    done => return done,
                }
            }
            self.execute(plan, pictures)
        })
    }
}

/// A back end for training on the chosen device. With [`Device::Auto`] it continues on the CPU
/// where the GPU fails.
pub struct AnyDifferentiable {
    config: CpuConfig,
    body: Box<dyn Differentiable>,
    /// Told why the GPU is given up; `None` where it is not.
    warn: Option<GpuWarning>,
    /// The view of the last forward pass.
    last: Option<(Camera, ForwardConfig)>,
}

impl AnyDifferentiable {
    /// A back end of training on `device`; `config` and `warn` as in [`AnyRenderer::new`].
    ///
    /// # Errors
    /// [`RenderError`] if the device cannot be had.
    pub fn new(
        device: &Device,
        config: CpuConfig,
        mut warn: impl FnMut(&RenderError) + Send + 'static,
    ) -> Result<Self, RenderError> {
        let body: Box<dyn Differentiable> = match open(device, &mut warn)? {
            Opened::Cpu => Box::new(CpuDifferentiable::new(config)?),
            #[cfg(feature = "gpu")]
            Opened::Gpu(gpu) => Box::new(GpuDifferentiable::new(gpu, config)?),
        };
        let warn: Option<GpuWarning> = match device {
            Device::Auto => Some(Box::new(warn)),
            Device::Cpu | Device::Gpu(_) => None,
        };
        Ok(Self { config, body, warn, last: None })
    }

    /// On a GPU of one's own, as `auto` makes it: for tests.
    #[cfg(all(feature = "gpu", any(test, feature = "testing")))]
    pub(crate) fn fallible(
        gpu: Arc<Gpu>,
        config: CpuConfig,
        warn: fn(&RenderError),
    ) -> Result<Self, RenderError> {
        let body = Box::new(GpuDifferentiable::new(gpu, config)?);
        Ok(Self { config, body, warn: Some(Box::new(warn)), last: None })
    }

    /// Goes on with the CPU, if `error` is the GPU's and it may be given up.
    fn fall_back(&mut self, error: RenderError) -> Result<(), RenderError> {
        let (true, Some(mut warn)) = (error.is_of_gpu(), self.warn.take()) else { return Err(error) };
        warn(&error);
        self.body = Box::new(CpuDifferentiable::new(self.config)?);
        Ok(())
    }
}

impl Differentiable for AnyDifferentiable {
    fn describe(&self) -> String {
        self.body.describe()
    }

    fn path(&self) -> SimdPath {
        self.body.path()
    }

    fn pool(&self) -> &Arc<rayon::ThreadPool> {
        self.body.pool()
    }

    fn forward(
        &mut self,
        splats: &Splats,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        self.last = Some((*camera, *config));
        self.body.forward(splats, camera, config, frame).or_else(|error| {
            self.fall_back(error)?;
            self.body.forward(splats, camera, config, frame)
        })
    }

    fn backward(
        &mut self,
        splats: &Splats,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) -> Result<(), RenderError> {
        match (self.body.backward(splats, upstream, learn, gradients), self.last) {
            (Err(error), Some((camera, config))) => {
                self.fall_back(error)?;
                self.body.forward(splats, &camera, &config, &mut Frame::default())?;
                self.body.backward(splats, upstream, learn, gradients)
            }
            (done, _) => done,
        }
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        self.body.resident()
    }

    fn give_up(&mut self, error: RenderError) -> Result<(), RenderError> {
        self.fall_back(error)
    }
}

#[cfg(test)]
mod tests;
