//! Parameters of the renderer's functions, read and checked.

use crate::arrays::{numbers, shape_fault};
use crate::camera::PyCamera;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::path::PathBuf;
use weather_magician::view::ViewOptions;
use wm_scene::camera::FOV_RANGE_DEG;

/// A camera as functions take it.
pub(super) enum CameraInput {
    /// A camera.
    Camera(wm_scene::Camera),
    /// Eye and target, a view's name or number, or a file of keyframes.
    Spec(String),
    /// One that suits the scene.
    Chosen,
}

impl CameraInput {
    pub(super) fn of(value: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let Some(value) = value else { return Ok(Self::Chosen) };
        if let Ok(camera) = value.cast::<PyCamera>() {
            return Ok(Self::Camera(camera.get().camera));
        }
        if let Ok(number) = value.extract::<u32>() {
            return Ok(Self::Spec(number.to_string()));
        }
        if let Ok(spec) = value.extract::<PathBuf>() {
            return Ok(Self::Spec(spec.to_string_lossy().into_owned()));
        }
        let says = "camera: must be a Camera, a text such as \"0,0,2:0,10,2\", the name or the number of a view, or None";
        Err(PyTypeError::new_err(says))
    }
}

pub(super) fn view_options(size: Option<(u32, u32)>, fov: Option<f64>) -> PyResult<ViewOptions> {
    if let Some(fov) = fov.filter(|fov| !FOV_RANGE_DEG.contains(fov)) {
        return Err(PyValueError::new_err(format!("fov {fov}: must be 0.1 to 170 degrees")));
    }
    Ok(ViewOptions { size, fov, ..ViewOptions::default() })
}

pub(super) fn finite(name: &str, value: f64) -> PyResult<f64> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(PyValueError::new_err(format!("{name} {value}: must be a number")))
}

/// The times of `count` frames: one for all, or one each.
pub(super) fn times_of(time: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Vec<f64>> {
    let Some(time) = time else { return Ok(vec![0.0; count]) };
    let (times, shape) = numbers::<f64>(time, "time")?;
    let times = match times[..] {
        [time] => vec![time; count],
        _ if shape == [count] => times,
        _ => return Err(shape_fault("time", &format!("[] or [{count}]"), &shape)),
    };
    times.into_iter().map(|time| finite("time", time)).collect()
}
