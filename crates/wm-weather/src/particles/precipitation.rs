//! One kind of precipitation at one instant: how much of which sizes, and how it looks.

use super::residual::Residual;
use super::spectrum::{PrecipitationKind, SizeClass};
use crate::optics::AirLayer;

/// Width at which drops end.
pub(super) const MIN_DROP_WIDTH_PX: f64 = 0.3;

/// Share of the airlight that surroundings shine with: half of them sky, half ground of half its
/// light.
const SURROUNDINGS_LIGHT_SHARE: f64 = 0.75;

/// The appearance of precipitation and the camera's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ParticleAppearance {
    /// The seed of random positions.
    pub(crate) seed: u64,
    /// The exposure time, s.
    pub(crate) exposure: f64,
    /// Factor on diameters as drawn.
    pub(crate) size: f64,
    /// Factor on cover as drawn.
    pub(crate) opacity: f64,
    /// Factor on radiance.
    pub(crate) brightness: f64,
    /// Radiance, linear RGB, where it is not that of the surroundings.
    pub(crate) radiance: Option<[f64; 3]>,
}

impl Default for ParticleAppearance {
    /// The appearance in nature, in a video's exposure.
    fn default() -> Self {
        Self { seed: 0, exposure: 1.0 / 60.0, size: 1.0, opacity: 1.0, brightness: 1.0, radiance: None }
    }
}

/// One kind of precipitation at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Precipitation {
    /// The kind that falls.
    pub kind: &'static PrecipitationKind,
    /// Water, mm/h.
    pub rate: f64,
    /// The appearance of its particles.
    pub(crate) look: ParticleAppearance,
    /// Radiance of an endless path through it, linear RGB.
    pub(crate) airlight: [f64; 3],
    pub(super) classes: Vec<SizeClass>,
    /// Drops per m^3 now, and at a threshold of 1.
    pub(super) numbers: Vec<f64>,
    pub(super) reference: Vec<f64>,
}

impl Precipitation {
    /// A kind at a rate, mm/h of water, under an airlight (linear RGB).
    pub(crate) fn new(
        kind: &'static PrecipitationKind,
        rate: f64,
        airlight: [f64; 3],
        look: ParticleAppearance,
    ) -> Self {
        let classes = kind.classes();
        Self {
            kind,
            rate,
            look,
            airlight,
            numbers: kind.densities(&classes, rate),
            reference: kind.densities(&classes, kind.reference_rate),
            classes,
        }
    }

    /// The classes, with the drops per m^3 of each.
    pub(crate) fn classes(&self) -> impl Iterator<Item = (&SizeClass, f64)> {
        self.classes.iter().zip(self.numbers.iter().copied())
    }

    /// The air that all of it together is.
    pub(crate) fn layer(&self) -> AirLayer {
        AirLayer {
            sigma_t: [self.kind.sigma_t(&self.classes, self.rate); 3],
            airlight: self.airlight,
            scale_height: f64::INFINITY,
            base_height: 0.0,
        }
    }

    /// The radiance of its particles without lamps, linear RGB.
    pub(crate) fn radiance(&self) -> [f32; 3] {
        let natural = || {
            let share = SURROUNDINGS_LIGHT_SHARE * self.kind.reflectance;
            self.airlight.map(|v| v * share)
        };
        self.look.radiance.unwrap_or_else(natural).map(|v| (v * self.look.brightness) as f32)
    }

    /// Mean fall speed by water, m/s; not a number where nothing falls.
    pub(crate) fn mean_speed(&self) -> f64 {
        let all: f64 = self.classes().map(|(class, number)| class.water * number).sum();
        let passed = self.classes().map(|(class, number)| class.fall_speed * (class.water * number));
        passed.sum::<f64>() / all
    }

    /// Distance up to which a class is drawn in a view, m.
    pub(super) fn range(&self, class: &SizeClass, pixels: f64) -> f64 {
        class.width * self.look.size * pixels / MIN_DROP_WIDTH_PX
    }

    /// Returns the part that particles show in a view with `pixels` to a length of 1 at distance 1,
    /// and that the air must leave out.
    pub(crate) fn residual(&self, pixels: f64) -> Residual {
        let drawn = self.classes().map(|(class, number)| [number * class.area, self.range(class, pixels)]);
        Residual::new(drawn.collect(), self.airlight)
    }
}
