//! Cameras.

use crate::arrays::{intrinsics, k_of, matrices, matrix, vector};
use crate::error::{Error, line_of};
use glam::DVec3;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use weather_magician::view::{DEFAULT_SIZE, spec};

#[doc = docs!("Camera")]
#[pyclass(frozen, name = "Camera", module = "weather_magician")]
#[derive(Clone, Copy)]
pub(crate) struct PyCamera {
    pub(crate) camera: wm_scene::Camera,
}

#[pymethods]
impl PyCamera {
    #[new]
    #[pyo3(signature = (viewmat, K, width, height, *, near=0.2))]
    #[allow(non_snake_case)] // Its name in the field.
    fn new(
        viewmat: &Bound<'_, PyAny>,
        K: &Bound<'_, PyAny>,
        width: u32,
        height: u32,
        near: f64,
    ) -> PyResult<Self> {
        let (viewmats, ks) = (matrices(viewmat, "viewmat")?, intrinsics(K, "K")?);
        let ([viewmat], [[fx, fy, cx, cy]]) = (&viewmats[..], &ks[..]) else {
            return Err(PyValueError::new_err(
                "viewmat and K: must be those of one camera, [4, 4] and [3, 3]",
            ));
        };
        let camera =
            wm_scene::Camera { width, height, fx: *fx, fy: *fy, cx: *cx, cy: *cy, viewmat: *viewmat, near };
        camera.check().map_err(|error| Error::new_err(line_of(&error)))?;
        Ok(Self { camera })
    }

    #[doc = docs!("Camera.look_at")]
    #[staticmethod]
    #[pyo3(signature = (eye, target, up, *, fov=50.0, size=None, near=0.2))]
    fn look_at(
        eye: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: &Bound<'_, PyAny>,
        fov: f64,
        size: Option<(u32, u32)>,
        near: f64,
    ) -> PyResult<Self> {
        let size = size.unwrap_or(DEFAULT_SIZE);
        let (eye, target, up) = (vector(eye, "eye")?, vector(target, "target")?, vector(up, "up")?);
        let made = wm_scene::Camera::looking(size, fov, eye, target, up);
        let camera = made.map(|camera| wm_scene::Camera { near, ..camera });
        let camera = camera.and_then(|camera| camera.check().map(|()| camera));
        Ok(Self { camera: camera.map_err(|error| Error::new_err(line_of(&error)))? })
    }

    fn __repr__(&self) -> String {
        let wm_scene::Camera { width, height, .. } = self.camera;
        format!(
            "Camera({}, {width}x{height}, fov {:.1})",
            spec::text_of(&self.camera, DVec3::ZERO),
            self.camera.fov_y()
        )
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let wm_scene::Camera { viewmat, width, height, near, .. } = &self.camera;
        let options = PyDict::new(py);
        options.set_item("near", near)?;
        Ok(((matrix(py, viewmat)?, k_of(py, &self.camera)?, width, height).into_pyobject(py)?, options))
    }

    #[doc = docs!("Camera.viewmat")]
    #[getter]
    fn viewmat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        matrix(py, &self.camera.viewmat)
    }

    #[doc = docs!("Camera.K")]
    #[getter(K)]
    fn k<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        k_of(py, &self.camera)
    }

    #[doc = docs!("Camera.width")]
    #[getter]
    fn width(&self) -> u32 {
        self.camera.width
    }

    #[doc = docs!("Camera.height")]
    #[getter]
    fn height(&self) -> u32 {
        self.camera.height
    }

    #[doc = docs!("Camera.near")]
    #[getter]
    fn near(&self) -> f64 {
        self.camera.near
    }

    #[doc = docs!("Camera.resized")]
    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        let camera = self.camera.resized(width, height);
        camera.check().map_err(|error| Error::new_err(line_of(&error)))?;
        Ok(Self { camera })
    }
}
