//! A fixed number of splats: nothing is added, moved or removed.

use super::strategy::DensifyStrategy;
use serde::{Deserialize, Serialize};

/// The strategy without parameters that keeps the splats a training starts with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FixedConfig {}

impl FixedConfig {
    /// Returns the strategy; the number of steps and the limit do not matter.
    pub(crate) fn for_steps(_steps: u32, _max_splats: usize) -> Self {
        Self {}
    }
}

impl DensifyStrategy for FixedConfig {}
