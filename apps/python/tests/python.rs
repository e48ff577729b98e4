//! Runs the tests of the Python package with pytest, on the extension that was built with this
//! test.
//!
//! They are skipped, with a word, where Python, NumPy or pytest is missing; `WM_REQUIRE_PYTHON=1`
//! makes that a failure. `WM_PYTHON` names the interpreter, `python3` by default.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

#[test]
fn the_package_passes_its_tests() {
    let python = env::var("WM_PYTHON").unwrap_or_else(|_| "python3".into());
    let found = Command::new(&python).args(["-c", "import numpy, pytest"]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        let says = format!("{python} with numpy and pytest is not here; WM_PYTHON names another");
        assert!(env::var("WM_REQUIRE_PYTHON").is_err(), "{says}");
        eprintln!("skipped: {says}");
        return;
    }
    let made = tempfile::tempdir().expect("a folder");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let package = made.path().join("weather_magician");
    copy(&root.join("python/weather_magician"), &package);
    let extension = extension();
    // A link, since the file is large; a copy where there are none.
    let here = package.join(format!("_native.{}", if cfg!(windows) { "pyd" } else { "abi3.so" }));
    fs::hard_link(&extension, &here)
        .or_else(|_| fs::copy(&extension, &here).map(drop))
        .expect("the extension");
    let tests = Command::new(&python)
        .args(["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"])
        .arg(root.join("tests/python"))
        .env("PYTHONPATH", made.path())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .status()
        .expect("pytest");
    assert!(tests.success(), "pytest: {tests}");
}

/// The extension beside this test.
fn extension() -> PathBuf {
    let test = env::current_exe().expect("this test's own path");
    let name = format!("{}_native{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX);
    let found = test.ancestors().skip(1).take(2).map(|folder| folder.join(&name)).find(|path| path.is_file());
    found.expect("Cargo builds the extension before this test")
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder");
    for entry in fs::read_dir(from).expect("the package") {
        let path = entry.expect("an entry").path();
        let (name, is_source) = (path.file_name().expect("a name"), !path.ends_with("__pycache__"));
        match path.is_dir() {
            true if is_source => copy(&path, &to.join(name)),
            // A build in place would hide the extension under test.
            false if path.extension().is_none_or(|ending| ending != "so" && ending != "pyd") => {
                fs::copy(&path, to.join(name)).expect("a file");
            }
            _ => {}
        }
    }
}
