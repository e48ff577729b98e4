//! Options of scenes in levels of detail.

use anyhow::{Result, bail};
use clap::Args;
use weather_magician::levels::{LevelBudget, parse_memory};

/// The most that a scene in levels may take. Scenes that fit as a whole are drawn as a whole.
#[derive(Args, Clone, Copy, Debug, Default)]
pub(crate) struct LevelArgs {
    /// Memory for a scene in levels of detail, such as 2GiB or 800MB: what does not fit is read as
    /// cameras need it [default: 2GiB]
    #[arg(long, value_name = "BYTES", value_parser = parse_memory, conflicts_with = "level", help_heading = "Scene")]
    memory: Option<u64>,
    /// Splats of one frame of a scene in levels of detail: the levels that lose least are drawn
    /// [default: as many as --memory holds, 2 million at most]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), conflicts_with = "level", help_heading = "Scene")]
    splats: Option<u64>,
}

impl LevelArgs {
    /// Fails if one is given where `what` is drawn, for which a scene is loaded as a whole.
    pub(crate) fn refuse_for(self, what: &str) -> Result<()> {
        let given = self.memory.map(|_| "--memory").or(self.splats.map(|_| "--splats"));
        given.map_or(Ok(()), |option| {
            bail!("{option}: {what} loads a scene as a whole; choose a level with --level")
        })
    }

    /// Returns the options as words of a command line.
    #[cfg(feature = "viewer")]
    pub(crate) fn words(self) -> Vec<String> {
        let memory = self.memory.map(|size| format!("--memory={}MiB", size >> 20));
        let splats = self.splats.map(|count| format!("--splats={count}"));
        [memory, splats].into_iter().flatten().collect()
    }

    /// Returns the budget.
    pub(crate) fn budget(self) -> LevelBudget {
        let default = LevelBudget::default();
        LevelBudget { memory: self.memory.unwrap_or(default.memory), splats: self.splats }
    }
}
