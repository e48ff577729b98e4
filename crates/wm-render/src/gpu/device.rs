//! The choice of a GPU, and the device on it.

use super::error::GpuError;
use super::source::{MIN_SUBGROUP, Program, Subgroups, WORKGROUP};
use crate::at_once::ready;
use crate::renderer::DeviceWork;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use wgpu::{Adapter, DeviceType, Limits};
use wm_base::error::one_line;

pub(crate) const WRITTEN: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);

/// The choice of a GPU.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum AdapterChoice {
    /// The first real GPU, the strongest kind first; never one in software.
    #[default]
    Auto,
    /// The first GPU whose name contains this text, ignoring case; also one in software.
    Named(String),
    /// The first GPU, real ones first.
    #[allow(dead_code, reason = "browsers and tests take it")]
    Any,
}

/// The settings of the GPU back end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct GpuConfig {
    /// The GPU.
    pub(crate) choice: AdapterChoice,
    /// The limits that are requested and kept; `None` for those of the adapter.
    pub(crate) limits: Option<Limits>,
    /// The use of subgroups.
    pub(crate) subgroups: Subgroups,
}

/// The kind of a GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// A part of a card, lent to a virtual machine.
    Virtual,
    /// A kind that the driver does not tell.
    Other,
    /// The processor, behind a GPU's interface: for tests.
    Software,
}

impl AdapterKind {
    /// In a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Other => "other",
            Self::Software => "software",
        }
    }
}

/// An adapter, for lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedAdapter {
    /// Name of the adapter.
    pub name: String,
    /// Interface of the driver: Vulkan, Metal, DirectX 12.
    pub backend: String,
    /// The driver and its version.
    pub driver: String,
    /// Kind of the adapter.
    pub kind: AdapterKind,
    /// Most bytes of one array.
    pub most_binding: u64,
    /// Most bytes of one buffer.
    pub most_buffer: u64,
    /// Shared memory of a workgroup, bytes.
    pub workgroup_storage: u32,
    /// True if stages can be timed.
    pub timestamps: bool,
    /// Fewest and most threads of a subgroup, where programs may use subgroups.
    pub subgroups: Option<(u32, u32)>,
    /// The reason why the adapter cannot be used, if so.
    pub unfit: Option<GpuError>,
}

/// All adapters, in the order in which [`AdapterChoice::Any`] would take them.
#[must_use]
pub fn adapters() -> Vec<ListedAdapter> {
    ranked().iter().map(list).collect()
}

fn is_for_auto(listed: &ListedAdapter) -> bool {
    listed.kind != AdapterKind::Software && listed.unfit.is_none()
}

fn list(adapter: &Adapter) -> ListedAdapter {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    ListedAdapter {
        kind: kind_of(&info),
        backend: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        most_binding: limits.max_storage_buffer_binding_size,
        most_buffer: limits.max_buffer_size,
        workgroup_storage: limits.max_compute_workgroup_storage_size,
        timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        subgroups: (adapter.features().contains(wgpu::Features::SUBGROUP)
            && info.subgroup_min_size >= MIN_SUBGROUP)
            .then_some((info.subgroup_min_size, info.subgroup_max_size)),
        unfit: check_limits(&info.name, &limits).err(),
        name: info.name,
    }
}

fn kind_of(info: &wgpu::AdapterInfo) -> AdapterKind {
    match info.device_type {
        DeviceType::DiscreteGpu => AdapterKind::Discrete,
        DeviceType::IntegratedGpu => AdapterKind::Integrated,
        DeviceType::VirtualGpu => AdapterKind::Virtual,
        DeviceType::Cpu => AdapterKind::Software,
        DeviceType::Other => AdapterKind::Other,
    }
}

fn ranked() -> Vec<Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    // Sizes of dispatches are made by our own shaders within the limits: no pass before each to
    // check them.
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    let instance = wgpu::Instance::new(descriptor);
    let mut adapters = ready(instance.enumerate_adapters(wgpu::Backends::all())).unwrap_or_default();
    adapters.sort_by_key(|adapter| kind_of(&adapter.get_info()));
    adapters
}

/// Returns true if there may be a real GPU. Asking every driver takes time, and some of them print
/// to stderr.
fn may_have_hardware() -> bool {
    // Linux has a file for each: of the kernel's own drivers, NVIDIA's, Windows' below it,
    // Adreno's, Mali's.
    let files = ["dri", "nvidiactl", "dxg", "kgsl-3d0", "mali0"];
    !cfg!(target_os = "linux") || files.iter().any(|file| Path::new("/dev").join(file).exists())
}

/// Checks the limits that every stage needs.
fn check_limits(name: &str, limits: &Limits) -> Result<(), GpuError> {
    let least = [
        ("max_compute_invocations_per_workgroup", limits.max_compute_invocations_per_workgroup, WORKGROUP),
        ("max_compute_workgroup_size_x", limits.max_compute_workgroup_size_x, WORKGROUP),
        ("max_compute_workgroup_storage_size", limits.max_compute_workgroup_storage_size, 16_384),
        ("max_compute_workgroups_per_dimension", limits.max_compute_workgroups_per_dimension, 65_535),
        ("max_storage_buffers_per_shader_stage", limits.max_storage_buffers_per_shader_stage, 8),
    ];
    for (limit, has, needs) in least {
        if has < needs {
            let (has, needs) = (has.into(), needs.into());
            return Err(GpuError::Limit { adapter: name.to_owned(), limit, has, needs });
        }
    }
    Ok(())
}

/// A device and the programs that were compiled for it. Renderers share it.
pub struct Gpu {
    name: String,
    backend: String,
    pub(crate) kind: AdapterKind,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) most_binding: u64,
    most_buffer: u64,
    pub(crate) subgroups: Subgroups,
    /// Nanoseconds of a tick, where stages can be timed.
    pub(crate) tick: Option<f32>,
    faults: Arc<Mutex<Option<String>>>,
    lost: Arc<OnceLock<String>>,
    pipelines: Mutex<HashMap<Program, wgpu::ComputePipeline>>,
    work: Mutex<DeviceWork>,
}

impl Gpu {
    /// Starts a GPU.
    ///
    /// # Errors
    /// [`GpuError`] if there is none to the choice, or it cannot be started.
    pub(crate) fn open(config: &GpuConfig) -> Result<Arc<Self>, GpuError> {
        let ranked =
            if config.choice == AdapterChoice::Auto && !may_have_hardware() { Vec::new() } else { ranked() };
        let listed: Vec<ListedAdapter> = ranked.iter().map(list).collect();
        let is_wanted = |listed: &ListedAdapter| match &config.choice {
            AdapterChoice::Auto => is_for_auto(listed),
            AdapterChoice::Named(name) => listed.name.to_lowercase().contains(&name.to_lowercase()),
            AdapterChoice::Any => true,
        };
        let Some(at) = listed.iter().position(is_wanted) else {
            let wanted = match &config.choice {
                AdapterChoice::Named(name) => format!("is called `{name}`"),
                AdapterChoice::Auto | AdapterChoice::Any => "can be used".to_owned(),
            };
            let names: Vec<String> =
                listed.iter().map(|listed| format!("`{}` ({})", listed.name, listed.kind.name())).collect();
            let found = if names.is_empty() {
                "no real one, and one in software is taken only by its name".to_owned()
            } else {
                names.join(", ")
            };
            return Err(GpuError::NoAdapter { wanted, found });
        };
        if let Some(unfit) = &listed[at].unfit {
            return Err(unfit.clone());
        }
        let failed =
            || GpuError::Start { adapter: listed[at].name.clone(), reason: "it does not answer".to_owned() };
        ready(Self::start(&ranked[at], &listed[at], config)).ok_or_else(failed)?
    }

    /// Opens the GPU that a browser gives, whatever its name.
    ///
    /// # Errors
    /// [`GpuError`] if the browser has no WebGPU or gives no GPU, or it cannot be started.
    #[cfg(target_arch = "wasm32")]
    pub(crate) async fn open_in_browser(config: &GpuConfig) -> Result<Arc<Self>, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..wgpu::RequestAdapterOptions::default()
        };
        let adapter = instance.request_adapter(&options).await.map_err(|error| GpuError::NoAdapter {
            wanted: "can be used".to_owned(),
            found: one_line(&error.to_string()),
        })?;
        let mut listed = list(&adapter);
        // Browsers give times in steps of 0.1 ms, and no subgroups that all of them have.
        (listed.timestamps, listed.subgroups) = (false, None);
        if listed.name.is_empty() {
            "WebGPU".clone_into(&mut listed.name);
        }
        if config.choice == AdapterChoice::Auto && listed.kind == AdapterKind::Software {
            let (wanted, found) =
                ("is real".to_owned(), format!("`{}` ({})", listed.name, listed.kind.name()));
            return Err(GpuError::NoAdapter { wanted, found });
        }
        if let Some(unfit) = &listed.unfit {
            return Err(unfit.clone());
        }
        Self::start(&adapter, &listed, config).await
    }

    async fn start(
        adapter: &Adapter,
        listed: &ListedAdapter,
        config: &GpuConfig,
    ) -> Result<Arc<Self>, GpuError> {
        let failed = |reason: String| GpuError::Start { adapter: listed.name.clone(), reason };
        let limits = config.limits.clone().unwrap_or_else(|| adapter.limits());
        check_limits(&listed.name, &limits)?;
        let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("weather-magician"),
            required_features: match cfg!(target_arch = "wasm32") {
                true => wgpu::Features::empty(),
                false => adapter.features() & (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::SUBGROUP),
            },
            required_limits: limits.clone(),
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) =
            adapter.request_device(&descriptor).await.map_err(|error| failed(error.to_string()))?;
        let faults: Arc<Mutex<Option<String>>> = Arc::default();
        let lost: Arc<OnceLock<String>> = Arc::default();
        let told = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock(&told).get_or_insert_with(|| one_line(&error.to_string()));
        }));
        let told = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            // The first of several errors is kept; dropping the device is no error.
            let _ = told.set(one_line(&format!("{message} ({reason:?})")));
        });
        let tick = listed.timestamps.then(|| queue.get_timestamp_period());
        Ok(Arc::new(Self {
            name: listed.name.clone(),
            backend: listed.backend.clone(),
            kind: listed.kind,
            device,
            queue,
            most_binding: most,
            subgroups: if listed.subgroups.is_some() { config.subgroups } else { Subgroups::Unused },
            most_buffer: limits.max_buffer_size,
            tick,
            faults,
            lost,
            pipelines: Mutex::default(),
            work: Mutex::default(),
        }))
    }

    /// Returns the name and the interface of the adapter.
    pub(crate) fn describe(&self) -> String {
        format!("gpu, {} ({})", self.name, self.backend)
    }

    /// The error since the last call.
    ///
    /// # Errors
    /// [`GpuError::Lost`] from the loss of the device on, else the first refusal.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let fault = lock(&self.faults).take();
        if fault.is_some() {
            // Work may be refused because the device is gone, which only a poll tells.
            let _ = self.device.poll(wgpu::PollType::Poll);
        }
        if let Some(reason) = self.lost.get() {
            return Err(GpuError::Lost(reason.clone()));
        }
        fault.map_or(Ok(()), |fault| Err(GpuError::Refused(fault)))
    }

    /// Returns the work of all renderers that share the device, so far.
    pub(crate) fn work(&self) -> DeviceWork {
        *lock(&self.work)
    }

    pub(crate) fn count(&self, add: impl FnOnce(&mut DeviceWork)) {
        add(&mut lock(&self.work));
    }

    /// Returns the memory that is allocated on the device, bytes, where its interface tells.
    pub(crate) fn memory(&self) -> Option<u64> {
        self.device.generate_allocator_report().map(|report| report.total_allocated_bytes)
    }

    /// Waits until all submitted work is done.
    pub(crate) fn finish(&self) -> Result<(), GpuError> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        waited.map(|_| ()).map_err(|error| GpuError::Refused(error.to_string()))
    }

    /// Writes bytes to a buffer before the next submission.
    pub(crate) fn write(&self, buffer: &wgpu::Buffer, offset: u64, bytes: &[u8]) {
        self.count(|work| work.sent += bytes.len() as u64);
        self.queue.write_buffer(buffer, offset, bytes);
    }

    /// Returns a compiled program; compiles it on first use.
    pub(crate) fn pipeline(&self, program: &Program) -> wgpu::ComputePipeline {
        let mut pipelines = lock(&self.pipelines);
        if let Some(pipeline) = pipelines.get(program) {
            return pipeline.clone();
        }
        let module = self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(program.entry),
            source: wgpu::ShaderSource::Wgsl(program.text().into()),
        });
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(program.entry),
            layout: None,
            module: &module,
            entry_point: Some(program.entry),
            compilation_options: wgpu::PipelineCompilationOptions {
                // Every stage writes what it reads of it.
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            },
            cache: None,
        });
        pipelines.insert(program.clone(), pipeline.clone());
        pipeline
    }

    /// Checks that a program can bind `bytes` bytes at once.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if not.
    pub(crate) fn check_binding(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        let most = self.most_binding;
        if bytes > most { Err(GpuError::TooLarge { what, bytes, most }) } else { Ok(()) }
    }

    /// A buffer of at least `bytes`, zeroed.
    ///
    /// # Errors
    /// [`GpuError`] if it is larger than the adapter allows, or memory is short.
    pub(crate) fn buffer(
        &self,
        what: &'static str,
        bytes: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        // Never empty, so that it can be bound.
        let size = bytes.max(256).next_multiple_of(4);
        if size > self.most_buffer {
            return Err(GpuError::TooLarge { what, bytes, most: self.most_buffer });
        }
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let descriptor = wgpu::BufferDescriptor { label: Some(what), size, usage, mapped_at_creation: false };
        let buffer = self.device.create_buffer(&descriptor);
        // A browser reports this later, like other errors.
        if ready(memory.pop()).flatten().is_some() {
            return Err(GpuError::Memory { what, bytes });
        }
        Ok(buffer)
    }

    /// Makes a buffer for programs to read, with these bytes.
    ///
    /// # Errors
    /// [`GpuError`] if it is larger than a program can bind, or memory is short.
    pub(crate) fn upload(&self, what: &'static str, bytes: &[u8]) -> Result<wgpu::Buffer, GpuError> {
        self.check_binding(what, bytes.len() as u64)?;
        let buffer = self.buffer(what, bytes.len() as u64, WRITTEN)?;
        self.write(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// Takes the device away, as a driver's reset would: for tests.
    #[cfg(any(test, feature = "testing"))]
    pub fn lose(&self) {
        self.device.destroy();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
