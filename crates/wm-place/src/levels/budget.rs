//! The memory of a place in levels of detail, shared out.

use std::path::Path;
use wm_base::FormatError;
use wm_render::bytes_of_set;
use wm_scene::levels::LevelIndex;

/// The memory and the splats that rendering a scene in levels of detail may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelBudget {
    /// Memory of the whole process, bytes.
    pub memory: u64,
    /// Splats of one frame; `None` for as many as the memory allows, [`MAX_FRAME_SPLATS`] at most.
    pub splats: Option<u64>,
}

impl Default for LevelBudget {
    /// 2 GiB.
    fn default() -> Self {
        Self { memory: 2 << 30, splats: None }
    }
}

/// Minimum memory of a budget, bytes: the program alone takes a part of it.
const MIN_MEMORY_BYTES: u64 = 256 << 20;

/// Reads a size of memory such as `2GiB` or `800MB`, bytes.
///
/// # Errors
/// A line that says what is wrong: no unit that is known, or less than 256 MiB.
pub fn parse_memory(text: &str) -> Result<u64, String> {
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
    if bytes < MIN_MEMORY_BYTES as f64 {
        return Err(format!("`{text}` is too little: give 256MiB or more"));
    }
    Ok(bytes as u64)
}

/// Default maximum number of splats of one frame: about two per pixel of a picture of 1200x800 px.
/// More change little.
pub const MAX_FRAME_SPLATS: u64 = 2_000_000;
/// Minimum number of splats of one frame.
const MIN_FRAME_SPLATS: u64 = 1000;
/// Memory of the program, its tables and a picture with all its parts, bytes.
const PROGRAM_BYTES: u64 = 160 << 20;
/// Divisor of the memory: the part for the splats that weather is prepared with, and their assets.
const WEATHER_MEMORY_DIVISOR: u64 = 4;
/// Maximum number of splats that weather is prepared with.
const MAX_WEATHER_SPLATS: u64 = 1_000_000;
/// Bytes that each of these splats takes while assets are made.
const WEATHER_SPLAT_BYTES: u64 = 480;
/// Bytes in the lists of a frame per drawn splat.
const FRAME_SPLAT_BYTES: u64 = 112;
/// Bytes per held splat outside the renderer: the position.
const HELD_SPLAT_BYTES: u64 = 12;

/// Maximum ratio of held to drawn splats where the number of drawn splats is given: which splats
/// are visible is known only once they are held.
const MAX_HELD_PER_DRAWN: u64 = 4;

/// The shares of a [`LevelBudget`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BudgetShares {
    /// Splats that weather is prepared with.
    pub(crate) weather_splats: u64,
    /// Splats that one frame draws.
    pub(crate) frame_splats: u64,
    /// Splats that are held for one frame.
    pub(crate) cut_splats: u64,
    /// Bytes of the splats that are held for frames.
    pub(crate) held_bytes: u64,
}

impl LevelBudget {
    /// Returns the index of the scene at a path if it is in levels of detail and its finest level
    /// does not fit; else the scene is drawn as a whole.
    ///
    /// # Errors
    /// [`FormatError`] if it has an index that cannot be read.
    pub fn levels_of(&self, path: &Path) -> Result<Option<LevelIndex>, FormatError> {
        Ok(LevelIndex::of_scene(path)?.filter(|index| !self.holds(index)))
    }

    /// Returns true if a frame may draw all splats of a scene, whose levels are of no use then.
    #[must_use]
    pub fn holds(&self, index: &LevelIndex) -> bool {
        // The degree is not known before a file is read.
        index.count_of_level(0) <= self.shares(3).frame_splats
    }

    /// Returns the memory that a scene takes at its coarsest level, bytes, if that is more than the
    /// budget.
    pub(crate) fn exceeded_by(&self, index: &LevelIndex, sh_degree: u8) -> Option<u64> {
        let coarsest = index.leaves.iter().filter_map(|leaf| leaf.runs.last()).map(|run| run.count);
        // For weather, to tell what is hidden, and in the frame.
        let a_splat = WEATHER_SPLAT_BYTES + 2 * held_bytes(256, sh_degree) / 256 + FRAME_SPLAT_BYTES;
        let least = PROGRAM_BYTES + coarsest.sum::<u64>().saturating_mul(a_splat);
        Some(least).filter(|least| *least > self.memory)
    }

    /// The shares for splats of an SH degree.
    pub(crate) fn shares(&self, sh_degree: u8) -> BudgetShares {
        let weather = self.memory / WEATHER_MEMORY_DIVISOR;
        let rest = self.memory.saturating_sub(PROGRAM_BYTES + weather);
        let a_splat = held_bytes(256, sh_degree) / 256 + FRAME_SPLAT_BYTES;
        let by_memory = rest / a_splat;
        // A part of what is held is of other cuts, so that a camera that turns back loads nothing.
        let frame_splats = self.splats.unwrap_or((by_memory / 2).min(MAX_FRAME_SPLATS)).max(MIN_FRAME_SPLATS);
        // As many as the memory allows are drawn at once: to choose among more would take longer
        // than to draw them.
        let held = if self.splats.is_some() { MAX_HELD_PER_DRAWN } else { 1 };
        let cut_splats = frame_splats.saturating_mul(held).min(by_memory / 4 * 3).max(frame_splats);
        BudgetShares {
            weather_splats: (weather / WEATHER_SPLAT_BYTES).clamp(MIN_FRAME_SPLATS, MAX_WEATHER_SPLATS),
            frame_splats,
            cut_splats,
            held_bytes: rest.saturating_sub(cut_splats * FRAME_SPLAT_BYTES),
        }
    }
}

/// Bytes of a set of splats that is held.
pub(crate) fn held_bytes(splats: u64, sh_degree: u8) -> u64 {
    bytes_of_set(splats as usize, sh_degree) + HELD_SPLAT_BYTES * splats
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_memory_are_read() {
        assert_eq!(parse_memory("2GiB"), Ok(2 << 30));
        assert_eq!(parse_memory("0.5 gb"), Ok(500_000_000));
        assert_eq!(parse_memory("300MB"), Ok(300_000_000));
        assert_eq!(parse_memory("512mib"), Ok(512 << 20));
        for bad in ["", "2", "GiB", "2TB!", "-1GiB", "nan GiB", "1.2.3GB", "100MiB"] {
            assert!(parse_memory(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_shares_fit_the_memory() {
        for memory in [512 << 20, 2 << 30, 16u64 << 30] {
            for degree in 0..=3 {
                let shares = LevelBudget { memory, splats: None }.shares(degree);
                let all = PROGRAM_BYTES
                    + shares.weather_splats * WEATHER_SPLAT_BYTES
                    + shares.cut_splats * FRAME_SPLAT_BYTES
                    + shares.held_bytes;
                assert!(all <= memory, "{memory} {degree}: {shares:?}");
                // The splats of a frame are held together.
                assert!(held_bytes(shares.cut_splats, degree) <= shares.held_bytes, "{shares:?}");
            }
        }
    }
}
