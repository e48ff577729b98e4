//! The compiler for wasm32.

use anyhow::{Context, Result, bail, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The target.
pub const TARGET: &str = "wasm32-unknown-unknown";

/// The compiler that builds the player.
pub enum Toolchain {
    /// The usual one, which has the target.
    Usual,
    /// Another one, which builds the standard library from its sources, and a linker for it.
    FromSources { rustc: PathBuf, linker: PathBuf },
}

impl Toolchain {
    /// Finds the compiler.
    pub fn find() -> Result<Self> {
        let usual = Path::new("rustc");
        if Path::new(&ask(usual, &["--print", "target-libdir", "--target", TARGET])?).is_dir() {
            return Ok(Self::Usual);
        }
        let Some(rustc) = std::env::var_os("WM_WASM_RUSTC").map(PathBuf::from) else {
            bail!(
                "the compiler has no standard library for {TARGET}: run `rustup target add {TARGET}`, or on Debian \
                 `eval \"$(tools/web-player/debian-rustc.sh FOLDER)\"`"
            );
        };
        let sources = Path::new(&ask(&rustc, &["--print", "sysroot"])?).join("lib/rustlib/src/rust/library");
        ensure!(
            sources.is_dir(),
            "WM_WASM_RUSTC {}: {} is missing; the sources of its standard library belong there",
            rustc.display(),
            sources.display()
        );
        let about = ask(usual, &["-vV"])?;
        let host =
            about.lines().find_map(|line| line.strip_prefix("host: ")).context("rustc names no host")?;
        let own = Path::new(&ask(usual, &["--print", "sysroot"])?).join("lib/rustlib").join(host);
        let own = own.join("bin").join(format!("rust-lld{}", std::env::consts::EXE_SUFFIX));
        let linker = if own.is_file() {
            own
        } else {
            on_path("wasm-ld").context("there is no rust-lld and no wasm-ld: install lld")?
        };
        Ok(Self::FromSources { rustc, linker })
    }

    /// Has cargo use it.
    pub fn apply(&self, build: &mut Command) -> Result<()> {
        if let Self::FromSources { rustc, linker } = self {
            // The bootstrap variable permits -Z in a stable compiler.
            build.env("RUSTC", rustc).env("RUSTC_BOOTSTRAP", "1");
            build.env("CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER", linker);
            build.arg("-Zbuild-std=std,panic_abort");
        }
        Ok(())
    }
}

/// Asks a compiler, and returns its answer without the line's end.
fn ask(rustc: &Path, words: &[&str]) -> Result<String> {
    let said = Command::new(rustc)
        .args(words)
        .output()
        .with_context(|| format!("cannot run {}", rustc.display()))?;
    ensure!(said.status.success(), "{} {} fails", rustc.display(), words.join(" "));
    Ok(String::from_utf8_lossy(&said.stdout).trim_end().to_owned())
}

/// Returns the path of a program.
pub fn on_path(name: &str) -> Option<PathBuf> {
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    std::env::split_paths(&std::env::var_os("PATH")?)
        .map(|folder| folder.join(&name))
        .find(|path| path.is_file())
}
