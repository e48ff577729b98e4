//! The drops that have just fallen, on a tile that repeats.
//!
//! Drops above 2 mm are the ones that make rings ([`crate::water::ripples`]); the others are a
//! sequence of their own. Each drop has a rank: where fewer are wanted, those of the lowest ranks
//! are taken, turned by a number of the tile so that no two tiles show the same ones.

use crate::particles::Precipitation;
use crate::water::ripples::{self, MIN_RING_DROP_DIAMETER_MM, SIZE};
use wm_base::random::{RandomSequence, bits, uniform};

/// Diameter from which some drops splash.
const MIN_SPLASH_DIAMETER_MM: f64 = 1.0;
/// Most of the other drops, a m^2 and second: all of them at 300 mm/h.
const MAX_DROP_FLUX: f64 = 12_000.0;
/// Parts of the seeds: of the drops without rings, and of each drop.
const OTHER_DROP_SEED: u64 = 0x5350_4c41;
const DROP_SEED: u64 = 0x4f57_4e53;

/// A drop that has fallen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FallenDrop {
    /// Rank, uniform in 0-1.
    pub(crate) rank: f32,
    /// Place on the tile, m.
    pub(crate) place: [f32; 2],
    /// Time since it hit, s; below 0 it will.
    pub(crate) age: f32,
    /// Diameter, mm.
    pub(crate) diameter: f32,
    /// The key of its random numbers.
    pub(crate) key: u64,
}

/// The flux of drops through a level plane, 1/(m^2 s), by diameter.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct DropFlux {
    /// Least and greatest diameter, mm, and the flux of those.
    pieces: Vec<([f64; 2], f64)>,
}

impl DropFlux {
    /// Computes the flux of a rain's drops between two diameters, mm.
    pub(crate) fn between(rain: &Precipitation, span: [f64; 2]) -> Self {
        let [from, to] = span;
        let pieces = rain.classes().filter_map(|(class, number)| {
            let [low, high] = class.diameters;
            let kept = [low.max(from), high.min(to)];
            let share = (kept[1] - kept[0]) / (high - low);
            (share > 0.0).then_some((kept, share * number * class.fall_speed))
        });
        Self { pieces: pieces.collect() }
    }

    /// Flux of all drops, 1/(m^2 s).
    pub(crate) fn total(&self) -> f64 {
        self.pieces.iter().map(|(_, flux)| flux).sum()
    }

    /// The diameter with a share of the flux below it, mm.
    fn diameter(&self, share: f64) -> f64 {
        let mut left = share * self.total();
        for ([low, high], flux) in &self.pieces {
            if left < *flux {
                return low + (high - low) * left / flux;
            }
            left -= flux;
        }
        self.pieces.last().map_or(MIN_SPLASH_DIAMETER_MM, |([_, high], _)| *high)
    }
}

/// The drops of the tile that have fallen up to an age, by their ranks.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FallenDrops {
    pub(crate) drops: Vec<FallenDrop>,
}

impl FallenDrops {
    /// The drops of `rain` that hit from `since` s before `time` until `ahead` s after it. `seed`
    /// is that of the water.
    pub(crate) fn new(rain: &Precipitation, time: f64, span: [f64; 2], seed: u64) -> Self {
        let [since, ahead] = span;
        let large = DropFlux::between(rain, [MIN_RING_DROP_DIAMETER_MM, f64::INFINITY]);
        let small = DropFlux::between(rain, [MIN_SPLASH_DIAMETER_MM, MIN_RING_DROP_DIAMETER_MM]);
        let (all_large, all_small) = (large.total(), small.total());
        let rings = ripples::drawn_drops(rain.rate);
        let span = [time - since, time + ahead];
        // Ripples draw a limited number of rings, and count large drops in finer steps than the
        // classes of sizes: rings too many have no splash, and large drops without a ring splash
        // with the others.
        let kept = (all_large / rings.max(1e-9)).min(1.0);
        let others = (all_large - rings).max(0.0) + all_small;
        let drop_of = |key: u64, place: [f64; 2], at: f64, diameter: &dyn Fn(&mut RandomSequence) -> f64| {
            let mut draws = RandomSequence::new(key);
            let rank = draws.uniform() as f32;
            let diameter = diameter(&mut draws) as f32;
            FallenDrop { rank, place: place.map(|v| v as f32), age: (time - at) as f32, diameter, key }
        };
        let ring_seed = ripples::drop_seed(seed);
        let rings = ripples::large_drops_between(rain.rate, span, ring_seed).filter_map(|drop| {
            let key = bits(ring_seed ^ DROP_SEED, drop.number as u64);
            (uniform(key, 1) < kept)
                .then(|| drop_of(key, drop.center, drop.time, &|draws| large.diameter(draws.uniform())))
        });
        let (own, most) = (seed ^ OTHER_DROP_SEED, MAX_DROP_FLUX * SIZE * SIZE);
        let share = (others / MAX_DROP_FLUX).min(1.0);
        let above = (others - all_small) / others.max(1e-9);
        let [first, last] = span.map(|time| (time * most).floor() as i64);
        let others = (first..=last).filter_map(|number| {
            let draw = |k: u64| uniform(own, (number as u64).wrapping_mul(4).wrapping_add(k));
            if draw(1) >= share {
                return None;
            }
            let (place, at) = ([SIZE * draw(2), SIZE * draw(3)], (number as f64 + draw(0)) / most);
            Some(drop_of(bits(own ^ DROP_SEED, number as u64), place, at, &|draws| {
                let sizes = if draws.uniform() < above { &large } else { &small };
                sizes.diameter(draws.uniform())
            }))
        });
        let is_in = |drop: &FallenDrop| f64::from(drop.age) < since && f64::from(drop.age) > -ahead;
        let mut drops: Vec<FallenDrop> = rings.chain(others).filter(is_in).collect();
        drops.sort_by(|a, b| a.rank.total_cmp(&b.rank).then(a.key.cmp(&b.key)));
        Self { drops }
    }

    /// Keeps the drops up to a lower age, s.
    pub(crate) fn younger(&self, age: f64) -> Self {
        Self { drops: self.drops.iter().filter(|drop| f64::from(drop.age) < age).copied().collect() }
    }

    /// Calls `visit` with the drops of the lowest `share` of the ranks, which begin at `turn`, and
    /// with the rank of each from there.
    pub(crate) fn each(&self, share: f64, turn: f64, mut visit: impl FnMut(&FallenDrop, f64)) {
        let from = |rank: f64| self.drops.partition_point(|drop| f64::from(drop.rank) < rank);
        let (begin, end) = (from(turn), turn + share);
        let mut pass = |drops: &[FallenDrop], more: f64| {
            drops.iter().for_each(|drop| visit(drop, f64::from(drop.rank) + more - turn));
        };
        if share >= 1.0 {
            pass(&self.drops[begin..], 0.0);
            pass(&self.drops[..begin], 1.0);
        } else if end <= 1.0 {
            pass(&self.drops[begin..from(end)], 0.0);
        } else {
            pass(&self.drops[begin..], 0.0);
            pass(&self.drops[..from(end - 1.0)], 1.0);
        }
    }
}
