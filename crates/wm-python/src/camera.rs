//! Cameras.

use crate::arrays::{intrinsics, k_of, matrices, vector, viewmat_of};
use crate::error::{Error, line_of};
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use weather_magician::view::{DEFAULT_FOV, DEFAULT_SIZE, spec};

/// A pinhole camera. See `weather_magician/__init__.pyi`.
#[pyclass(frozen, module = "weather_magician")]
#[derive(Clone, Copy)]
pub struct Camera {
    pub camera: wm_scene::Camera,
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (viewmat, K, width, height, *, near=wm_scene::Camera::DEFAULT_NEAR))]
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

    #[staticmethod]
    #[pyo3(signature = (eye, target, up, *, fov=DEFAULT_FOV, size=DEFAULT_SIZE, near=wm_scene::Camera::DEFAULT_NEAR))]
    fn look_at(
        eye: &Bound<'_, PyAny>,
        target: &Bound<'_, PyAny>,
        up: &Bound<'_, PyAny>,
        fov: f64,
        size: (u32, u32),
        near: f64,
    ) -> PyResult<Self> {
        let (eye, target, up) = (vector(eye, "eye")?, vector(target, "target")?, vector(up, "up")?);
        let made = wm_scene::Camera::looking(size, fov, eye, target, up);
        let camera = made.map(|camera| wm_scene::Camera { near, ..camera });
        let camera = camera.and_then(|camera| camera.check().map(|()| camera));
        Ok(Self { camera: camera.map_err(|error| Error::new_err(line_of(&error)))? })
    }

    fn __repr__(&self) -> String {
        let wm_scene::Camera { width, height, .. } = self.camera;
        format!("Camera({}, {width}x{height}, fov {:.1})", spec::text_of(&self.camera), self.camera.fov_y())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, camera) = (slf.py(), &slf.get().camera);
        let again = py.import("weather_magician")?.getattr("_camera_of")?;
        let args = (viewmat_of(py, camera)?, k_of(py, camera)?, camera.width, camera.height, camera.near);
        Ok((again, args.into_pyobject(py)?))
    }

    #[getter]
    fn viewmat<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        viewmat_of(py, &self.camera)
    }

    #[getter(K)]
    fn k<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        k_of(py, &self.camera)
    }

    #[getter]
    fn width(&self) -> u32 {
        self.camera.width
    }

    #[getter]
    fn height(&self) -> u32 {
        self.camera.height
    }

    #[getter]
    fn near(&self) -> f64 {
        self.camera.near
    }

    fn resized(&self, width: u32, height: u32) -> PyResult<Self> {
        let camera = self.camera.resized(width, height);
        camera.check().map_err(|error| Error::new_err(line_of(&error)))?;
        Ok(Self { camera })
    }
}

/// Makes a camera that was pickled.
#[pyfunction]
pub fn _camera_of(
    viewmat: &Bound<'_, PyAny>,
    k: &Bound<'_, PyAny>,
    width: u32,
    height: u32,
    near: f64,
) -> PyResult<Camera> {
    Camera::new(viewmat, k, width, height, near)
}
