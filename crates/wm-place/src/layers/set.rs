//! Sets of layers.

use super::{LayerPasses, PictureLayer};
use crate::camera_model::CameraModel;
use crate::{Error, Result};
use std::fmt;
use std::ops::{BitOr, BitOrAssign};
use wm_weather::{Fidelity, Weather};

/// A set of layers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Layers(u32);

impl Layers {
    /// No layer.
    pub const NONE: Self = Self(0);
    /// The steps between the clear picture and the last of the paper's rain and snow:
    /// [`Picture::stages`](crate::Picture::stages).
    pub const PAPER_STAGES: Self = Self(1 << 31);

    pub(super) const fn one(layer: PictureLayer) -> Self {
        Self(1 << layer as u32)
    }

    /// Returns true if all layers of `other` are in the set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the layers of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns the set without those of another.
    #[must_use]
    pub fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the layers of the set.
    pub fn iter(self) -> impl Iterator<Item = PictureLayer> {
        PictureLayer::all().filter(move |layer| self.contains((*layer).into()))
    }
}

impl Default for Layers {
    /// The colour alone.
    fn default() -> Self {
        Self::COLOR
    }
}

impl From<PictureLayer> for Layers {
    fn from(layer: PictureLayer) -> Self {
        Self::one(layer)
    }
}

impl BitOr for Layers {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        self.with(other)
    }
}

impl BitOrAssign for Layers {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl FromIterator<PictureLayer> for Layers {
    /// These layers alone, without the colour if it is not among them.
    fn from_iter<T: IntoIterator<Item = PictureLayer>>(layers: T) -> Self {
        layers.into_iter().fold(Self::NONE, |set, layer| set | layer.into())
    }
}

impl fmt::Debug for Layers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stages = self.contains(Self::PAPER_STAGES).then_some("paper-stages");
        f.debug_set().entries(self.iter().map(PictureLayer::name).chain(stages)).finish()
    }
}

impl Layers {
    /// Checks that a camera and a weather can have the layers.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the layer.
    pub fn check(self, model: &CameraModel, weather: &Weather) -> Result<()> {
        let fault = |says: &str| Err(Error::Unsupported(says.into()));
        let passes = LayerPasses::of(self);
        if self.contains(Self::PARTICLE_FLOW) && model.lens.is_some() {
            return fault("layer particle-flow: is of pinholes alone; leave out the lens or the layer");
        }
        if self.contains(Self::PARTICLE_FLOW) && weather.fidelity == Fidelity::Paper {
            return fault(
                "layer particle-flow: rain and snow of fidelity paper have none; use fidelity physical",
            );
        }
        if !passes.parts.is_empty() && weather.fidelity == Fidelity::Paper {
            return fault(
                "layers transmittance, clean and airlight: weather of fidelity paper has none; use fidelity physical",
            );
        }
        if passes.stages && weather.fidelity != Fidelity::Paper {
            return fault("the steps of the paper's rain and snow need fidelity paper");
        }
        if !model.shutter.is_instant()
            && let Some(layer) = self.iter().find(|layer| layer.is_of_instant())
        {
            return fault(&format!("layer {layer} shows one instant: use no exposure time and no readout"));
        }
        Ok(())
    }
}
