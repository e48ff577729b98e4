//! Size spectra and fall speeds of precipitation.
//!
//! Rain: `N(D) = 8000 exp(-4.1 R^-0.21 D)` a m^3 and mm (Marshall and Palmer 1948), diameters 0.5
//! to 6 mm, at the terminal speed of Brandes et al. (2002), within 4 % of what Gunn and Kinzer
//! measured. Snow: `N(D) = 2500 R^-0.94 exp(-2.29 R^-0.45 D)` over the diameter of the melted flake
//! (Sekhon and Srivastava 1970), 0.2 to 4 mm; the flake itself has the density 0.178 D^-0.922
//! g/cm^3 (Fabry and Szyrmer 1999) and falls at 0.8 D^0.16 m/s, D in mm. Both laws give back their
//! own rate only within 20 %, so that numbers are scaled to give it exactly.

use fearless_simd::SimdFloat;
use std::f64::consts::PI;
use wm_render::simd::Lanes;

/// Least rate that counts, mm/h of water: a hundredth of a millimetre a year. Below it nothing
/// falls.
pub(crate) const LEAST_RATE: f64 = 1e-6;

/// The laws of one kind of precipitation: its sizes, its fall speeds and the shape of its
/// particles.
///
/// An effect that falls names its kind ([`crate::Effect::precipitation`]); the renderer and the
/// instruments read these fields and know no kind by name.
#[derive(Clone, Copy, Debug)]
pub struct PrecipitationKind {
    /// The word for it in reports, as in "rain rate". No two kinds share it.
    pub name: &'static str,
    /// The part of its own in the keys of random numbers.
    pub(crate) key: u64,
    /// Smallest and largest diameter, mm, of the particle when melted.
    pub diameters: [f64; 2],
    /// The division of the diameters into classes.
    pub(crate) spacing: ClassSpacing,
    /// Number of classes: so many that speeds within one differ by some percent.
    pub(crate) classes: usize,
    /// Slope of the numbers over diameter within a class, 1/mm.
    pub(crate) class_slope: f64,
    /// Rate, mm/h, at which the process of thresholds has density 1: any would do, most rates are
    /// near it.
    pub(crate) reference_rate: f64,
    /// Thresholds at which the lower tiers begin ([`Self::tier`]).
    pub(crate) tiers: &'static [f64],
    /// Diameter as it is seen, mm, by that when melted, mm.
    pub(crate) width: fn(f64) -> f64,
    /// Fall speed in still air, m/s, by the diameter when melted, mm.
    pub(crate) speed: fn(f64) -> f64,
    /// `N0`, 1/(m^3 mm), and the slope, 1/mm, of the exponential spectrum over the diameter when
    /// melted, by the rate, mm/h.
    pub(crate) spectrum: fn(f64) -> [f64; 2],
    /// Extinction, 1/m, by the rate, mm/h; `None` for twice the cross-section of all particles.
    pub(crate) extinction: Option<fn(f64) -> f64>,
    /// The look and motion of the particles.
    pub shape: ParticleShape,
    /// Light that a particle sends on, as a share of what its surroundings send it.
    pub(crate) reflectance: f64,
}

impl PartialEq for PrecipitationKind {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// The division of a range of diameters into classes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ClassSpacing {
    /// Classes of equal width.
    Even,
    /// Classes whose bounds are powers of one factor.
    Geometric,
}

/// The look and motion of particles of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParticleShape {
    /// Balls that fall straight: drops and hailstones.
    Ball,
    /// Flakes of three arms that sway and tumble. Where they are narrower than 1.25 px, fewer and
    /// wider ones are drawn.
    Flake,
}

/// Raindrops: Marshall and Palmer's sizes, Brandes' speeds.
pub const RAIN: PrecipitationKind = PrecipitationKind {
    name: "rain",
    key: 0x4a11_0000,
    diameters: [0.5, 6.0],
    spacing: ClassSpacing::Even,
    classes: 48,
    class_slope: TYPICAL_SLOPE,
    reference_rate: 25.0,
    tiers: &[0.0, 0.1],
    width: |d| d,
    speed: |d| -0.1021 + d * (4.932 + d * (-0.9551 + d * (0.07934 - d * 0.002362))),
    spectrum: |rate| [8000.0, 4.1 * rate.powf(-0.21)],
    extinction: Some(|rate| 0.365e-3 * rate.max(0.0).powf(0.63)),
    shape: ParticleShape::Ball,
    reflectance: 1.0,
};

/// Snowflakes: Sekhon and Srivastava's sizes.
pub const SNOW: PrecipitationKind = PrecipitationKind {
    name: "snow",
    key: 0x5110_0000,
    diameters: [0.2, 4.0],
    spacing: ClassSpacing::Geometric,
    classes: 24,
    class_slope: TYPICAL_SLOPE,
    reference_rate: 2.5,
    tiers: &[0.0, 0.025, 0.1, 0.4],
    width: flake_width,
    speed: |d| 0.8 * flake_width(d).powf(0.16),
    spectrum: |rate| [2500.0 * rate.powf(-0.94), 2.29 * rate.powf(-0.45)],
    extinction: None,
    shape: ParticleShape::Flake,
    reflectance: 0.95,
};

/// Width of a flake, mm, by its diameter when melted, mm: its mass is that of the drop, 0.178 D^(3
/// - 0.922) = d^3.
fn flake_width(d: f64) -> f64 {
    (d.powi(3) / 0.178).powf(1.0 / 2.078)
}

/// Slope of the numbers over diameter within a class, 1/mm: between those of light and of heavy
/// rain.
const TYPICAL_SLOPE: f64 = 2.4;

/// Drops of about one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeClass {
    /// Least and greatest diameter, mm; of flakes when melted.
    pub(crate) diameters: [f64; 2],
    /// Fall speed in still air, m/s.
    pub(crate) fall_speed: f64,
    /// Mean volume of water of one, mm^3.
    pub(crate) water: f64,
    /// Mean cross-section of one, m^2; of the flake itself.
    pub(crate) area: f64,
    /// Diameter as it is seen, m, in the middle of the class.
    pub(crate) width: f64,
    /// And at its two ends.
    widths: [f64; 2],
    /// Half of how much rarer the large are than the small ones in it, as a share.
    falls: f64,
}

impl SizeClass {
    /// The diameter, mm, of the drop with this share of the class below it.
    #[inline]
    #[must_use]
    pub fn diameter(&self, share: f64) -> f64 {
        self.diameters[0] + (self.diameters[1] - self.diameters[0]) * self.within(share)
    }

    /// The diameter that is seen of it, m: straight between the ends of the class.
    #[inline]
    pub(crate) fn seen(&self, share: f64) -> f64 {
        self.widths[0] + (self.widths[1] - self.widths[0]) * self.within(share)
    }

    /// [`Self::seen`] of several, as they are drawn.
    #[inline(always)]
    pub(crate) fn seen_by<S: Lanes>(&self, simd: S, share: S::F) -> S::F {
        let falls = self.falls as f32;
        let within = share * share.mul_add(simd.set(falls), simd.set(1.0 - falls));
        let [low, high] = self.widths;
        within.mul_add(simd.set((high - low) as f32), simd.set(low as f32))
    }

    /// Returns the position in the class, 0-1, of the drop that has this share of the class below
    /// it: small ones are more frequent.
    #[inline]
    fn within(&self, share: f64) -> f64 {
        share * (1.0 - self.falls * (1.0 - share))
    }
}

impl PrecipitationKind {
    /// Thresholds of tier `index`, from and up to. Each tier is a process of its own, in cubes of
    /// its own size, so that where few are there few are requested: of rain when it is light, of
    /// snow also when it is far away, since fewer flakes then stand for all.
    pub(crate) fn tier(&self, index: usize) -> [f64; 2] {
        let below = self.tiers;
        // More than most rates ask for, and from there on by factors of 2.
        let above = |index: usize| 1.5 * 2f64.powi((index - below.len()) as i32);
        [index, index + 1].map(|index| below.get(index).copied().unwrap_or_else(|| above(index)))
    }

    /// The diameter that is seen, mm, of a particle of diameter `d` mm when melted.
    #[must_use]
    pub fn seen(&self, d: f64) -> f64 {
        (self.width)(d)
    }

    /// Fall speed in still air, m/s, of a particle of diameter `d` mm when melted.
    pub(crate) fn fall_speed(&self, d: f64) -> f64 {
        (self.speed)(d)
    }

    /// The classes, by diameter.
    #[must_use]
    pub fn classes(&self) -> Vec<SizeClass> {
        let ([least, greatest], count) = (self.diameters, self.classes);
        let edge = |i: usize| {
            let share = i as f64 / count as f64;
            match self.spacing {
                ClassSpacing::Even => least + (greatest - least) * share,
                ClassSpacing::Geometric => least * (greatest / least).powf(share),
            }
        };
        let class = |i: usize| {
            let diameters = [edge(i), edge(i + 1)];
            let middle = 0.5 * (diameters[0] + diameters[1]);
            let mut class = SizeClass {
                diameters,
                fall_speed: self.fall_speed(middle),
                water: 0.0,
                area: 0.0,
                falls: 0.5 * self.class_slope * (diameters[1] - diameters[0]),
                width: 1e-3 * self.seen(middle),
                widths: diameters.map(|d| 1e-3 * self.seen(d)),
            };
            let mean =
                |f: &dyn Fn(f64) -> f64| (0..32).map(|k| f((f64::from(k) + 0.5) / 32.0)).sum::<f64>() / 32.0;
            class.water = mean(&|share| PI / 6.0 * class.diameter(share).powi(3));
            class.area = mean(&|share| PI / 4.0 * class.seen(share).powi(2));
            class
        };
        (0..count).map(class).collect()
    }

    /// Drops per m^3 of each of `classes` at `rate` mm/h of water: exactly that falls.
    #[must_use]
    pub fn densities(&self, classes: &[SizeClass], rate: f64) -> Vec<f64> {
        if rate < LEAST_RATE {
            return vec![0.0; classes.len()];
        }
        let [most, slope] = (self.spectrum)(rate);
        let number = |class: &SizeClass| {
            let [low, high] = class.diameters;
            most / slope * ((-slope * low).exp() - (-slope * high).exp())
        };
        let numbers: Vec<f64> = classes.iter().map(number).collect();
        let scale = rate / flux(classes, &numbers);
        numbers.into_iter().map(|number| number * scale).collect()
    }

    /// Extinction at `rate` mm/h, 1/m: twice the cross-section of all of them, as for all that is
    /// larger than light's waves. Of rain `0.365e-3 R^0.63`, the same sum over Marshall and
    /// Palmer's law with its smaller drops; of snow the sum over `classes`.
    #[must_use]
    pub fn sigma_t(&self, classes: &[SizeClass], rate: f64) -> f64 {
        if let Some(extinction) = self.extinction {
            return extinction(rate);
        }
        2.0 * classes.iter().zip(self.densities(classes, rate)).map(|(class, n)| n * class.area).sum::<f64>()
    }
}

/// Returns the flux of water through a level plane, mm/h, for `numbers` per m^3 of each class.
pub(crate) fn flux(classes: &[SizeClass], numbers: &[f64]) -> f64 {
    // mm^3 a m^2 and second are 1e-6 mm/s.
    3.6e-3 * classes.iter().zip(numbers).map(|(class, n)| n * class.fall_speed * class.water).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_rate_has_numbers_and_less_has_none() {
        for kind in crate::EFFECTS.iter().filter_map(|effect| effect.precipitation) {
            let classes = kind.classes();
            let least = kind.densities(&classes, LEAST_RATE);
            assert!((flux(&classes, &least) / LEAST_RATE - 1.0).abs() < 1e-6, "{}", kind.name);
            for rate in [0.0, 5e-324, 1e-300, LEAST_RATE.next_down()] {
                assert!(kind.densities(&classes, rate).iter().all(|n| *n == 0.0), "{} {rate}", kind.name);
            }
        }
    }

    #[test]
    fn rain_falls_as_it_was_measured() {
        // Gunn and Kinzer 1949, mm and m/s.
        for (d, speed) in [(0.5, 2.06), (1.0, 4.03), (2.0, 6.49), (3.0, 8.06), (4.0, 8.83), (5.0, 9.09)] {
            assert!((RAIN.fall_speed(d) / speed - 1.0).abs() < 0.05, "{d}");
        }
        let classes = RAIN.classes();
        assert!(classes.windows(2).all(|pair| pair[0].diameters[1] == pair[1].diameters[0]));
        for (rate, number, law) in [(1.0, 251.0, 0.365), (10.0, 894.0, 1.56), (50.0, 1801.0, 4.29)] {
            let numbers = RAIN.densities(&classes, rate);
            assert!((flux(&classes, &numbers) / rate - 1.0).abs() < 1e-12);
            // Marshall and Palmer's own numbers, before they are scaled.
            let count = numbers.iter().sum::<f64>();
            assert!((count / number - 1.0).abs() < 0.25, "{rate}: {count}");
            let sigma = 1e3 * RAIN.sigma_t(&classes, rate);
            assert!((sigma / law - 1.0).abs() < 0.01, "{rate}: {sigma} a km");
            // Those that may be drawn hide less than half of it.
            let drawn: f64 = classes.iter().zip(&numbers).map(|(class, n)| 1e3 * n * class.area).sum();
            assert!((0.25..0.5).contains(&(drawn / sigma)), "{rate}: {drawn} a km of {sigma}");
        }
    }

    #[test]
    fn snow_falls_slowly_and_dims_more() {
        let classes = SNOW.classes();
        for (rate, dims) in [(1.0, 4.3), (2.5, 9.0), (5.0, 15.8)] {
            let numbers = SNOW.densities(&classes, rate);
            assert!((flux(&classes, &numbers) / rate - 1.0).abs() < 1e-12);
            let mean = classes.iter().zip(&numbers).map(|(c, n)| c.fall_speed * n).sum::<f64>()
                / numbers.iter().sum::<f64>();
            assert!((0.7..1.2).contains(&mean), "{mean} m/s");
            let sigma = 1e3 * SNOW.sigma_t(&classes, rate);
            assert!((sigma / dims - 1.0).abs() < 0.35, "{rate}: {sigma} a km");
        }
        assert!(SNOW.densities(&classes, 0.0).iter().all(|n| *n == 0.0));
    }
}
