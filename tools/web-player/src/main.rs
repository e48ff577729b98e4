//! Builds the player of static pages into `target/web-player/`: `player.js` and `player_bg.wasm`.
//!
//! ```text
//! cargo run --release --manifest-path tools/web-player/Cargo.toml
//! cargo build --release --features web
//! ```
//!
//! It needs the target wasm32-unknown-unknown (`rustup target add wasm32-unknown-unknown`). Without
//! it, WM_WASM_RUSTC may name a rustc that has the sources of its standard library, which is then
//! built too: `debian-rustc.sh` fetches one.

mod shrink;
mod toolchain;

use anyhow::{Context, Result, bail, ensure};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use toolchain::{TARGET, Toolchain};
use wasm_bindgen_cli_support::Bindgen;

const HELP: &str = "Builds the player of static pages.

Usage: cargo run --release --manifest-path tools/web-player/Cargo.toml -- [OPTIONS]

  --out FOLDER     Output folder [default: target/web-player of the checkout]
  --opt-level L    Optimisation: 3, 2, s or z [default: 3]
  --crate FOLDER   Build this crate instead of apps/player
  --no-lto         Do not optimise the program as a whole: built in half the time, for tests
  --no-wasm-opt    Do not use wasm-opt, even if there is one on PATH

WM_WASM_RUSTC names a rustc to use where the target wasm32-unknown-unknown is not installed; debian-rustc.sh fetches one.";

/// Vector instructions: every browser with WebGPU has them, and all others since 2023.
const FLAGS: &str = "-C target-feature=+simd128";

/// The words of the command line.
struct Options {
    out: PathBuf,
    opt_level: String,
    krate: PathBuf,
    is_whole: bool,
    shrinks: bool,
}

impl Options {
    /// Reads the words; `None` if help was asked for.
    fn parse(words: impl IntoIterator<Item = String>) -> Result<Option<Self>> {
        let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let checkout = checkout.canonicalize().context("the checkout that this was built in is gone")?;
        let mut options = Self {
            out: checkout.join("target/web-player"),
            opt_level: "3".into(),
            krate: checkout.join("apps/player"),
            is_whole: true,
            shrinks: true,
        };
        let mut words = words.into_iter();
        while let Some(word) = words.next() {
            let mut value = || words.next().with_context(|| format!("{word} needs a value"));
            match word.as_str() {
                "--out" => options.out = value()?.into(),
                "--crate" => options.krate = value()?.into(),
                "--no-lto" => options.is_whole = false,
                "--no-wasm-opt" => options.shrinks = false,
                "--opt-level" => {
                    options.opt_level = value()?;
                    let known = ["1", "2", "3", "s", "z"].contains(&options.opt_level.as_str());
                    ensure!(known, "--opt-level {}: give 3, 2, s or z", options.opt_level);
                }
                "-h" | "--help" => return Ok(None),
                _ => bail!("{word}: no such option (--help lists them)"),
            }
        }
        Ok(Some(options))
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    let Some(options) = Options::parse(std::env::args().skip(1))? else {
        println!("{HELP}");
        return Ok(());
    };
    let module = build(&options)?;
    fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    // Beside the output, so that it is moved there in one step.
    let made = options.out.join(format!("made-{}", std::process::id()));
    let outcome = bind(&module, &made).and_then(|()| {
        if options.shrinks {
            shrink::shrink(&made.join("player_bg.wasm"))?;
        }
        ["player_bg.wasm", "player.js"].into_iter().try_for_each(|name| publish(&made, &options.out, name))
    });
    // Nothing more can be done if this fails.
    let _ = fs::remove_dir_all(&made);
    outcome
}

/// Compiles the crate; returns the path of its module.
fn build(options: &Options) -> Result<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut build = Command::new(cargo);
    let manifest = options.krate.join("Cargo.toml");
    ensure!(manifest.is_file(), "{}: there is no such crate", options.krate.display());
    build.args(["build", "--release", "--locked", "--message-format", "json-render-diagnostics"]);
    build.args(["--target", TARGET, "--manifest-path"]).arg(&manifest);
    // Small and fast: the whole program is optimised as one, and nothing unwinds.
    let whole = [("lto", "\"fat\""), ("codegen-units", "1")];
    let always = [("panic", "\"abort\""), ("strip", "\"debuginfo\"")];
    for (key, value) in whole.into_iter().filter(|_| options.is_whole).chain(always) {
        build.args(["--config", &format!("profile.release.{key}={value}")]);
    }
    let level = &options.opt_level;
    let level = if level.parse::<u8>().is_ok() { level.clone() } else { format!("\"{level}\"") };
    build.args(["--config", &format!("profile.release.opt-level={level}")]);
    build.env("RUSTFLAGS", FLAGS).env_remove("CARGO_ENCODED_RUSTFLAGS");
    Toolchain::find()?.apply(&mut build)?;
    let built = build.stderr(std::process::Stdio::inherit()).output().context("cannot run cargo")?;
    ensure!(built.status.success(), "cargo could not build {}", options.krate.display());
    module_of(&String::from_utf8_lossy(&built.stdout), &manifest)
}

/// Returns the path of the module that cargo's messages tell of for a manifest.
fn module_of(messages: &str, manifest: &Path) -> Result<PathBuf> {
    let manifest = manifest.canonicalize().context("the crate is gone")?;
    let named = format!("\"manifest_path\":\"{}\"", manifest.display());
    let own = messages.lines().rfind(|line| line.contains("compiler-artifact") && line.contains(&named));
    let path = own.and_then(|line| line.split('"').find(|part| part.ends_with(".wasm")));
    path.map(PathBuf::from).with_context(|| format!("{}: it is no cdylib", manifest.display()))
}

/// Makes the JavaScript about a module.
fn bind(module: &Path, folder: &Path) -> Result<()> {
    let mut bindgen = Bindgen::new();
    bindgen.input_path(module).out_name("player").typescript(false).remove_name_section(true);
    bindgen.remove_producers_section(true).web(true)?.generate(folder)
}

/// Moves a file to the output, and prints its size.
fn publish(from: &Path, to: &Path, name: &str) -> Result<()> {
    let bytes = fs::read(from.join(name)).with_context(|| name.to_owned())?;
    let packed = sirocco::compress(sirocco::Format::Gzip, sirocco::deflate::Level::new(9), &bytes);
    let target = to.join(name);
    fs::rename(from.join(name), &target).with_context(|| target.display().to_string())?;
    println!("{}: {} bytes, {} gzipped", target.display(), bytes.len(), packed.len());
    Ok(())
}
