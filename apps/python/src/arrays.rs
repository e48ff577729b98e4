//! Arrays between Python and the library.

use glam::{DMat4, DVec3};
use numpy::ndarray::{ArrayView, Dimension, ShapeBuilder, StrideShape};
use numpy::{Element, IxDyn, PyArray, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use weather_magician::Camera;

/// Moves values into an array of a shape.
///
/// # Errors
/// `ValueError` if their number is not that of the shape.
pub(crate) fn moved<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, values).reshape(IxDyn(shape))
}

/// Returns a read-only array over values that `owner` holds.
pub(crate) fn view<'py, T: Element, D: Dimension>(
    owner: Bound<'py, PyAny>,
    values: &[T],
    shape: impl ShapeBuilder<Dim = D> + Into<StrideShape<D>>,
) -> PyResult<Bound<'py, PyArray<T, D>>> {
    let values = ArrayView::from_shape(shape, values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    // SAFETY: the values lie in an `Arc` of the frozen class `owner`, which the array keeps alive
    // and which nobody changes.
    #[allow(unsafe_code)]
    let array = unsafe { PyArray::borrow_from_array(&values, owner) };
    array.readwrite().make_nonwriteable();
    Ok(array)
}

/// Reads numbers of any kind that NumPy converts (arrays, lists, tensors on the CPU) and their
/// shape.
pub(crate) fn numbers<T: Element + Copy>(
    value: &Bound<'_, PyAny>,
    name: &str,
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let py = value.py();
    let options = PyDict::new(py);
    options.set_item("dtype", numpy::dtype::<T>(py))?;
    let made = py.import("numpy")?.call_method("ascontiguousarray", (value,), Some(&options));
    let made = made.map_err(|error| PyValueError::new_err(format!("{name}: {}", error.value(py))))?;
    let array: PyReadonlyArrayDyn<'_, T> = made.extract()?;
    let shape = array.as_array().shape().to_vec();
    Ok((array.as_slice()?.to_vec(), shape))
}

/// The fault of an array of the wrong shape.
pub(crate) fn shape_fault(name: &str, wanted: &str, shape: &[usize]) -> PyErr {
    PyValueError::new_err(format!("{name}: must have the shape {wanted}, not {shape:?}"))
}

/// Reads `[C, 4, 4]`, or `[4, 4]` as one.
pub(crate) fn matrices(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<DMat4>> {
    let (values, shape) = numbers::<f64>(value, name)?;
    if !matches!(shape[..], [4, 4] | [_, 4, 4]) {
        return Err(shape_fault(name, "[C, 4, 4]", &shape));
    }
    let (all, _) = values.as_chunks::<16>();
    // NumPy's rows are glam's columns.
    Ok(all.iter().map(|values| DMat4::from_cols_array(values).transpose()).collect())
}

/// Reads `[C, 3, 3]`, or `[3, 3]` as one: fx, fy, cx and cy of each, px.
pub(crate) fn intrinsics(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[f64; 4]>> {
    let (values, shape) = numbers::<f64>(value, name)?;
    if !matches!(shape[..], [3, 3] | [_, 3, 3]) {
        return Err(shape_fault(name, "[C, 3, 3]", &shape));
    }
    let (all, _) = values.as_chunks::<9>();
    let read = |k: &[f64; 9]| match k {
        [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0] => Ok([*fx, *fy, *cx, *cy]),
        _ => Err(PyValueError::new_err(format!(
            "{name}: must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: skew is not rendered"
        ))),
    };
    all.iter().map(read).collect()
}

/// Reads a point.
pub(crate) fn vector(value: &Bound<'_, PyAny>, name: &str) -> PyResult<DVec3> {
    let (values, shape) = numbers::<f64>(value, name)?;
    match values[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(shape_fault(name, "[3]", &shape)),
    }
}

/// Reads a direction of any length but 0, and returns it at length 1.
pub(crate) fn direction(value: &Bound<'_, PyAny>, name: &str) -> PyResult<DVec3> {
    let wrong = || PyValueError::new_err(format!("{name}: must be a direction, not a vector without length"));
    vector(value, name)?.try_normalize().ok_or_else(wrong)
}

/// Returns a matrix as `[4, 4]`.
pub(crate) fn matrix<'py>(py: Python<'py>, matrix: &DMat4) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    // NumPy's rows are glam's columns.
    moved(py, matrix.transpose().to_cols_array().to_vec(), &[4, 4])
}

/// Returns `K [3, 3]` of a camera.
pub(crate) fn k_of<'py>(py: Python<'py>, camera: &Camera) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let Camera { fx, fy, cx, cy, .. } = *camera;
    moved(py, vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], &[3, 3])
}
