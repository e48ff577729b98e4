//! Errors of a session, with the options that help.

use crate::interrupt::stopped;
use anyhow::anyhow;
use weather_magician::train::colmap::ColmapError;
use weather_magician::train::plan::PlanError;
use weather_magician::train::session::SessionError;
use weather_magician::train::video::VideoError;

const RESUME: &str = "the same command with --resume continues";

/// Returns the error as the command prints it.
pub(crate) fn explain(error: SessionError) -> anyhow::Error {
    match &error {
        SessionError::Colmap(ColmapError::Stopped { step, .. }) => {
            stopped(format!("{} is not done, {RESUME}", step.name()))
        }
        SessionError::Video(VideoError::Stopped) => stopped(format!("the video is not read yet, {RESUME}")),
        SessionError::StoppedEarly => stopped("no step is done yet"),
        SessionError::Stopped { step, steps } => {
            stopped(format!("{step} of {steps} steps are done, {RESUME}"))
        }
        SessionError::NothingToResume(_) => anyhow!("{error}; leave out --resume"),
        SessionError::Unfinished(_) => {
            anyhow!(
                "{error}; continue it with --resume, replace it with --overwrite, or choose another --run-folder"
            )
        }
        SessionError::Finished(_) => {
            anyhow!(
                "{error}; replace it with --overwrite, choose another --run-folder, or write its scene again with --resume"
            )
        }
        SessionError::OtherTraining(_) => {
            anyhow!(
                "{error}; give the options that it began with, or replace it with --overwrite in place of --resume, or choose \
                 another --run-folder"
            )
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
