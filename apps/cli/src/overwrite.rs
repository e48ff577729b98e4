//! Protection of files that exist: they are replaced only with `--overwrite`, and inputs never by
//! pictures and reports.

use anyhow::{Result, bail};
use clap::Args;
use std::path::Path;
use weather_magician::formats::folder::scene_file;

/// The option that permits replacing what exists.
#[derive(Args, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct OverwriteArgs {
    /// Replace what exists under the name of the output; without it, it is refused
    #[arg(long, help_heading = "Output")]
    pub(crate) overwrite: bool,
}

impl OverwriteArgs {
    /// Checks, before the work, that writing `out` replaces nothing without `--overwrite`. `inputs`
    /// are the files and folders that the command reads; `other` is another remedy than
    /// `--overwrite`.
    ///
    /// # Errors
    /// `out` exists, or is one of the inputs.
    pub(crate) fn check(self, out: &Path, inputs: &[&Path], other: &str) -> Result<()> {
        // Devices and pipes hold nothing that would be lost.
        if self.overwrite || !(out.is_file() || out.is_dir()) {
            return Ok(());
        }
        let what = if is_input(out, inputs) { "is the input itself" } else { "exists already" };
        bail!("{}: {what}; {other}, or replace it with --overwrite", out.display());
    }

    /// Checks, before the work, that a picture or a report replaces no input, and nothing else
    /// without `--overwrite`.
    ///
    /// # Errors
    /// `out` is one of the inputs, or exists.
    pub(crate) fn check_report(self, out: &Path, inputs: &[&Path]) -> Result<()> {
        if is_input(out, inputs) {
            bail!("{}: is an input of this command and would be lost; choose another name", out.display());
        }
        self.check(out, &[], "choose another name")
    }
}

/// Returns true if `out` is the same file as one of the inputs, also by another name, a symbolic
/// link or a hard link.
fn is_input(out: &Path, inputs: &[&Path]) -> bool {
    // The comparison opens both, and a pipe that is opened twice waits for ever.
    let is_same = |input: &Path| {
        out.is_file() && input.is_file() && same_file::is_same_file(out, input).unwrap_or(false)
    };
    // Of a folder that is a scene, the scene file in it.
    inputs.iter().any(|input| is_same(input) || scene_file(input).is_ok_and(|file| is_same(&file)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn inputs_are_known_by_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("sog")).unwrap();
        fs::write(at("sog/meta.json"), "{}").unwrap();
        fs::write(at("a.ply"), "a").unwrap();
        fs::write(at("b.ply"), "a").unwrap();
        fs::hard_link(at("a.ply"), at("hard.ply")).unwrap();
        let input = [&*at("a.ply")];
        let mut names = vec![at("a.ply"), at("sog/../a.ply"), at("hard.ply")];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("a.ply", at("soft.ply")).unwrap();
            names.push(at("soft.ply"));
        }
        for name in names {
            let said = OverwriteArgs::default().check(&name, &input, "choose another name").unwrap_err();
            let ends = ": is the input itself; choose another name, or replace it with --overwrite";
            assert_eq!(said.to_string(), format!("{}{ends}", name.display()));
            let overwrite = OverwriteArgs { overwrite: true };
            assert!(overwrite.check_report(&name, &input).is_err());
            overwrite.check(&name, &input, "").unwrap();
        }
        let said = OverwriteArgs::default().check(&at("b.ply"), &input, "choose another name").unwrap_err();
        assert!(said.to_string().contains("b.ply: exists already; choose another name, or "), "{said}");
        OverwriteArgs::default().check(&at("c.ply"), &input, "").unwrap();
        let overwrite = OverwriteArgs { overwrite: true };
        overwrite.check_report(&at("b.ply"), &input).unwrap();
        assert!(OverwriteArgs::default().check_report(&at("b.ply"), &input).is_err());
        assert!(overwrite.check_report(&at("sog/meta.json"), &[&at("sog")]).is_err());
        #[cfg(unix)]
        OverwriteArgs::default().check_report(Path::new("/dev/null"), &input).unwrap();
    }
}
