//! Errors of a session, with the options that help.

use crate::interrupt::Interrupted;
use anyhow::anyhow;
use wm_train::plan::PlanError;
use wm_train::session::SessionError;

const RESUME: &str = "the same command with --resume continues";

/// Returns the error as the command prints it.
pub fn explain(error: SessionError) -> anyhow::Error {
    match &error {
        SessionError::StoppedEarly => Interrupted("no step is done yet".into()).into(),
        SessionError::Stopped { step, steps } => {
            Interrupted(format!("{step} of {steps} steps are done, {RESUME}")).into()
        }
        SessionError::NothingToResume(_) => anyhow!("{error}; leave out --resume"),
        SessionError::Unfinished(_) => {
            anyhow!("{error}; continue it with --resume, choose another --run-folder, or remove it")
        }
        SessionError::OtherTraining(_) => {
            anyhow!("{error}; give the options that it began with, or another --run-folder without --resume")
        }
        SessionError::DamagedPhoto { .. } => {
            anyhow!("{error}, {RESUME}, and with --skip-bad without such photos")
        }
        SessionError::GpuLost { .. } => anyhow!("{error}, {RESUME}, and with --device cpu on the CPU"),
        SessionError::SmallPhoto { photo, width, height, smallest } => anyhow!(
            "{photo}: {width}x{height} px is too small for --lpips, which needs {smallest} on each side; raise \
             --longest, hold out other photos, or leave --lpips out"
        ),
        SessionError::CameraHeight(height) => {
            anyhow!("--camera-height is {height}: it must be finite and above 0")
        }
        SessionError::Plan(PlanError::Value(error)) => anyhow!("--loss: {error}"),
        SessionError::Plan(error) => anyhow!("--loss {error}"),
        _ => match error {
            SessionError::Observer(error) => anyhow::Error::from_boxed(error),
            error => error.into(),
        },
    }
}
