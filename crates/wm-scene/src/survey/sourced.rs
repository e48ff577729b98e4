//! A fact with its source and its confidence.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A value and its source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sourced<T> {
    /// The value.
    pub value: T,
    /// The source.
    pub source: FactSource,
    /// The confidence in it.
    pub confidence: Confidence,
}

/// The confidence in a fact.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Confidence {
    /// Given, measured, or told alike by all that tells it.
    #[default]
    Sure,
    /// Told by most of the evidence.
    Likely,
    /// No more than a guess: what depends on it needs a look.
    Guess,
}

impl fmt::Display for Confidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Sure => "sure",
            Self::Likely => "likely",
            Self::Guess => "a guess",
        })
    }
}

/// The source of a value, the best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FactSource {
    /// Given by hand.
    Given,
    /// The scene's metadata.
    File,
    /// The cameras of the photographed views.
    Cameras,
    /// Estimated from the splats.
    Estimated,
    /// Assumed, because no source states it.
    Assumed,
}

impl fmt::Display for FactSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Given => "given",
            Self::File => "from the scene's metadata",
            Self::Cameras => "from the cameras of the photos",
            Self::Estimated => "estimated from the splats",
            Self::Assumed => "assumed",
        })
    }
}

impl<T> Sourced<T> {
    pub(super) fn assumed(value: T) -> Self {
        Self { value, source: FactSource::Assumed, confidence: Confidence::Guess }
    }

    /// Chooses the given value, else that of the file with the confidence noted there, else the one
    /// that `otherwise` finds.
    pub(super) fn first(
        given: Option<T>,
        file: Option<T>,
        noted: Option<Confidence>,
        otherwise: impl FnOnce() -> Self,
    ) -> Self {
        let sure = Confidence::Sure;
        match (given, file) {
            (Some(value), _) => Self { value, source: FactSource::Given, confidence: sure },
            (None, Some(value)) => {
                Self { value, source: FactSource::File, confidence: noted.unwrap_or(sure) }
            }
            (None, None) => otherwise(),
        }
    }
}

/// Fewest points by which a place is surveyed.
pub(super) const MIN_POINTS: usize = 100;
