//! The label of a splat: scene, sky or snow.
//!
//! The sky is a group, since it is infinitely far for weather, fixed in place and the same from
//! everywhere. Densification of a training leaves it alone.

use serde::{Deserialize, Serialize};

/// The part of the scene that a splat belongs to. Kept through files, re-ordering and edits, one
/// byte a splat.
///
/// Weather reads it: sky splats stand behind everything, collect no snow and take no part in the
/// estimation of up and ground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Group {
    /// Reconstructed surfaces.
    #[default]
    Scene = 0,
    /// The sky shell: as far away as anything can be.
    Sky = 1,
    /// Lying snow that was added to the scene.
    Snow = 2,
}

impl Group {
    /// Every group, in the order of their numbers.
    pub const ALL: [Self; 3] = [Self::Scene, Self::Sky, Self::Snow];

    /// The name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Sky => "sky",
            Self::Snow => "snow",
        }
    }

    /// The group of a number in a file; `None` for a number that no group has.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|group| *group as u8 == number)
    }
}
