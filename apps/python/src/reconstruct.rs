//! Photos to a scene.

use crate::error::{Failure, line_of, value_of};
use crate::process::{StopFlag, detached, device_of, on_threads};
use crate::scene::PyScene;
use pyo3::prelude::*;
use pyo3::types::IntoPyDict;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use weather_magician::train::session::{
    HeldOutScores, Resume, Session, SessionError, SessionOptions, StepProgress, StepSummary, TrainNotice,
    TrainObserver, TrainReport, TrainWarning,
};
use weather_magician::train::{Preset, TrainPlan};

/// Events of a training as calls of a Python function.
struct Events<'a> {
    stop: &'a StopFlag,
    callback: Option<&'a Py<PyAny>>,
    raised: Option<PyErr>,
}

/// A value of an event.
#[derive(IntoPyObject)]
enum Fact {
    Count(u64),
    Number(f64),
    Text(String),
}

impl Events<'_> {
    fn tell(&mut self, event: &str, facts: Vec<(&str, Fact)>) {
        let Some(callback) = self.callback.filter(|_| self.raised.is_none()) else { return };
        let called = Python::attach(|py| callback.call1(py, (event, facts.into_py_dict(py)?)).map(drop));
        self.raised = called.err();
    }
}

impl TrainObserver for Events<'_> {
    fn proceed(&mut self) -> ControlFlow<()> {
        if self.raised.is_some() || self.stop.is_set() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    fn on_warning(&mut self, warning: &TrainWarning) {
        self.tell("warning", vec![("text", Fact::Text(warning.to_string()))]);
    }

    fn on_notice(&mut self, notice: &TrainNotice) {
        self.tell("notice", vec![("text", Fact::Text(notice.to_string()))]);
    }

    fn on_step(&mut self, step: &StepProgress) {
        let StepProgress { step, steps, splats, loss } = *step;
        let count = |number: u32| Fact::Count(u64::from(number));
        let splats = Fact::Count(splats as u64);
        self.tell(
            "step",
            vec![
                ("step", count(step)),
                ("steps", count(steps)),
                ("splats", splats),
                ("loss", Fact::Number(loss)),
            ],
        );
    }

    fn on_summary(&mut self, summary: &StepSummary) {
        let mut facts = vec![
            ("step", Fact::Count(u64::from(summary.step))),
            ("loss", Fact::Number(summary.loss)),
            ("step_seconds", Fact::Number(summary.step_seconds)),
            ("splats", Fact::Count(summary.splats as u64)),
        ];
        facts.extend(summary.held_out_psnr.map(|psnr| ("held_out_psnr", Fact::Number(psnr))));
        self.tell("summary", facts);
    }

    fn on_evaluation(&mut self, scores: &HeldOutScores) {
        if let Some(mean) = scores.mean() {
            self.tell(
                "evaluation",
                vec![("psnr", Fact::Number(mean.psnr)), ("ssim", Fact::Number(mean.ssim))],
            );
        }
    }

    fn on_checkpoint(&mut self, path: &Path, step: u32) {
        let path = Fact::Text(path.display().to_string());
        self.tell("checkpoint", vec![("path", path), ("step", Fact::Count(u64::from(step)))]);
    }

    fn on_finish(&mut self, _: &TrainReport) {
        self.tell("finish", Vec::new());
    }
}

#[doc = docs!("reconstruct")]
#[pyfunction]
#[pyo3(signature = (photos, *, preset="standard", steps=None, max_splats=None, eval_every=0, run_folder=None, resume="never", metres_per_unit=None, camera_height=None, device="auto", threads=None, callback=None))]
#[allow(clippy::too_many_arguments)] // As many as Python's.
pub(crate) fn reconstruct(
    py: Python<'_>,
    photos: PathBuf,
    preset: &str,
    steps: Option<u32>,
    max_splats: Option<usize>,
    eval_every: u32,
    run_folder: Option<PathBuf>,
    resume: &str,
    metres_per_unit: Option<f64>,
    camera_height: Option<f64>,
    device: &str,
    threads: Option<usize>,
    callback: Option<Py<PyAny>>,
) -> PyResult<PyScene> {
    let presets = [
        ("draft", Preset::Draft),
        ("quick", Preset::Quick),
        ("standard", Preset::Standard),
        ("best", Preset::Best),
    ];
    let preset = value_of("preset", preset, &presets)?;
    let ways = [("never", Resume::Never), ("always", Resume::Always), ("overwrite", Resume::Overwrite)];
    let resume = value_of("resume", resume, &ways)?;
    detached(py, |stop| {
        let mut options = SessionOptions {
            plan: TrainPlan { preset, steps, max_splats, ..TrainPlan::default() },
            run_folder,
            resume,
            camera_height,
            device: device_of(device)?,
            ..SessionOptions::default()
        };
        options.cpu.threads = threads;
        options.held_out.every = eval_every;
        options.facts.metres_per_unit = metres_per_unit;
        if let Some(fault) = options.facts.fault() {
            return Err(Failure::Library(fault));
        }
        let mut events = Events { stop, callback: callback.as_ref(), raised: None };
        let made = on_threads(|| Session::new(photos).options(options).run(&mut events).map_err(Box::new))?;
        match (made, events.raised) {
            (_, Some(raised)) => Err(Failure::Python(raised)),
            (Err(error), None) => match *error {
                SessionError::Stopped { .. } => Err(Failure::Stopped),
                error => Err(Failure::Library(line_of(&error))),
            },
            (Ok(scene), None) => Ok(PyScene::made(scene)),
        }
    })
}
