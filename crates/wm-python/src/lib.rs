//! The native part of the Python package `weather_magician`.
//!
//! Classes hold the library's values; arrays are moved into NumPy. What they are for is told in `weather_magician/__init__.pyi`.

mod batch;
mod error;
mod process;
mod renderer;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<batch::Batch>()?;
    module.add_function(wrap_pyfunction!(batch::_open_batch, module)?)?;
    Ok(())
}
