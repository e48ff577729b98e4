//! Data sets by a plan, block for block.

use crate::error::{Error, Failure, Outcome};
use crate::process::{CallbackProgress, PerProcess, detached, device_of, pool_of};
use crate::sample::{SplitFrames, dict_of, layers_of, split_index};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyRange, PyTuple};
use rayon::ThreadPool;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weather_magician::assets::AssetCache;
use weather_magician::batch::{
    BatchPlan, BatchRun, BatchStore, SampleOptions, SplitClips, merge, missing_blocks,
};
use weather_magician::{CpuConfig, Renderer};

#[doc = docs!("Batch")]
#[pyclass(frozen, name = "Batch", module = "weather_magician")]
pub(crate) struct PyBatch {
    plan: PathBuf,
    out: PathBuf,
    device: String,
    threads: Option<usize>,
    #[doc = docs!("Batch.name")]
    #[pyo3(get)]
    name: String,
    #[doc = docs!("Batch.digest")]
    #[pyo3(get)]
    digest: String,
    #[doc = docs!("Batch.clips")]
    #[pyo3(get)]
    clips: u64,
    #[doc = docs!("Batch.frames")]
    #[pyo3(get)]
    frames: u64,
    #[doc = docs!("Batch.blocks")]
    #[pyo3(get)]
    blocks: u64,
    run: PerProcess<OpenBatch>,
}

/// A plan in this process, and threads of what is not its renderer's own work.
struct OpenBatch {
    run: BatchRun,
    pool: Arc<ThreadPool>,
}

fn open_run(plan: &Path, device: &str, threads: Option<usize>) -> Outcome<OpenBatch> {
    let plan = BatchPlan::read(plan)?;
    let cpu = CpuConfig { threads, ..CpuConfig::default() };
    let renderer = Renderer::new(&device_of(device)?, cpu, |_| {})?;
    let pool = pool_of(threads)?;
    let run = pool.install(|| BatchRun::new(plan, renderer, |scene| Some(AssetCache::folder_of(scene))))?;
    Ok(OpenBatch { run, pool })
}

impl PyBatch {
    fn with<R: Send>(&self, work: impl FnOnce(&mut BatchRun) -> Outcome<R> + Send) -> Outcome<R> {
        let make = || {
            let run = open_run(&self.plan, &self.device, self.threads)?;
            if run.run.plan.digest != self.digest {
                let says = format!("{}: has changed since it was opened", self.plan.display());
                return Err(Failure::Library(says));
            }
            Ok(run)
        };
        self.run.with(make, |OpenBatch { run, pool }| pool.install(|| work(run)))
    }

    fn store(&self) -> Outcome<BatchStore> {
        Ok(BatchStore::new(&self.out)?)
    }

    fn check(&self, block: u64) -> PyResult<()> {
        if block < self.blocks {
            return Ok(());
        }
        Err(PyIndexError::new_err(format!("block {block}: the set has {}", self.blocks)))
    }

    fn make_block(&self, block: u64, reporter: &mut CallbackProgress<'_>) -> Outcome<()> {
        let store = self.store()?;
        self.with(|run| {
            let planned = run.clips.block(block);
            match run.make(&store, &planned, reporter) {
                Err(weather_magician::Error::Stopped) => Err(Failure::Stopped),
                Err(error) => {
                    Err(Failure::Library(format!("block {block}: {}", crate::error::line_of(&error))))
                }
                Ok(()) => Ok(()),
            }
        })
    }
}

#[pymethods]
impl PyBatch {
    #[new]
    #[pyo3(signature = (plan, out=None, *, device="auto", threads=None))]
    fn new(
        py: Python<'_>,
        plan: PathBuf,
        out: Option<PathBuf>,
        device: &str,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let run = detached(py, |_| open_run(&plan, device, threads))?;
        let BatchRun { plan: read, clips, .. } = &run.run;
        let batch = Self {
            plan,
            out: out.unwrap_or_else(|| PathBuf::from(&read.name)),
            device: device.to_owned(),
            threads,
            name: read.name.clone(),
            digest: read.digest.clone(),
            clips: clips.clips(),
            frames: clips.frames(),
            blocks: clips.blocks(),
            run: PerProcess::new(),
        };
        *batch.run.lock() = Some(run);
        Ok(batch)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, own) = (slf.py(), slf.get());
        let again = py.import("weather_magician._native")?.getattr("_open_batch")?;
        let args = (&own.plan, &own.out, &own.device, own.threads, &own.digest).into_pyobject(py)?;
        Ok((again, args))
    }

    fn __repr__(&self) -> String {
        format!(
            "Batch({:?}, out={:?}): {} clips, {} frames, {} blocks",
            self.plan.display().to_string(),
            self.out.display().to_string(),
            self.clips,
            self.frames,
            self.blocks
        )
    }

    #[doc = docs!("Batch.plan")]
    #[getter]
    fn plan(&self) -> String {
        self.plan.display().to_string()
    }

    #[doc = docs!("Batch.out")]
    #[getter]
    fn out(&self) -> String {
        self.out.display().to_string()
    }

    #[doc = docs!("Batch.shard")]
    fn shard<'py>(&self, py: Python<'py>, index: u64, count: u64) -> PyResult<Bound<'py, PyRange>> {
        if index >= count {
            return Err(PyValueError::new_err(format!("shard {index} of {count}: they are counted from 0")));
        }
        let own = detached(py, |_| self.with(|run| Ok(run.clips.shard(index, count))))?;
        PyRange::new(py, own.start as isize, own.end as isize)
    }

    #[doc = docs!("Batch.block")]
    fn block<'py>(&self, py: Python<'py>, number: u64) -> PyResult<Bound<'py, PyDict>> {
        self.check(number)?;
        let (scene, frames) = detached(py, |_| {
            self.with(|run| {
                let block = run.clips.block(number);
                Ok((run.plan.scenes[block.scene].name.clone(), block.frames))
            })
        })?;
        let dict = PyDict::new(py);
        dict.set_item("scene", scene)?;
        dict.set_item("frames", (frames.start, frames.end))?;
        Ok(dict)
    }

    #[doc = docs!("Batch.missing")]
    fn missing(&self, py: Python<'_>) -> PyResult<Vec<u64>> {
        detached(py, |_| {
            let store = self.store()?;
            self.with(|run| Ok(missing_blocks(run, &store)?))
        })
    }

    #[doc = docs!("Batch.marker")]
    fn marker<'py>(&self, py: Python<'py>, number: u64) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.check(number)?;
        let text = detached(py, |_| {
            let marker = self.store()?.marker(number, &self.digest)?;
            marker
                .map(|marker| serde_json::to_string(&marker))
                .transpose()
                .map_err(|error| Failure::Library(error.to_string()))
        })?;
        text.map(|text| py.import("json")?.call_method1("loads", (text,))).transpose()
    }

    #[doc = docs!("Batch.make")]
    #[pyo3(signature = (block, progress=None))]
    fn make(&self, py: Python<'_>, block: u64, progress: Option<Py<PyAny>>) -> PyResult<()> {
        self.check(block)?;
        detached(py, |stop| {
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            let made = self.make_block(block, &mut reporter);
            reporter.outcome(made)
        })
    }

    #[doc = docs!("Batch.make_shard")]
    #[pyo3(signature = (index, count, progress=None))]
    fn make_shard(
        &self,
        py: Python<'_>,
        index: u64,
        count: u64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<u64>> {
        let own = self.shard(py, index, count)?;
        let mut made = Vec::new();
        for block in own.try_iter()? {
            let block: u64 = block?.extract()?;
            if self.marker(py, block)?.is_none() {
                self.make(py, block, progress.as_ref().map(|progress| progress.clone_ref(py)))?;
                made.push(block);
            }
        }
        Ok(made)
    }

    #[doc = docs!("Batch.merge")]
    #[pyo3(signature = (verify=false))]
    fn merge<'py>(&self, py: Python<'py>, verify: bool) -> PyResult<Bound<'py, PyDict>> {
        let merged = detached(py, |stop| {
            let store = self.store()?;
            self.with(|run| {
                let mut reporter = CallbackProgress::new(stop, None);
                let merged = merge(run, &store, verify, &mut reporter);
                reporter.outcome(merged)
            })
        })?;
        let dict = PyDict::new(py);
        let [clips, frames, readings] = merged.counts;
        dict.set_item("clips", clips)?;
        dict.set_item("frames", frames)?;
        dict.set_item("readings", readings)?;
        dict.set_item("bytes", merged.bytes)?;
        dict.set_item("warnings", merged.warnings)?;
        Ok(dict)
    }

    #[getter]
    #[doc = docs!("Batch.splits")]
    fn splits(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        detached(py, |_| self.with(|run| Ok(run.plan.splits.iter().map(|(name, _)| name.clone()).collect())))
    }

    #[doc = docs!("Batch.split")]
    fn split(&self, py: Python<'_>, name: String) -> PyResult<SplitFrames> {
        detached(py, |_| {
            self.with(|run| {
                let split = split_index(&run.plan.splits, &name)?;
                let clips = SplitClips::count(&run.plan, split, run.clips.clips());
                Ok(SplitFrames { name, clips, frames: u64::from(run.plan.frames) })
            })
        })
    }

    #[getter]
    #[doc = docs!("Batch.sensors")]
    fn sensors(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        detached(py, |_| {
            self.with(|run| Ok(run.rig.sensors.iter().map(|sensor| sensor.name.clone()).collect()))
        })
    }

    #[getter]
    #[doc = docs!("Batch.frames_per_clip")]
    fn frames_per_clip(&self) -> u64 {
        self.frames / self.clips.max(1)
    }

    #[pyo3(signature = (frame, sensor=None, layers=None, *, places=2))]
    #[doc = docs!("Batch.sample")]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        frame: i64,
        sensor: Option<&str>,
        layers: Option<Vec<String>>,
        places: usize,
    ) -> PyResult<Bound<'py, PyDict>> {
        let frame = u64::try_from(frame).ok().filter(|frame| *frame < self.frames);
        let frame =
            frame.ok_or_else(|| PyIndexError::new_err(format!("the set has {} frames", self.frames)))?;
        let layers = layers_of(layers)?;
        let (sample, set) = detached(py, |_| {
            self.with(|run| {
                let options = SampleOptions { sensor, layers, places };
                Ok((run.sample(frame, &options)?, run.set.clone()))
            })
        })?;
        dict_of(py, frame, sample, &set)
    }

    #[doc = docs!("Batch.take_warnings")]
    fn take_warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        detached(py, |_| self.with(|run| Ok(run.take_warnings())))
    }
}

/// Opens a plan that was pickled, and checks that it is the same.
#[pyfunction]
pub(crate) fn _open_batch(
    py: Python<'_>,
    plan: PathBuf,
    out: PathBuf,
    device: &str,
    threads: Option<usize>,
    digest: &str,
) -> PyResult<PyBatch> {
    let opened = PyBatch::new(py, plan, Some(out), device, threads)?;
    if opened.digest == digest {
        return Ok(opened);
    }
    Err(Error::new_err(format!("{}: is not the plan that was pickled", opened.plan.display())))
}
