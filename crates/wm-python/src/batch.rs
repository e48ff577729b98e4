//! Data sets by a plan, block for block.

use crate::error::{Error, Failure, Outcome};
use crate::process::{PerProcess, Reporter, detached, on_threads};
use crate::renderer::device_of;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyRange, PyTuple};
use std::path::{Path, PathBuf};
use weather_magician::assets::AssetCache;
use weather_magician::batch::{BatchPlan, BatchRun, BatchStore, merge, missing_blocks};
use weather_magician::{CpuConfig, Renderer};

/// A plan that is being carried out. See `weather_magician/__init__.pyi`.
#[pyclass(frozen, module = "weather_magician")]
pub struct Batch {
    plan: PathBuf,
    out: PathBuf,
    device: String,
    threads: Option<usize>,
    facts: BatchFacts,
    run: PerProcess<BatchRun>,
}

struct BatchFacts {
    name: String,
    digest: String,
    clips: u64,
    frames: u64,
    blocks: u64,
}

impl BatchFacts {
    fn of(run: &BatchRun) -> Self {
        Self {
            name: run.plan.name.clone(),
            digest: run.plan.digest.clone(),
            clips: run.clips.clips(),
            frames: run.clips.frames(),
            blocks: run.clips.blocks(),
        }
    }
}

fn open_run(plan: &Path, device: &str, threads: Option<usize>) -> Outcome<BatchRun> {
    let plan = BatchPlan::read(plan)?;
    let cpu = CpuConfig { threads, ..CpuConfig::default() };
    let renderer = Renderer::new(&device_of(device)?, cpu, |_| {})?;
    Ok(on_threads(|| BatchRun::new(plan, renderer, |scene| Some(AssetCache::folder_of(scene))))??)
}

impl Batch {
    fn with<R: Send>(&self, work: impl FnOnce(&mut BatchRun) -> Outcome<R> + Send) -> Outcome<R> {
        let make = || {
            let run = open_run(&self.plan, &self.device, self.threads)?;
            if run.plan.digest != self.facts.digest {
                let says = format!("{}: has changed since it was opened", self.plan.display());
                return Err(Failure::Library(says));
            }
            Ok(run)
        };
        self.run.with(make, |run| on_threads(|| work(run))?)
    }

    fn store(&self) -> Outcome<BatchStore> {
        Ok(BatchStore::new(&self.out)?)
    }

    fn check(&self, block: u64) -> PyResult<()> {
        if block < self.facts.blocks {
            return Ok(());
        }
        Err(PyIndexError::new_err(format!("block {block}: the set has {}", self.facts.blocks)))
    }

    fn make_block(&self, block: u64, reporter: &mut Reporter<'_>) -> Outcome<()> {
        let store = self.store()?;
        self.with(|run| {
            let planned = run.clips.block(block);
            match run.make(&store, &planned, reporter) {
                Err(weather_magician::Error::Stopped) => Err(Failure::Stopped),
                Err(error) => Err(Failure::Library(format!("block {block}: {}", crate::error::line_of(&error)))),
                Ok(()) => Ok(()),
            }
        })
    }
}

#[pymethods]
impl Batch {
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
        let facts = BatchFacts::of(&run);
        let out = out.unwrap_or_else(|| PathBuf::from(&facts.name));
        let slot = PerProcess::new();
        *slot.lock() = Some(run);
        Ok(Self { plan, out, device: device.to_owned(), threads, facts, run: slot })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, own) = (slf.py(), slf.get());
        let again = py.import("weather_magician")?.getattr("_open_batch")?;
        let args = (&own.plan, &own.out, &own.device, own.threads, &own.facts.digest).into_pyobject(py)?;
        Ok((again, args))
    }

    fn __repr__(&self) -> String {
        format!(
            "Batch({:?}, out={:?}): {} clips, {} frames, {} blocks",
            self.plan.display().to_string(),
            self.out.display().to_string(),
            self.facts.clips,
            self.facts.frames,
            self.facts.blocks
        )
    }

    #[getter]
    fn plan(&self) -> String {
        self.plan.display().to_string()
    }

    #[getter]
    fn out(&self) -> String {
        self.out.display().to_string()
    }

    #[getter]
    fn name(&self) -> &str {
        &self.facts.name
    }

    #[getter]
    fn digest(&self) -> &str {
        &self.facts.digest
    }

    #[getter]
    fn clips(&self) -> u64 {
        self.facts.clips
    }

    #[getter]
    fn frames(&self) -> u64 {
        self.facts.frames
    }

    #[getter]
    fn blocks(&self) -> u64 {
        self.facts.blocks
    }

    fn shard<'py>(&self, py: Python<'py>, index: u64, count: u64) -> PyResult<Bound<'py, PyRange>> {
        if index >= count {
            return Err(PyValueError::new_err(format!("shard {index} of {count}: they are counted from 0")));
        }
        let own = detached(py, |_| self.with(|run| Ok(run.clips.shard(index, count))))?;
        PyRange::new(py, own.start as isize, own.end as isize)
    }

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

    fn missing(&self, py: Python<'_>) -> PyResult<Vec<u64>> {
        detached(py, |_| {
            let store = self.store()?;
            self.with(|run| Ok(missing_blocks(run, &store)?))
        })
    }

    fn marker<'py>(&self, py: Python<'py>, number: u64) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.check(number)?;
        let text = detached(py, |_| {
            let marker = self.store()?.marker(number, &self.facts.digest)?;
            marker
                .map(|marker| serde_json::to_string(&marker))
                .transpose()
                .map_err(|error| Failure::Library(error.to_string()))
        })?;
        text.map(|text| py.import("json")?.call_method1("loads", (text,))).transpose()
    }

    #[pyo3(signature = (block, progress=None))]
    fn make(&self, py: Python<'_>, block: u64, progress: Option<Py<PyAny>>) -> PyResult<()> {
        self.check(block)?;
        detached(py, |stop| {
            let mut reporter = Reporter::new(stop, progress.as_ref());
            let made = self.make_block(block, &mut reporter);
            reporter.outcome(made)
        })
    }

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

    #[pyo3(signature = (verify=false))]
    fn merge<'py>(&self, py: Python<'py>, verify: bool) -> PyResult<Bound<'py, PyDict>> {
        let merged = detached(py, |stop| {
            let store = self.store()?;
            self.with(|run| {
                let mut reporter = Reporter::new(stop, None);
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

    fn take_warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        detached(py, |_| self.with(|run| Ok(run.take_warnings())))
    }
}

/// Opens a plan that was pickled, and checks that it is the same.
#[pyfunction]
pub fn _open_batch(
    py: Python<'_>,
    plan: PathBuf,
    out: PathBuf,
    device: &str,
    threads: Option<usize>,
    digest: &str,
) -> PyResult<Batch> {
    let opened = Batch::new(py, plan, Some(out), device, threads)?;
    if opened.facts.digest == digest {
        return Ok(opened);
    }
    Err(Error::new_err(format!("{}: is not the plan that was pickled", opened.plan.display())))
}
