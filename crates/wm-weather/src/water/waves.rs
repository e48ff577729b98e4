//! Waves that the wind makes on water of a limited fetch.
//!
//! JONSWAP's growth (Hasselmann and others 1973): `Hs = 0.0016 sqrt(g F / U^2) U^2 / g`,
//! `Tp = 0.286 (g F / U^2)^(1/3) U / g`, for a wind `U` over a fetch `F`; the shape
//! `S(w) ~ w^-5 exp(-1.25 (w / wp)^-4) 3.3^r`, and `2/pi cos^2` about the wind's heading. Over
//! short fetches that is steeper than water is: slopes are at most those that Cox and Munk saw on
//! open water. Waves go by the dispersion law of deep water with surface tension,
//! `w^2 = g k + (tension / density) k^3`.

use super::fft::{Complex, TILE_SIDE_NODES, transform};
use super::tile::SlopeTile;
use crate::physics::GRAVITY;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::{Arc, Mutex, PoisonError};
use wm_base::random::uniform;

/// Surface tension of water over its density, m^3/s^2.
pub(super) const KINEMATIC_SURFACE_TENSION: f64 = 7.28e-5;
/// Variance of slopes of open water, both axes together, and its growth with the wind, s/m (Cox and
/// Munk 1954).
const CALM_SLOPE_VARIANCE: f64 = 0.003;
const SLOPE_VARIANCE_PER_WIND: f64 = 0.00512;
/// Winds between which waves begin on still water, m/s: friction velocities of 0.03 and 0.1 m/s
/// (Kahma and Donelan 1988).
const WAVE_WIND_SPEEDS: [f64; 2] = [1.0, 3.0];
/// Shortest wave that the wind's spectrum has, rad/m: viscosity stills what is shorter.
const MAX_WAVE_NUMBER: f64 = 400.0;
/// Steps of integrals over the spectrum.
const SPECTRUM_STEP_COUNT: usize = 400;

/// Angular frequency of a wave of `k` rad/m on deep water, rad/s.
pub(crate) fn frequency(k: f64) -> f64 {
    (GRAVITY * k + KINEMATIC_SURFACE_TENSION * k * k * k).sqrt()
}

/// Change of [`frequency`] with `k`: the speed of a group of waves, m/s.
fn group_speed(k: f64) -> f64 {
    (GRAVITY + 3.0 * KINEMATIC_SURFACE_TENSION * k * k) / (2.0 * frequency(k))
}

/// Period of the highest waves of a wind, m/s, over a fetch, m.
fn period(speed: f64, fetch: f64) -> f64 {
    0.286 * (GRAVITY * fetch / (speed * speed)).cbrt() * speed / GRAVITY
}

/// Waves that a wind makes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindWaves {
    /// Mean wind, m/s along the two level axes.
    wind: [f64; 2],
    /// Length of water, m.
    fetch: f64,
    /// The strongest wind of the whole time, m/s: the tile is as wide as its waves need.
    strongest: f64,
    /// Significant height, m.
    pub(crate) height: f64,
    /// Period of the highest waves, s.
    pub(crate) period: f64,
    /// Factor that gives the shape its height.
    scale: f64,
}

impl WindWaves {
    /// The waves of a mean wind, m/s along the two level axes, over so many metres of water; `None`
    /// for a wind that makes none. `strongest` is the strongest wind of the shot, m/s, so that one
    /// tile serves all of it.
    pub(crate) fn new(wind: [f64; 2], fetch: f64, strongest: f64) -> Option<Self> {
        let speed = wind[0].hypot(wind[1]);
        if speed <= WAVE_WIND_SPEEDS[0] || fetch <= 0.0 {
            return None;
        }
        let reach = GRAVITY * fetch / (speed * speed);
        let height = 0.0016 * reach.sqrt() * speed * speed / GRAVITY;
        let period = period(speed, fetch);
        let strongest = strongest.max(speed);
        let shaped = Self { wind, fetch, strongest, height, period, scale: 1.0 };
        let moment = shaped.over_waves(0.0, |_, power| power);
        let grown = Self { scale: (height / 4.0).powi(2) / moment, ..shaped };
        let risen =
            ((speed - WAVE_WIND_SPEEDS[0]) / (WAVE_WIND_SPEEDS[1] - WAVE_WIND_SPEEDS[0])).clamp(0.0, 1.0);
        let steepest = risen * risen * (3.0 - 2.0 * risen) * Self::open_slopes(speed);
        let share = (steepest / (2.0 * grown.slope_variance())).min(1.0);
        Some(Self { scale: share * grown.scale, height: share.sqrt() * height, ..grown })
    }

    /// Power of surface heights at an angular frequency, m^2 s.
    fn power(&self, w: f64) -> f64 {
        let peak = TAU / self.period;
        let width = if w <= peak { 0.07 } else { 0.09 };
        let bump = (-(w / peak - 1.0).powi(2) / (2.0 * width * width)).exp();
        self.scale * w.powi(-5) * (-1.25 * (peak / w).powi(4)).exp() * 3.3f64.powf(bump)
    }

    /// The integral of `f(k, power per dk)` over all waves from `from` rad/m on.
    fn over_waves(&self, from: f64, f: impl Fn(f64, f64) -> f64) -> f64 {
        let peak = self.peak();
        let (low, high) =
            ((0.2 * peak).max(from).min(MAX_WAVE_NUMBER).ln(), MAX_WAVE_NUMBER.max(4.0 * peak).ln());
        let step = (high - low) / SPECTRUM_STEP_COUNT as f64;
        (0..SPECTRUM_STEP_COUNT)
            .map(|i| {
                let k = (low + (i as f64 + 0.5) * step).exp();
                f(k, self.power(frequency(k)) * group_speed(k)) * k * step
            })
            .sum()
    }

    /// The highest waves, rad/m.
    fn peak(&self) -> f64 {
        let w = TAU / self.period;
        w * w / GRAVITY
    }

    /// Side of the tile that holds them, m: some twenty of the highest waves.
    fn tile_size(&self) -> f64 {
        let w = TAU / period(self.strongest, self.fetch);
        (22.0 * TAU * GRAVITY / (w * w)).clamp(2.0, 400.0)
    }

    /// Variance of slopes along one axis of waves that are too short for the tile.
    pub(crate) fn beyond_tile(&self) -> f32 {
        let finest = PI * TILE_SIDE_NODES as f64 / self.tile_size();
        (0.5 * self.over_waves(finest, |k, power| k * k * power)) as f32
    }

    /// Variance of slopes along one axis of all waves.
    pub(crate) fn slope_variance(&self) -> f64 {
        0.5 * self.over_waves(0.0, |k, power| k * k * power)
    }

    /// Mean square of the slopes of open water under a wind of `speed` m/s, both axes together (Cox
    /// and Munk 1954).
    pub(crate) fn open_slopes(speed: f64) -> f64 {
        CALM_SLOPE_VARIANCE + SLOPE_VARIANCE_PER_WIND * speed
    }

    /// The slopes of the waves at a time, s.
    pub(crate) fn slopes(&self, time: f64, seed: u64) -> SlopeTile {
        let size = self.tile_size();
        let key = [self.wind[0], self.wind[1], self.fetch, self.strongest].map(f64::to_bits);
        let field = WaveField::kept([key[0], key[1], key[2], key[3], seed], || {
            let cell = TAU / size;
            let speed = self.wind[0].hypot(self.wind[1]);
            let way = self.wind.map(|v| v / speed);
            WaveField::new(size, seed, |k| {
                let long = k[0].hypot(k[1]);
                let along = (k[0] * way[0] + k[1] * way[1]) / long;
                if along <= 0.0 {
                    return 0.0;
                }
                let spread = 2.0 / PI * along * along;
                let w = frequency(long);
                (0.5 * self.power(w) * group_speed(long) * spread / long).sqrt() * cell
            })
        });
        SlopeTile::new(size, field.slopes(time, 1.0).into_par_iter())
    }
}

/// Two waves that run opposite ways, as complex heights at time 0, m.
#[derive(Clone, Copy, Debug)]
struct WavePair {
    /// Column and row of the wave vector, and of its opposite.
    at: [[usize; 2]; 2],
    vector: [f64; 2],
    /// Heights of the wave along the vector, and of the one against it.
    heights: [[f64; 2]; 2],
    /// rad/s.
    frequency: f64,
}

/// A random field of waves on a tile.
#[derive(Clone, Debug, Default)]
pub(super) struct WaveField {
    pairs: Vec<WavePair>,
}

/// Fields that are kept, since frames of one shot share them: what is kept changes no number.
static FIELD_CACHE: Mutex<Vec<(FieldKey, Arc<WaveField>)>> = Mutex::new(Vec::new());
/// All that a field depends on.
type FieldKey = [u64; 5];
/// Most of them.
const MOST_KEPT: usize = 4;

impl WaveField {
    /// Waves on a tile of `size` metres. `amplitude` is the root of half the variance of heights
    /// that a wave vector (rad/m) brings, m.
    pub(crate) fn new(size: f64, seed: u64, amplitude: impl Fn([f64; 2]) -> f64 + Sync) -> Self {
        let (cell, half) = (TAU / size, TILE_SIDE_NODES as i64 / 2);
        let wave = |i: i64, j: i64| -> [f64; 2] {
            let strength = amplitude([i as f64 * cell, j as f64 * cell]);
            if strength == 0.0 {
                return [0.0; 2];
            }
            let index = 2 * ((j + half) as u64 * TILE_SIDE_NODES as u64 + (i + half) as u64);
            // Both parts are normal numbers of the variance of one half each.
            let long = strength * (-(1.0 - uniform(seed, index)).ln()).sqrt();
            let (sin, cos) = (TAU * uniform(seed, index + 1)).sin_cos();
            [long * cos, long * sin]
        };
        let place = |i: i64, j: i64| [i, j].map(|k| k.rem_euclid(TILE_SIDE_NODES as i64) as usize);
        let pair = |i: i64, j: i64| {
            let heights = [wave(i, j), wave(-i, -j)];
            let vector = [i as f64 * cell, j as f64 * cell];
            (heights != [[0.0; 2]; 2]).then(|| WavePair {
                at: [place(i, j), place(-i, -j)],
                vector,
                heights,
                frequency: frequency(vector[0].hypot(vector[1])),
            })
        };
        let rows = (0..half).into_par_iter().flat_map_iter(|j| {
            let first = if j == 0 { 1 } else { 1 - half };
            (first..half).filter_map(move |i| pair(i, j)).collect::<Vec<_>>()
        });
        Self { pairs: rows.collect() }
    }

    /// The field of a key, made once.
    pub(crate) fn kept(key: FieldKey, make: impl FnOnce() -> Self) -> Arc<Self> {
        let kept = || FIELD_CACHE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, field)) = kept().iter().find(|(own, _)| *own == key) {
            return Arc::clone(field);
        }
        let field = Arc::new(make());
        let mut all = kept();
        if all.len() >= MOST_KEPT {
            all.remove(0);
        }
        all.push((key, Arc::clone(&field)));
        field
    }

    /// Slopes at a time, s, `[TILE_SIDE_NODES, TILE_SIDE_NODES]`, times a factor.
    pub(crate) fn slopes(&self, time: f64, factor: f64) -> Vec<Complex> {
        let mut values: Vec<Complex> = vec![[0.0; 2]; TILE_SIDE_NODES * TILE_SIDE_NODES];
        for WavePair { at, vector, heights, frequency } in &self.pairs {
            let (sin, cos) = (frequency * time).sin_cos();
            let [[a, b], [c, d]] = heights;
            // h(k) exp(-i w t) + conj(h(-k)) exp(i w t).
            let re = factor * (a * cos + b * sin + c * cos + d * sin);
            let im = factor * (b * cos - a * sin - d * cos + c * sin);
            let [x, y] = vector;
            // i kx H + i (i ky H): slopes along x in the real part, along y in the imaginary one.
            let [[own_x, own_y], [other_x, other_y]] = at;
            values[own_y * TILE_SIDE_NODES + own_x] = [(-x * im - y * re) as f32, (x * re - y * im) as f32];
            values[other_y * TILE_SIDE_NODES + other_x] =
                [(-x * im + y * re) as f32, (-x * re - y * im) as f32];
        }
        transform(&mut values);
        values
    }
}
