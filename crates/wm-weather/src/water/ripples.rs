//! Rings of rain drops on water.
//!
//! A drop makes a packet of waves of some 31 mm, which runs outwards at 0.25 m/s and decays. The
//! rings of drops above 2 mm are drawn one by one; those of smaller ones have run into each other
//! and are a random field of the same waves. Slopes follow from the energy of drops, by the sizes
//! and the speeds of the rain that falls, and the viscous decay of waves: rms 0.066 at 5 mm/h, 0.10
//! at 10 mm/h and 0.26 at 50 mm/h on deep water, less where water is shallow. Drops above 2 mm
//! bring 45, 57 and 79 % of that.

use super::fft::{Complex, TILE_SIDE_NODES};
use super::tile::SlopeTile;
use super::waves::{KINEMATIC_SURFACE_TENSION, WaveField};
use crate::particles::RAIN;
use crate::physics::{GRAVITY, WATER_DENSITY};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;
use wm_base::random::uniform;

/// Wave number of rings, rad/m.
pub(crate) const WAVE_NUMBER: f64 = 200.0;
/// Speed at which rings widen, m/s: that of waves of [`WAVE_NUMBER`] by the dispersion law.
pub(crate) const RING_SPEED: f64 = 0.252;
/// Side of the tile, m.
pub(crate) const SIZE: f64 = 2.048;
/// Parts of the seeds of the random field and of the drops.
pub(super) const FIELD_SEED: u64 = 0x5241_494e;
const DROP_SEED: u64 = 0x5249_4e47;
/// Relative width of the band of waves that old rings make.
const BAND_WIDTH_RATIO: f64 = 0.18;
/// Least diameter of drops whose rings are drawn.
pub(crate) const MIN_RING_DROP_DIAMETER_MM: f64 = 2.0;
/// Share of the energy of drops that waves get, and the viscosity of water, m^2/s.
const WAVE_ENERGY_SHARE: f64 = 0.01;
const WATER_VISCOSITY: f64 = 1e-6;
/// Steps of the integrals over diameters.
const DIAMETER_STEP_COUNT: usize = 220;
/// Rates below this have the sizes of drops at it, mm/h.
const LEAST_RATE: f64 = 0.01;
/// Time for which rings are drawn, and over which they decay, s.
const RING_LIFE_S: f64 = 0.7;
const RING_DECAY_S: f64 = 0.3;
/// Half the width of a ring, standard deviation.
const RING_SIGMA_M: f64 = 0.016;
/// Widths from its middle to which it is drawn.
const RING_REACH_SIGMAS: f64 = 2.6;
/// Radius within which a ring does not grow higher inwards.
const CORE_RADIUS_M: f64 = 0.012;
/// Squared slopes of the band of old rings, summed over its waves: a constant that takes
/// milliseconds.
static BAND_POWER: OnceLock<f64> = OnceLock::new();
/// Largest flux of drawn drops above 2 mm, 1/(m^2 s).
const MAX_DROP_FLUX: f64 = 1200.0;

/// Energy and numbers of the drops that fall on level ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct DropSums {
    /// Energy of all drops, W/m^2.
    power: f64,
    /// Energy of those above 2 mm, W/m^2.
    large_power: f64,
    /// Number of those above 2 mm, 1/(m^2 s).
    large: f64,
}

impl DropSums {
    /// Computes the drops of rain of `rate` mm/h, by their sizes and speeds ([`RAIN`]).
    fn new(rate: f64) -> Self {
        if rate <= 0.0 {
            return Self::default();
        }
        let [_, slope] = (RAIN.spectrum)(rate.max(LEAST_RATE));
        let [least, greatest] = RAIN.diameters;
        let (mut sums, mut water) = (Self::default(), 0.0);
        let mut add = |[from, to]: [f64; 2], is_large: bool| {
            for step in 0..DIAMETER_STEP_COUNT {
                let diameter = from + (to - from) * (step as f64 + 0.5) / DIAMETER_STEP_COUNT as f64;
                let speed = RAIN.fall_speed(diameter);
                let number = (-slope * (diameter - least)).exp() * speed * (to - from);
                // kg, a drop.
                let mass = WATER_DENSITY * PI / 6.0 * (1e-3 * diameter).powi(3);
                let power = 0.5 * number * mass * speed * speed;
                water += number * mass;
                sums.power += power;
                if is_large {
                    sums.large_power += power;
                    sums.large += number;
                }
            }
        };
        add([least, MIN_RING_DROP_DIAMETER_MM], false);
        add([MIN_RING_DROP_DIAMETER_MM, greatest], true);
        // 1 mm of water is 1 kg/m^2.
        let scale = rate / 3600.0 / water;
        let Self { power, large_power, large } = sums;
        Self { power: scale * power, large_power: scale * large_power, large: scale * large }
    }
}

/// Root mean square slope, both axes together, on water `depth` metres deep under rain of `rate`
/// mm/h: on deep water that at which waves lose by viscosity what drops bring.
pub(crate) fn slope_rms(rate: f64, depth: f64) -> f64 {
    // (depth, share), between by its logarithm.
    const SLOPE_SHARES_BY_DEPTH: [(f64, f64); 4] =
        [(0.002, 0.29), (0.005, 0.49), (0.010, 0.83), (0.030, 1.0)];
    let stiffness = GRAVITY + KINEMATIC_SURFACE_TENSION * WAVE_NUMBER * WAVE_NUMBER;
    let deep = (WAVE_ENERGY_SHARE * DropSums::new(rate).power
        / (4.0 * WATER_VISCOSITY * WATER_DENSITY * stiffness))
        .sqrt();
    let share = match SLOPE_SHARES_BY_DEPTH.iter().position(|(own, _)| depth < *own) {
        None => SLOPE_SHARES_BY_DEPTH[SLOPE_SHARES_BY_DEPTH.len() - 1].1,
        Some(0) => SLOPE_SHARES_BY_DEPTH[0].1 * (depth / SLOPE_SHARES_BY_DEPTH[0].0).max(0.0),
        Some(next) => {
            let [(shallow, less), (deeper, more)] =
                [SLOPE_SHARES_BY_DEPTH[next - 1], SLOPE_SHARES_BY_DEPTH[next]];
            less + (more - less) * (depth / shallow).ln() / (deeper / shallow).ln()
        }
    };
    deep * share
}

/// Drops above 2 mm that fall on a m^2 in a second of rain of `rate` mm/h.
pub(crate) fn large_drops(rate: f64) -> f64 {
    DropSums::new(rate).large
}

/// A ring: where its drop fell, m on the tile, and how long ago, s.
struct Ring {
    center: [f64; 2],
    age: f64,
}

/// A drop above 2 mm that falls on the tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LargeDrop {
    /// Number in the sequence of all drops.
    pub(crate) number: i64,
    /// The point that it hits, m on the tile.
    pub(crate) center: [f64; 2],
    /// The time at which it hits, s.
    pub(crate) time: f64,
}

/// The seed of the drops on water whose own seed is this.
pub(crate) fn drop_seed(water: u64) -> u64 {
    water ^ FIELD_SEED ^ DROP_SEED
}

/// The flux of the drops that [`large_drops_between`] gives, 1/(m^2 s).
pub(crate) fn drawn_drops(rate: f64) -> f64 {
    large_drops(rate).min(MAX_DROP_FLUX)
}

/// The drops above 2 mm that fall on the tile at the times `from` to `to`, s: a fixed sequence of
/// which the rain takes its share, so that a drop stays while the rate changes. The tile repeats on
/// the whole plane.
pub(crate) fn large_drops_between(rate: f64, span: [f64; 2], seed: u64) -> impl Iterator<Item = LargeDrop> {
    let [from, to] = span;
    let most = MAX_DROP_FLUX * SIZE * SIZE;
    let share = drawn_drops(rate) / MAX_DROP_FLUX;
    let [first, last] = [from, to].map(|time| (time * most).floor() as i64);
    (first..=last).filter_map(move |number| {
        let draw = |k: u64| uniform(seed, (number as u64).wrapping_mul(4).wrapping_add(k));
        let time = (number as f64 + draw(0)) / most;
        (draw(1) < share).then(|| LargeDrop { number, center: [SIZE * draw(2), SIZE * draw(3)], time })
    })
}

/// The young rings of one instant.
fn rings(rate: f64, time: f64, seed: u64) -> Vec<Ring> {
    large_drops_between(rate, [time - RING_LIFE_S, time], seed)
        .map(|drop| Ring { center: drop.center, age: time - drop.time })
        .filter(|ring| ring.age > 0.0 && ring.age < RING_LIFE_S)
        .collect()
}

/// Slopes of the water under rain of `rate` mm/h at a time, s, with this root mean square over both
/// axes.
pub(crate) fn slopes(rate: f64, rms: f64, time: f64, seed: u64) -> SlopeTile {
    let variance = rms * rms;
    let drops = DropSums::new(rate);
    let flux = drops.large.min(MAX_DROP_FLUX);
    // Each large drop brings its energy to a ring; what the others bring, and large ones that are
    // too many, is in the field.
    let ringed = if flux > 0.0 { drops.large_power / drops.power * flux / drops.large } else { 0.0 };
    let cell = TAU / SIZE;
    // Heights of a band of waves whose slopes have the variance that is left; numbers on the ring
    // of wave vectors.
    let band =
        |k: [f64; 2]| (-0.5 * ((k[0].hypot(k[1]) / WAVE_NUMBER - 1.0) / BAND_WIDTH_RATIO).powi(2)).exp();
    let sum = *BAND_POWER.get_or_init(|| {
        let half = TILE_SIDE_NODES as i64 / 2;
        (-half + 1..half)
            .flat_map(|j| (-half + 1..half).map(move |i| [i as f64 * cell, j as f64 * cell]))
            .map(|k| (k[0] * k[0] + k[1] * k[1]) * band(k).powi(2))
            .sum::<f64>()
    });
    let field = WaveField::kept([0, 0, 0, 0, seed], || {
        WaveField::new(SIZE, seed, |k| {
            let own = band(k);
            if own > 0.02 { own } else { 0.0 }
        })
    });
    let mut values = field.slopes(time, (0.5 * (1.0 - ringed) * variance / sum).sqrt());
    // The variance of rings: flux times the integral of their squared slopes over plane and age.
    let height = if flux > 0.0 { (ringed * variance / (flux * ring_power())).sqrt() } else { 0.0 };
    let rings = rings(rate, time, seed ^ DROP_SEED);
    let step = SIZE / TILE_SIDE_NODES as f64;
    values.par_chunks_exact_mut(TILE_SIDE_NODES).enumerate().for_each(|(row, line)| {
        let y = (row as f64 + 0.5) * step;
        for ring in &rings {
            draw_row(ring, height, line, wrapped(y - ring.center[1]), step);
        }
    });
    SlopeTile::new(SIZE, values.into_par_iter())
}

/// Factor on a ring's slopes by its age, s: it appears while its waves leave the point that was
/// hit, decays, and goes softly.
fn fading(age: f64) -> f64 {
    (-age / RING_DECAY_S).exp() * (1.0 - age / RING_LIFE_S).min(age / 0.05).clamp(0.0, 1.0)
}

/// Squared slopes of a ring of height 1, summed over the plane and its life, m^2 s.
fn ring_power() -> f64 {
    const AGE_STEP_COUNT: usize = 64;
    const WAY_STEP_COUNT: usize = 48;
    let middles =
        |count: usize, length: f64| (0..count).map(move |i| (i as f64 + 0.5) / count as f64 * length);
    let at = |age: f64| -> f64 {
        let around = |off: f64| {
            let r = (RING_SPEED * age + off).max(0.0);
            let slope = (-0.5 * (off / RING_SIGMA_M).powi(2)).exp() * (WAVE_NUMBER * off).cos();
            TAU * r / (r + CORE_RADIUS_M) * slope * slope
        };
        let reach = 2.0 * RING_REACH_SIGMAS * RING_SIGMA_M;
        let plane: f64 = middles(WAY_STEP_COUNT, reach).map(|way| around(way - 0.5 * reach)).sum();
        fading(age).powi(2) * plane * reach / WAY_STEP_COUNT as f64
    };
    middles(AGE_STEP_COUNT, RING_LIFE_S).map(at).sum::<f64>() * RING_LIFE_S / AGE_STEP_COUNT as f64
}

/// The shortest way across a tile that repeats.
fn wrapped(way: f64) -> f64 {
    way - SIZE * (way / SIZE).round()
}

/// Adds a ring to a row of the tile that is `dy` metres from its centre.
fn draw_row(ring: &Ring, height: f64, line: &mut [Complex], dy: f64, step: f64) {
    let radius = RING_SPEED * ring.age;
    let outer = radius + RING_REACH_SIGMAS * RING_SIGMA_M;
    if dy.abs() >= outer {
        return;
    }
    let reach = (outer * outer - dy * dy).sqrt();
    let inner = radius - RING_REACH_SIGMAS * RING_SIGMA_M;
    let hole = if inner > dy.abs() { (inner * inner - dy * dy).sqrt() } else { 0.0 };
    let node = |x: f64| ((ring.center[0] + x) / step - 0.5).ceil() as i64;
    let strength = height * fading(ring.age);
    let mut draw = |from: i64, to: i64| {
        for i in from..to {
            let x = (i as f64 + 0.5) * step - ring.center[0];
            let r = (x * x + dy * dy).sqrt().max(1e-4);
            let off = r - radius;
            let packet = (-0.5 * (off / RING_SIGMA_M) * (off / RING_SIGMA_M)) as f32;
            let slope = strength as f32 / ((r + CORE_RADIUS_M) as f32).sqrt()
                * packet.exp()
                * ((WAVE_NUMBER * off) as f32).cos();
            let value = &mut line[i.rem_euclid(TILE_SIDE_NODES as i64) as usize];
            value[0] += slope * (x / r) as f32;
            value[1] += slope * (dy / r) as f32;
        }
    };
    if hole > 0.0 {
        draw(node(-reach), node(-hole));
        draw(node(hole), node(reach));
    } else {
        draw(node(-reach), node(reach));
    }
}
