//! Sources of priors: what estimates the prior of a photo.

use crate::dataset::Dataset;
use anyhow::Result;
use weather_magician::train::priors::given::Given;

/// The answer of a source for a photo.
pub(crate) enum PriorAnswer {
    /// The estimate.
    Given(Given),
    /// No estimate, with the reason.
    Nothing(String),
}

/// A source of priors.
pub(crate) trait PriorEstimator: Sync {
    /// Returns a name with everything that changes the estimates, for the index and for resuming.
    fn name(&self) -> String;

    /// Returns the number of photos to process in parallel.
    fn batch_size(&self) -> usize;

    /// Estimates the prior of a photo.
    ///
    /// # Errors
    /// Errors that would occur for other photos too, or that the user has to fix.
    fn estimate(&self, data: &Dataset, place: usize) -> Result<PriorAnswer>;
}
