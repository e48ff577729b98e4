//! The files of a site's page.

use super::output::write;
use super::single_file::{STARTER, with_policy};
use anyhow::Result;
use std::path::Path;
use wm_viewer::page::{PageKind, files_of};

/// The content policy: a page loads its own files, compiles its module, and shows pictures from
/// memory.
const POLICY: &str = "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; \
                      style-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; media-src 'self'; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'";

/// Writes the files of the page into a site, with the starter of a single file or without.
pub(crate) fn write_page(folder: &Path, is_single: bool) -> Result<()> {
    for file in files_of(PageKind::Static).filter(|file| is_single || file.path != STARTER) {
        let text = match file.path {
            "index.html" => with_policy(file.text, POLICY)?,
            _ => file.text.to_owned(),
        };
        write(&folder.join(file.path), text.as_bytes())?;
    }
    Ok(())
}
