//! Options of scenes in levels of detail.

use anyhow::{Result, bail};
use clap::Args;
use std::str::FromStr;
use weather_magician::levels::LevelBudget;

/// The most that a scene in levels may take. Scenes that fit as a whole are drawn as a whole.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct LevelArgs {
    /// Memory for a scene in levels of detail, such as 2GiB or 800MB: what does not fit is read as cameras need it [default: 2GiB]
    #[arg(long, value_name = "BYTES", conflicts_with = "level", help_heading = "Scene")]
    memory: Option<MemorySize>,
    /// Splats of one frame of a scene in levels of detail: the levels that lose least are drawn [default: as many as --memory holds, 2
    /// million at most]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "level", help_heading = "Scene")]
    splats: Option<u64>,
}

impl LevelArgs {
    /// Fails if one is given where `what` is drawn, for which a scene is loaded as a whole.
    pub fn refuse_for(self, what: &str) -> Result<()> {
        let given = self.memory.map(|_| "--memory").or(self.splats.map(|_| "--splats"));
        given.map_or(Ok(()), |option| {
            bail!("{option}: {what} loads a scene as a whole; choose a level with --level")
        })
    }

    /// Returns the options as words of a command line.
    pub fn words(self) -> Vec<String> {
        let memory = self.memory.map(|size| format!("--memory={}MiB", size.0 >> 20));
        let splats = self.splats.map(|count| format!("--splats={count}"));
        [memory, splats].into_iter().flatten().collect()
    }

    /// Returns the budget.
    pub fn budget(self) -> LevelBudget {
        let default = LevelBudget::default();
        LevelBudget { memory: self.memory.map_or(default.memory, |size| size.0), splats: self.splats }
    }
}

/// A number of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct MemorySize(u64);

/// Least memory of a scene in levels: the program alone takes a part of it.
const LEAST: u64 = 256 << 20;

impl FromStr for MemorySize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form =
            || format!("`{text}` is not a size of memory: write a number and a unit, such as 2GiB or 800MB");
        let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
        let (number, unit) = text.split_at(end);
        let number: f64 = number.parse().map_err(|_| form())?;
        let factor = match unit.trim().to_ascii_lowercase().as_str() {
            "mb" => 1e6,
            "gb" => 1e9,
            "mib" => f64::from(1 << 20),
            "gib" => f64::from(1 << 30),
            _ => return Err(form()),
        };
        let bytes = number * factor;
        if bytes < LEAST as f64 {
            return Err(format!("`{text}` is too little: give 256MiB or more"));
        }
        Ok(Self(bytes as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_memory_are_read() {
        let read = |text: &str| text.parse::<MemorySize>().map(|size| size.0);
        assert_eq!(read("2GiB"), Ok(2 << 30));
        assert_eq!(read("0.5 gb"), Ok(500_000_000));
        assert_eq!(read("300MB"), Ok(300_000_000));
        assert_eq!(read("512mib"), Ok(512 << 20));
        for bad in ["", "2", "GiB", "2TB!", "-1GiB", "nan GiB", "1.2.3GB", "100MiB"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }
}
