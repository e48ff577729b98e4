//! The rain that lands on a glass over time.

use crate::particles::RAIN;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Parts of the time between two keyframes in each of which the rain counts as even.
const KEYFRAME_PART_COUNT: usize = 24;
/// Steps of a table of radii by their share.
const QUANTILE_COUNT: usize = 64;
/// Directions of the wind that are averaged.
const WIND_DIRECTION_COUNT: usize = 32;
/// Water that a drop takes along which grew by others until it ran, as a multiple of its own.
const COLLECTED_WATER: f64 = 12.0;
/// Largest radius of a drop that grew until it ran, as a multiple of the least.
const MAX_GROWTH: f64 = 1.3;

/// The rain at an instant, and how it meets a glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rainfall {
    /// mm/h through a level plane, or onto the glass itself.
    pub(crate) rate: f64,
    /// Wind, m/s.
    pub(crate) wind: f64,
    /// Speed of the glass along the view, m/s.
    pub(crate) speed: f64,
    /// Angle by which the top of the glass leans towards the camera, radians.
    pub(crate) tilt: f64,
    /// True if the rate is that onto the glass.
    pub(crate) is_on_glass: bool,
}

impl Rainfall {
    /// Rain of which this much lands on the glass, mm/h.
    pub(crate) fn onto_glass(rate: f64) -> Self {
        Self { rate, wind: 0.0, speed: 0.0, tilt: 0.0, is_on_glass: true }
    }

    /// Speed at which drops that fall at `fall` m/s meet the glass, along its normal, m/s: 0 where
    /// they miss it.
    fn meets(&self, fall: f64) -> f64 {
        if self.is_on_glass {
            return fall;
        }
        let (sin, cos) = self.tilt.sin_cos();
        let toward = |k: usize| self.wind * (TAU * (k as f64 + 0.5) / WIND_DIRECTION_COUNT as f64).cos();
        let met = |k: usize| ((self.speed + toward(k)) * cos + fall * sin).max(0.0);
        (0..WIND_DIRECTION_COUNT).map(met).sum::<f64>() / WIND_DIRECTION_COUNT as f64
    }
}

/// Radius of the foot, mm, of a drop of diameter 1 mm that sits at a contact angle, radians: both
/// have the same volume.
pub(super) fn foot(contact: f64) -> f64 {
    let (sin, cos) = contact.sin_cos();
    let cap = std::f64::consts::PI * (2.0 - 3.0 * cos + cos.powi(3)) / (3.0 * sin.powi(3));
    (std::f64::consts::PI / 6.0 / cap).cbrt()
}

/// Drops that have landed since the glass was dry, by kind, and the time without rain.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct LandedDrops {
    /// Drops that sit, a m^2.
    pub(crate) small: f64,
    /// Drops that run, a m^2: those that land so large, and those that grew.
    pub(crate) running: f64,
    /// Time without rain, s.
    pub(crate) dry: f64,
}

/// Radii by the share of drops below, m.
type Quantiles = [f32; QUANTILE_COUNT + 1];

/// A time of even rain.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Segment {
    begin: f64,
    /// Landed until then.
    landed: LandedDrops,
    /// Landing a second.
    flux: LandedDrops,
    /// Radii of drops that sit and that run.
    radii: Arc<[Quantiles; 2]>,
    /// Mean area of the foot of a drop that sits, m^2.
    area: f64,
    /// Share of the running drops that grew on the glass.
    pub(super) grown: f64,
}

/// The rain that lands on a glass over time: clocks that count drops.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GlassRain {
    segments: Vec<Segment>,
}

impl GlassRain {
    /// The rain since `begin`, s, when the glass was dry. `breaks` are the instants between which
    /// it changes, ascending. `rainfall` gives it at an instant, with whose value at `begin` it
    /// begins. Drops sit at the angle `contact`, radians, with feet `size` times as wide, and run
    /// from the radius `runs_from`, m.
    pub(crate) fn new(
        begin: f64,
        breaks: &[f64],
        rainfall: impl Fn(f64) -> Rainfall,
        contact: f64,
        size: f64,
        runs_from: f64,
    ) -> Self {
        let mut times = vec![begin];
        times.extend(breaks.first().filter(|first| **first > begin));
        for pair in breaks.windows(2) {
            let step = (pair[1] - pair[0]) / KEYFRAME_PART_COUNT as f64;
            times.extend(
                (0..=KEYFRAME_PART_COUNT).map(|k| pair[0] + step * k as f64).filter(|time| *time > begin),
            );
        }
        times.dedup();
        let wide = 1e-3 * foot(contact) * size;
        let classes = RAIN.classes();
        let mut segments: Vec<Segment> = Vec::with_capacity(times.len());
        for (i, begin) in times.iter().enumerate() {
            let middle = times.get(i + 1).map_or(*begin, |end| 0.5 * (begin + end));
            let rain = rainfall(middle);
            let numbers = RAIN.densities(&classes, rain.rate);
            let landing: Vec<f64> =
                classes.iter().zip(&numbers).map(|(class, n)| n * rain.meets(class.fall_speed)).collect();
            // Radii at the ends of each class.
            let radii = classes.iter().map(|class| class.diameters.map(|d| d * wide));
            let (mut small, mut large, mut water) = (Vec::new(), Vec::new(), 0.0);
            for ((class, radii), flux) in classes.iter().zip(radii).zip(&landing) {
                let list = if radii[1] < runs_from { &mut small } else { &mut large };
                list.push((radii, *flux));
                water += 1e-9 * class.water * flux;
            }
            let sum = |list: &[([f64; 2], f64)]| list.iter().map(|(_, flux)| flux).sum::<f64>();
            // Water must leave the glass: drops that grow by others run too.
            let volume = std::f64::consts::PI / 6.0 * (1e-3 * runs_from / wide).powi(3);
            let grown = water / (COLLECTED_WATER * volume);
            let (sits, runs) = (sum(&small), sum(&large) + grown);
            large.insert(0, ([runs_from, MAX_GROWTH * runs_from], grown));
            let area = small.iter().map(|([a, b], flux)| flux * (0.5 * (a + b)).powi(2)).sum::<f64>();
            let flux =
                LandedDrops { small: sits, running: runs, dry: f64::from(u8::from(sits + runs <= 0.0)) };
            let landed = segments.last().map_or(LandedDrops::default(), |last| last.landed_at(*begin));
            segments.push(Segment {
                begin: *begin,
                landed,
                flux,
                radii: Arc::new([quantiles(&small), quantiles(&large)]),
                area: if sits > 0.0 { std::f64::consts::PI * area / sits } else { 0.0 },
                grown: if runs > 0.0 { grown / runs } else { 0.0 },
            });
        }
        Self { segments }
    }

    pub(super) fn segment(&self, time: f64) -> &Segment {
        &self.segments[self.segments.partition_point(|segment| segment.begin <= time).max(1) - 1]
    }

    /// Returns the drops that have landed until an instant, s.
    pub(crate) fn landed(&self, time: f64) -> LandedDrops {
        self.segment(time).landed_at(time)
    }

    /// Returns true if no drop has landed until an instant, s.
    pub(crate) fn is_dry(&self, time: f64) -> bool {
        let LandedDrops { small, running, .. } = self.landed(time);
        small + running <= 0.0
    }

    /// The instant at which so many sitting drops have landed, a m^2.
    pub(super) fn time_of_small(&self, count: f64) -> f64 {
        self.time_of(count, |landed| landed.small)
    }

    /// The instant at which so many running drops have landed, a m^2.
    pub(super) fn time_of_running(&self, count: f64) -> f64 {
        self.time_of(count, |landed| landed.running)
    }

    #[inline]
    fn time_of(&self, count: f64, of: impl Fn(&LandedDrops) -> f64) -> f64 {
        let after = self.segments.partition_point(|segment| of(&segment.landed) <= count).max(1);
        let segment = &self.segments[after - 1];
        let flux = of(&segment.flux);
        if flux > 0.0 { segment.begin + (count - of(&segment.landed)) / flux } else { segment.begin }
    }

    /// Radius, m, of a drop that lands at an instant with this share of drops below it; of those
    /// that sit or run.
    #[inline]
    pub(super) fn radius(&self, time: f64, share: f64, runs: bool) -> f64 {
        let table = &self.segment(time).radii[usize::from(runs)];
        let at = share * QUANTILE_COUNT as f64;
        let k = (at as usize).min(QUANTILE_COUNT - 1);
        let part = at - k as f64;
        f64::from(table[k]) + part * f64::from(table[k + 1] - table[k])
    }

    /// Greatest radius of a drop that lands, m.
    pub(crate) fn widest(&self) -> f64 {
        let radii = self.segments.iter().flat_map(|segment| segment.radii.iter().flatten());
        f64::from(radii.copied().fold(0.0, f32::max))
    }

    /// Mean area of the foot of a drop that sits, m^2; the greatest of all times.
    pub(super) fn area(&self) -> f64 {
        self.segments.iter().map(|segment| segment.area).fold(0.0, f64::max)
    }
}

impl Segment {
    fn landed_at(&self, time: f64) -> LandedDrops {
        let passed = (time - self.begin).max(0.0);
        let LandedDrops { small, running, dry } = self.landed;
        LandedDrops {
            small: small + self.flux.small * passed,
            running: running + self.flux.running * passed,
            dry: dry + self.flux.dry * passed,
        }
    }
}

/// Radii at even shares of all drops of classes: their radii at both ends, and how many there are.
fn quantiles(classes: &[([f64; 2], f64)]) -> Quantiles {
    let total: f64 = classes.iter().map(|(_, number)| number).sum();
    let mut table = [0.0; QUANTILE_COUNT + 1];
    let (mut class, mut below) = (0, 0.0);
    for (k, radius) in table.iter_mut().enumerate() {
        let wanted = total * k as f64 / QUANTILE_COUNT as f64;
        while class + 1 < classes.len() && below + classes[class].1 < wanted {
            below += classes[class].1;
            class += 1;
        }
        if let Some(([low, high], number)) = classes.get(class) {
            let part = if *number > 0.0 { ((wanted - below) / number).clamp(0.0, 1.0) } else { 0.0 };
            *radius = (low + (high - low) * part) as f32;
        }
    }
    table
}
