//! binaryen's wasm-opt, if there is one.

use crate::toolchain::on_path;
use anyhow::{Context, Result, ensure};
use std::path::Path;
use std::process::Command;

/// The features of the module: those of Rust's target, and vectors. With all of binaryen's the
/// module does not load.
const FEATURES: [&str; 8] = [
    "bulk-memory",
    "bulk-memory-opt",
    "sign-ext",
    "mutable-globals",
    "nontrapping-float-to-int",
    "reference-types",
    "multivalue",
    "simd",
];

/// Makes a module smaller with wasm-opt; leaves it as it is if there is none.
pub fn shrink(module: &Path) -> Result<()> {
    let Some(program) = on_path("wasm-opt") else {
        eprintln!("wasm-opt is not on PATH: the module is larger than it could be (npm install -g binaryen)");
        return Ok(());
    };
    let smaller = module.with_extension("smaller");
    let mut command = Command::new(&program);
    command
        .arg("-O3")
        .args(FEATURES.map(|feature| format!("--enable-{feature}")))
        .arg("-o")
        .arg(&smaller)
        .arg(module);
    let status = command.status().with_context(|| format!("cannot run {}", program.display()))?;
    ensure!(status.success(), "{} fails", program.display());
    std::fs::rename(&smaller, module).with_context(|| smaller.display().to_string())
}
