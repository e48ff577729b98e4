//! The native part of the Python package `weather_magician`.
//!
//! Classes hold the library's values; arrays are moved into NumPy. What they are for is told in
//! `weather_magician/_native.pyi`.
//!
//! - Classes are frozen. Arrays of a scene are views into it (`arrays.rs`), the only `unsafe` code
//!   but for that of PyO3's macros.
//! - Work has a thread of its own (`process.rs`). The caller's thread waits without the GIL and
//!   asks the interpreter for signals 20 times a second, since only the main thread is told of
//!   Ctrl-C. It sets a flag that the library's `Progress` reads.
//! - A fork has no threads. So renderers and pools are `PerProcess`: a child finds a slot of its
//!   own empty, makes its own, and never touches the locks of its parent. All work runs in such a
//!   pool, so that rayon's global pool, which would be dead in a fork, is never started.
//! - Docstrings are written once, in the stub file; `build.rs` gives them to the extension.
//! - The program is in the extension too (`run_program`), so a wheel has one binary.
//! - Sets on many machines are made in Python (`weather_magician/cluster/`), by a runner of tasks
//!   that knows nothing of sets. Only small messages go through Ray, files do not.

// The docstrings of the stub file, as `docs!`.
include!(concat!(env!("OUT_DIR"), "/docs.rs"));

mod arrays;
mod batch;
mod camera;
mod error;
mod picture;
mod process;
mod reconstruct;
mod renderer;
mod sample;
mod scene;
mod weather;

use pyo3::prelude::*;
use std::ffi::OsString;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("LIDAR_CLASSES", lidar_classes())?;
    module.add_class::<scene::PyScene>()?;
    module.add_class::<scene::PySplats>()?;
    module.add_class::<camera::PyCamera>()?;
    module.add_class::<weather::PyWeather>()?;
    module.add_class::<renderer::PyRenderer>()?;
    module.add_class::<picture::PyPicture>()?;
    module.add_class::<batch::PyBatch>()?;
    module.add_function(wrap_pyfunction!(reconstruct::reconstruct, module)?)?;
    module.add_function(wrap_pyfunction!(run_program, module)?)?;
    module.add("CONDITIONS", sample::conditions())?;
    module.add_class::<sample::SplitFrames>()?;
    module.add_class::<sample::Permutation>()?;
    // What pickles call.
    module.add_function(wrap_pyfunction!(scene::_scene_of_file, module)?)?;
    module.add_function(wrap_pyfunction!(scene::_scene_of_bytes, module)?)?;
    module.add_function(wrap_pyfunction!(weather::_weather_of, module)?)?;
    module.add_function(wrap_pyfunction!(batch::_open_batch, module)?)?;
    // PyO3 lists what pickles call too.
    module.delattr("__all__")
}

/// The names of the classes of lidar points, by their numbers.
fn lidar_classes() -> Vec<&'static str> {
    weather_magician::lidar::EchoClass::ALL.iter().map(|class| class.name()).collect()
}

/// Runs the program with these arguments, of which the first is its name, and returns its exit
/// status.
#[pyfunction]
fn run_program(py: Python<'_>, args: Vec<OsString>) -> u8 {
    py.detach(|| weather_magician_cli::run(args))
}
