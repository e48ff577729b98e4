//! Densification: the strategies that add, move and remove splats during a training, one per file.
//!
//! A strategy is a serialisable struct of parameters that implements [`DensifyStrategy`]. To add
//! one, write its file and one line in the list `strategies!` below; configuration files, checks,
//! `--densify` and the trainer follow.

pub(crate) mod adaptive;
pub(crate) mod fixed;
pub(crate) mod mcmc;
mod population;
mod strategy;

pub(crate) use population::{Population, explore};
pub(crate) use strategy::{DensifyStrategy, DensifyTime};

use serde::{Deserialize, Serialize};

macro_rules! strategies {
    ($($(#[$doc:meta])* $variant:ident($config:ty) = $name:literal,)+) => {
        /// The densification strategy of a training with its parameters. In JSON the key `strategy`
        /// holds its name.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "strategy")]
        pub enum Densify {
            $($(#[$doc])* #[serde(rename = $name)] $variant($config),)+
        }

        impl Densify {
            /// The names of all strategies.
            pub const NAMES: &[&str] = &[$($name),+];

            /// Returns the strategy called `name` with its usual parameters for a training of
            /// `steps` steps and at most `max_splats` splats; `None` if there is no such strategy.
            pub(crate) fn named(name: &str, steps: u32, max_splats: usize) -> Option<Self> {
                match name {
                    $($name => Some(Self::$variant(<$config>::for_steps(steps, max_splats))),)+
                    _ => None,
                }
            }

            /// Returns the strategy.
            pub(crate) fn strategy(&self) -> &dyn DensifyStrategy {
                match self {
                    $(Self::$variant(config) => config,)+
                }
            }
        }
    };
}

strategies! {
    /// The number of splats stays as it was at the start.
    Fixed(fixed::FixedConfig) = "fixed",
    /// Adaptive density control (Kerbl et al. 2023): clones and splits splats with large
    /// screen-space gradients, prunes transparent ones, resets opacities.
    Adaptive(adaptive::AdaptiveConfig) = "adaptive",
    /// Splats as samples (Kheradmand et al. 2024): a fixed budget, dead splats move to where they
    /// are needed, noise explores.
    Mcmc(mcmc::McmcConfig) = "mcmc",
}
