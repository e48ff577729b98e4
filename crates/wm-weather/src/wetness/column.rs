//! Water on a piece of ground over time.
//!
//! Rain fills pores, then the texture of the surface; what is more runs off. In an even rain of `I`
//! mm/h on a slope `S` a length `L` m below its upper edge, water stands
//! `d = 0.01485 MTD^0.11 L^0.43 I^0.59 S^-0.42 - MTD` mm above a texture of mean depth `MTD` mm
//! (Gallaway 1971; below 0 it stands in the texture). So the store `s = d + MTD` runs off at the
//! rate at which it would be even: `q = (s / k)^(1 / 0.59)` with `k` the factors of the formula. A
//! part of the texture keeps its water, which only dries: with the pores 0.6 mm on level paving, of
//! the 0.3 to 0.7 mm that tables of urban drainage state as its wetting loss. So paving shines
//! after rain until it has dried. What dries is taken from the store first and from pores last.
//!
//! An instant is a sum of steps that begin at the same times whatever was asked for before, so any
//! instant can be had alone.

use crate::cover::MeltSample;

/// Exponents of rain, texture, length and slope, and the factor of Gallaway's formula.
const RAIN_EXPONENT: f64 = 0.59;
const TEXTURE_EXPONENT: f64 = 0.11;
const LENGTH_EXPONENT: f64 = 0.43;
const SLOPE_EXPONENT: f64 = -0.42;
const GALLAWAY_FACTOR: f64 = 0.014_85;
/// Water that pores near the surface hold.
pub(crate) const PORE_CAPACITY_MM: f64 = 0.3;
/// Rounds in which the store of a step is found, and the error at which they end, mm.
const MAX_ROUND_COUNT: usize = 12;
const STORE_ERROR_MM: f64 = 1e-10;
/// Shares of the rain for which water is followed: the steps of the greatest, which driving rain on
/// walls can have.
pub(super) const RAIN_SHARE_COUNT: usize = 16;
pub(super) const MAX_RAIN_SHARE: f64 = 1.25;

/// A kind of ground by how water leaves it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drainage {
    /// Nearly level: paving with a fall of 2 %, 3.5 m below its edge.
    Level,
    /// Slopes, walls and leaves.
    Steep,
}

impl Drainage {
    /// Every kind.
    pub(crate) const ALL: [Self; 2] = [Self::Level, Self::Steep];

    /// Length below the upper edge, m, and slope.
    fn fall(self) -> [f64; 2] {
        match self {
            Self::Level => [3.5, 0.02],
            Self::Steep => [1.5, 0.7],
        }
    }

    /// The share of the texture's water that does not run off, 0-1.
    fn keeps(self) -> f64 {
        match self {
            Self::Level => 0.35,
            Self::Steep => 0.1,
        }
    }
}

/// The rate at which a store of water runs off a piece of ground.
#[derive(Clone, Copy, Debug)]
struct RunOffLaw {
    /// Store over the run-off, mm/h, to the power [`RAIN_EXPONENT`].
    factor: f64,
    /// Store of which nothing runs off, mm.
    kept: f64,
}

impl RunOffLaw {
    fn new(kind: Drainage, texture: f64) -> Self {
        let [length, slope] = kind.fall();
        Self { factor: store_factor(texture, length, slope), kept: kind.keeps() * texture }
    }

    /// Water that runs off, mm/h, of a store, mm.
    fn rate(self, store: f64) -> f64 {
        if store > self.kept { (store / self.factor).powf(1.0 / RAIN_EXPONENT) } else { 0.0 }
    }

    /// Water left in a store of `all` after some hours of running off, mm: the solution of
    /// `s + hours (s / factor)^(1 / 0.59) = all`, and at least what is kept.
    fn left(self, all: f64, hours: f64) -> f64 {
        if all <= self.kept || hours <= 0.0 {
            return all.max(0.0);
        }
        let Self { factor, kept } = self;
        let power = 1.0 / RAIN_EXPONENT;
        // Newton's steps come down from above, since the function curves up.
        let mut store = all.min(factor * (all / hours).powf(RAIN_EXPONENT));
        for _ in 0..MAX_ROUND_COUNT {
            let flow = hours * (store / factor).powf(power);
            let off = store + flow - all;
            store -= off / (1.0 + power * flow / store.max(1e-12));
            if off.abs() < STORE_ERROR_MM {
                break;
            }
        }
        store.clamp(kept, all)
    }
}

fn store_factor(texture: f64, length: f64, slope: f64) -> f64 {
    GALLAWAY_FACTOR
        * texture.powf(TEXTURE_EXPONENT)
        * length.powf(LENGTH_EXPONENT)
        * slope.powf(SLOPE_EXPONENT)
}

/// A part of the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WetStep {
    /// Duration, h.
    pub(crate) hours: f64,
    /// Rain in it, mm.
    pub(crate) rain: f64,
    /// Water that can dry in it where no snow lies, mm.
    pub(crate) dries: f64,
    /// The snow on the ground.
    pub(crate) snow: SnowStep,
}

impl WetStep {
    /// Returns true if water comes in it.
    pub(crate) fn is_wet(&self) -> bool {
        self.rain > 0.0 || self.snow.melts.iter().any(|melts| *melts > 0.0)
    }
}

/// Snow on the ground in a part of the time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SnowStep {
    /// Melt water, mm, for each share of the rain.
    melts: [f64; RAIN_SHARE_COUNT],
    /// Share of the ground that is bare, 0-1, for each share of the rain.
    bare: [f64; RAIN_SHARE_COUNT],
    /// Share of open level ground that is bare, 0-1.
    pub(super) open: f64,
}

impl Default for SnowStep {
    fn default() -> Self {
        Self { melts: [0.0; RAIN_SHARE_COUNT], bare: [1.0; RAIN_SHARE_COUNT], open: 1.0 }
    }
}

impl SnowStep {
    /// The snow between two instants. Where a share of the rain falls the same share of the snow
    /// does.
    pub(crate) fn between(from: &MeltSample, to: &MeltSample) -> Self {
        let shares: [f64; RAIN_SHARE_COUNT] = std::array::from_fn(|k| share_of(k as f64));
        let [before, after] = [from, to].map(|sample| shares.map(|share| sample.at(share)));
        Self {
            melts: std::array::from_fn(|k| (after[k][0] - before[k][0]).max(0.0)),
            bare: after.map(|[_, bare]| bare),
            open: to.at(1.0)[1],
        }
    }

    /// One of `parts` equal parts of the step.
    pub(crate) fn divided(self, parts: f64) -> Self {
        Self { melts: self.melts.map(|melts| melts / parts), ..self }
    }
}

/// Water on a piece of ground, and all that came, ran off and dried until now, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct WetColumn {
    /// Water in pores.
    pub(crate) pores: f64,
    /// Water in and above the texture.
    pub(crate) store: f64,
    /// All that has come.
    pub(crate) came: f64,
    /// All that has run off.
    pub(crate) ran_off: f64,
    /// All that has dried.
    pub(crate) dried: f64,
}

impl WetColumn {
    /// Lets some hours pass, with `water` mm coming to the ground, of which `dries` mm can dry.
    /// Returns what ran off, mm.
    fn pass(&mut self, law: RunOffLaw, hours: f64, rates: [f64; 2]) -> f64 {
        let [water, dries] = rates;
        let can_dry = dries;
        let soaks = (PORE_CAPACITY_MM - self.pores) * (1.0 - (-water / PORE_CAPACITY_MM).exp());
        self.pores += soaks;
        self.came += water;
        let all = self.store + water - soaks;
        let left = law.left(all, hours);
        let runs = all - left;
        let dries = can_dry.min(left);
        self.store = left - dries;
        let from_pores = (can_dry - dries).min(self.pores);
        self.pores -= from_pores;
        self.ran_off += runs;
        self.dried += dries + from_pores;
        runs
    }
}

/// Wetness at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Wet {
    /// Filled share of the pores, 0-1.
    pub(crate) pores: f32,
    /// Share of the texture that is under water, 0-1.
    pub(crate) film: f32,
    /// Depth of water above the texture, mm.
    pub(crate) depth: f32,
}

/// Water on ground of each [`Drainage`] that gets one of the shares of the rain.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct WetColumns {
    /// Mean depth of the texture, mm.
    texture: f64,
    columns: [[WetColumn; RAIN_SHARE_COUNT]; Drainage::ALL.len()],
}

/// One of the shares of the rain for which water is followed.
pub(super) fn share_of(step: f64) -> f64 {
    MAX_RAIN_SHARE * (step / (RAIN_SHARE_COUNT - 1) as f64).powi(2)
}

/// The step of a share, between two of which water is mixed.
pub(super) fn step_of(share: f64) -> f64 {
    (share.clamp(0.0, MAX_RAIN_SHARE) / MAX_RAIN_SHARE).sqrt() * (RAIN_SHARE_COUNT - 1) as f64
}

impl WetColumns {
    /// Dry ground with a texture of this mean depth, mm.
    pub(crate) fn dry(texture: f64) -> Self {
        Self { texture, columns: Default::default() }
    }

    /// Lets a step pass. Returns what ran off of level ground in it, mm, for each share.
    pub(super) fn pass(&mut self, step: &WetStep) -> [f64; RAIN_SHARE_COUNT] {
        let mut runs = [0.0; RAIN_SHARE_COUNT];
        for kind in Drainage::ALL {
            let law = RunOffLaw::new(kind, self.texture);
            for (k, column) in self.columns[kind as usize].iter_mut().enumerate() {
                let water = share_of(k as f64) * step.rain + step.snow.melts[k];
                let ran = column.pass(law, step.hours, [water, step.dries * step.snow.bare[k]]);
                if kind == Drainage::Level {
                    runs[k] = ran;
                }
            }
        }
        runs
    }

    /// The water on ground that gets a share of the rain.
    pub(crate) fn column(&self, kind: Drainage, share: f64) -> WetColumn {
        let columns = &self.columns[kind as usize];
        let at = step_of(share);
        let low = (at as usize).min(RAIN_SHARE_COUNT - 2);
        let (part, [a, b]) = (at - low as f64, [columns[low], columns[low + 1]]);
        let mix = |a: f64, b: f64| a + (b - a) * part;
        WetColumn {
            pores: mix(a.pores, b.pores),
            store: mix(a.store, b.store),
            came: mix(a.came, b.came),
            ran_off: mix(a.ran_off, b.ran_off),
            dried: mix(a.dried, b.dried),
        }
    }

    /// Water that runs off of that ground, mm/h.
    pub(crate) fn runs_off(&self, kind: Drainage, share: f64) -> f64 {
        RunOffLaw::new(kind, self.texture).rate(self.column(kind, share).store)
    }

    /// The wetness of that ground.
    pub(crate) fn wet(&self, kind: Drainage, share: f64) -> Wet {
        let column = self.column(kind, share);
        Wet {
            pores: (column.pores / PORE_CAPACITY_MM).min(1.0) as f32,
            film: (column.store / self.texture).min(1.0) as f32,
            depth: (column.store - self.texture).max(0.0) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The depth of water above a texture of mean depth `texture`, mm, in an even rain, mm/h; below
    /// 0 it stands in the texture. `length` m below the upper edge of a `slope`. Gallaway (1971).
    fn film_depth(texture: f64, length: f64, rain: f64, slope: f64) -> f64 {
        store_factor(texture, length, slope) * rain.powf(RAIN_EXPONENT) - texture
    }

    impl WetStep {
        /// A part of the time without snow: its length, h, and the rain and what can dry in it, mm.
        pub(crate) fn bare(hours: f64, rain: f64, dries: f64) -> Self {
            Self { hours, rain, dries, snow: SnowStep::default() }
        }
    }

    impl WetColumns {
        /// Lets steps pass, of which only the end counts.
        pub(crate) fn after(mut self, steps: &[WetStep]) -> Self {
            steps.iter().for_each(|step| {
                self.pass(step);
            });
            self
        }
    }

    fn rain(rate: f64, hours: f64, dries: f64) -> Vec<WetStep> {
        let steps = 200;
        let each = hours / f64::from(steps);
        vec![WetStep::bare(each, rate * each, dries * each); steps as usize]
    }

    #[test]
    fn films_are_those_of_gallaway() {
        for (rate, depth) in [(10.0, -0.30), (25.0, 0.06), (50.0, 0.49)] {
            assert!((film_depth(0.8, 3.5, rate, 0.02) - depth).abs() < 0.006, "{rate}");
            // So much stands after a long even rain.
            let column = WetColumns::dry(0.8).after(&rain(rate, 2.0, 0.0)).column(Drainage::Level, 1.0);
            assert!((column.store - 0.8 - depth).abs() < 0.01, "{rate}: {column:?}");
        }
    }

    #[test]
    fn pores_fill_first_and_dry_last() {
        let early = WetColumns::dry(0.8).after(&rain(10.0, 0.02, 0.0)).wet(Drainage::Level, 1.0);
        assert!(early.pores > 0.4 && early.film < 0.1 && early.depth == 0.0, "{early:?}");
        let mut columns = WetColumns::dry(0.8).after(&rain(50.0, 0.5, 0.0));
        assert!(columns.wet(Drainage::Level, 1.0).depth > 0.4);
        // The film above the texture runs off within minutes; a third of the texture keeps its
        // water until it has dried.
        columns = columns.after(&rain(0.0, 0.5, 0.0));
        let after = columns.wet(Drainage::Level, 1.0);
        assert!((after.film - 0.35).abs() < 1e-6 && after.pores > 0.99, "{after:?}");
        columns = columns.after(&rain(0.0, 0.6, 0.46));
        let after = columns.wet(Drainage::Level, 1.0);
        assert!(after.film < 0.05 && after.pores > 0.9, "{after:?}");
        columns = columns.after(&rain(0.0, 1.5, 0.46));
        assert_eq!(columns.wet(Drainage::Level, 1.0), Wet::default());
    }

    proptest! {
        #[test]
        fn what_came_is_there_or_ran_off_or_dried(
            rates in prop::collection::vec(0.0..120.0f64, 1..6),
            dries in 0.0..1.0f64,
            share in 0.0..1.25f64,
        ) {
            let mut columns = WetColumns::dry(0.7);
            for rate in &rates {
                columns = columns.after(&rain(*rate, 0.3, dries));
            }
            let share = share_of(step_of(share).round());
            for kind in Drainage::ALL {
                let column = columns.column(kind, share);
                let came = share * rates.iter().map(|rate| 0.3 * rate).sum::<f64>();
                prop_assert!((column.came - came).abs() < 1e-9 * came.max(1.0));
                let there = column.pores + column.store + column.ran_off + column.dried;
                prop_assert!((there - came).abs() < 1e-9 * came.max(1.0), "{column:?}");
                prop_assert!(column.pores >= 0.0 && column.pores <= PORE_CAPACITY_MM && column.store >= 0.0);
            }
        }

        #[test]
        fn more_rain_is_wetter(rate in 0.1..60.0f64, more in 1.1..3.0f64, hours in 0.01..2.0f64) {
            let wet = |rate: f64| WetColumns::dry(0.8).after(&rain(rate, hours, 0.2)).wet(Drainage::Level, 1.0);
            let (less, more) = (wet(rate), wet(more * rate));
            prop_assert!(more.pores >= less.pores && more.film >= less.film && more.depth >= less.depth);
        }
    }
}
