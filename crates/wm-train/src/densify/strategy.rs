//! The interface of all strategies of densification.

use super::population::Population;
use crate::check::ConfigValue;
use crate::random::Random;
use wm_render::training::{Noise, SplatTerms};

/// A strategy that adds, moves and removes splats. Every method has a default that does nothing.
pub(crate) trait DensifyStrategy {
    /// Returns the largest number of splats, if there is a limit.
    fn max_splats(&self) -> Option<usize> {
        None
    }

    /// Lists the parameters that a configuration file can set, with the range of each.
    fn values(&self) -> Vec<ConfigValue> {
        Vec::new()
    }

    /// Returns true if screen-space gradients are summed in [`Population::pulls`] between two
    /// changes of the population.
    fn sums_gradients(&self) -> bool {
        false
    }

    /// Returns weights on opacities and scales that are added to the loss. `extent` is the size of
    /// the scene, scene units.
    fn terms(&self, _extent: f64) -> SplatTerms {
        SplatTerms::default()
    }

    /// Returns true if [`Self::apply`] changes splats after `step` (from 1).
    fn is_due(&self, _step: u32) -> bool {
        false
    }

    /// Adds, moves and removes splats after a step; called only where [`Self::is_due`] returns
    /// true.
    fn apply(&self, _time: &DensifyTime, _population: &mut Population) {}

    /// Returns the noise that is added to means after every step, if any. `rate` is the step length
    /// of means and `extent` the size of the scene, both in scene units.
    fn noise(&self, _rate: f64, _extent: f64, _random: Random) -> Option<Noise> {
        None
    }
}

/// The point in a training at which a strategy is applied.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DensifyTime {
    /// The number of the step, from 1.
    pub(crate) step: u32,
    /// The number of training photos.
    pub(crate) photos: usize,
    /// The size of the scene, scene units.
    pub(crate) extent: f64,
    /// Random numbers for this step.
    pub(crate) random: Random,
}
