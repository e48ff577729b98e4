//! The files of the player, which tools/web-player builds.

use super::output::{self, at};
use anyhow::{Result, bail};
use std::borrow::Cow;
use std::fs;
use std::path::Path;

/// The names of the player's files: its JavaScript and its module.
const NAMES: [&str; 2] = ["player.js", "player_bg.wasm"];
/// The beginning of a WebAssembly module.
const MAGIC: &[u8] = b"\0asm";

/// The contents of the player's files, in the order of their names.
pub(crate) struct PlayerFiles([Cow<'static, [u8]>; 2]);

impl PlayerFiles {
    /// Finds them: in a folder that was given, in the program, or in `web-player` beside it.
    pub(crate) fn find(given: Option<&Path>) -> Result<Self> {
        if let Some(folder) = given {
            return Self::read(folder);
        }
        if let Some(own) = built_in() {
            return Ok(own);
        }
        let program = std::env::current_exe().ok();
        let beside = program.as_deref().and_then(Path::parent).map(|folder| folder.join("web-player"));
        match beside.filter(|folder| folder.is_dir()) {
            Some(folder) => Self::read(&folder),
            None => bail!(
                "this program was built without the player of web pages: build it (`cargo run --release --manifest-path \
                 tools/web-player/Cargo.toml` in the source) and give --player target/web-player"
            ),
        }
    }

    fn read(folder: &Path) -> Result<Self> {
        let [script, module] = NAMES.map(|name| {
            let path = folder.join(name);
            at(fs::read(&path), &path)
        });
        let (script, module) = (script?, module?);
        if !module.starts_with(MAGIC) {
            bail!("{}: is no WebAssembly module; build the player again", folder.join(NAMES[1]).display());
        }
        Ok(Self([script.into(), module.into()]))
    }

    /// Writes them into a site.
    pub(crate) fn write(&self, site: &Path) -> Result<()> {
        NAMES.iter().zip(&self.0).try_for_each(|(name, bytes)| output::write(&site.join(name), bytes))
    }
}

/// The player that was built into the program.
#[cfg(feature = "web")]
fn built_in() -> Option<PlayerFiles> {
    const SCRIPT: &[u8] =
        include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/web-player/player.js"));
    const MODULE: &[u8] =
        include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/web-player/player_bg.wasm"));
    Some(PlayerFiles([SCRIPT.into(), MODULE.into()]))
}

#[cfg(not(feature = "web"))]
fn built_in() -> Option<PlayerFiles> {
    None
}
