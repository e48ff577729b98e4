//! One HTML file with a whole site in it.

use super::output::SiteFolder;
use anyhow::{Result, bail};
use std::path::Path;

/// Writes a site as the HTML file `out`; returns its size, bytes.
pub fn write(_folder: SiteFolder, _out: &Path) -> Result<u64> {
    bail!("--single-file: not yet")
}
