//! Waves that the wind makes on water of a limited fetch.
//!
//! JONSWAP's growth (Hasselmann and others 1973): `Hs = 0.0016 sqrt(g F / U^2) U^2 / g`, `Tp = 0.286 (g F / U^2)^(1/3) U /
//! g`, for a wind `U` over a fetch `F`; the shape `S(w) ~ w^-5 exp(-1.25 (w / wp)^-4) 3.3^r`, and `2/pi cos^2` about the
//! wind's heading. Waves go by the dispersion law of deep water with surface tension, `w^2 = g k + (tension / density) k^3`.

use super::fft::{Complex, SIDE, transform};
use super::tile::SlopeTile;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use wm_scene::random::uniform;

/// Acceleration of free fall, m/s^2.
const GRAVITY: f64 = 9.81;
/// Surface tension of water over its density, m^3/s^2.
const TENSION: f64 = 7.28e-5;
/// Shortest wave that the wind's spectrum has, rad/m: viscosity stills what is shorter.
const SHORTEST: f64 = 400.0;
/// Steps of integrals over the spectrum.
const STEPS: usize = 400;

/// Angular frequency of a wave of `k` rad/m on deep water, rad/s.
#[must_use]
pub fn frequency(k: f64) -> f64 {
    (GRAVITY * k + TENSION * k * k * k).sqrt()
}

/// Change of [`frequency`] with `k`: the speed of a group of waves, m/s.
fn group_speed(k: f64) -> f64 {
    (GRAVITY + 3.0 * TENSION * k * k) / (2.0 * frequency(k))
}

/// Waves that a wind makes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindWaves {
    /// Mean wind, m/s along the two level axes.
    wind: [f64; 2],
    /// Significant height, m.
    pub height: f64,
    /// Period of the highest waves, s.
    pub period: f64,
    /// Factor that gives the shape its height.
    scale: f64,
}

impl WindWaves {
    /// The waves of a mean wind, m/s along the two level axes, over so many metres of water; `None` without wind.
    #[must_use]
    pub fn new(wind: [f64; 2], fetch: f64) -> Option<Self> {
        let speed = wind[0].hypot(wind[1]);
        if speed < 0.1 || fetch <= 0.0 {
            return None;
        }
        let reach = GRAVITY * fetch / (speed * speed);
        let height = 0.0016 * reach.sqrt() * speed * speed / GRAVITY;
        let period = 0.286 * reach.cbrt() * speed / GRAVITY;
        let shaped = Self { wind, height, period, scale: 1.0 };
        let moment = shaped.over_waves(0.0, |_, power| power);
        Some(Self { scale: (height / 4.0).powi(2) / moment, ..shaped })
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
        let (low, high) = ((0.2 * peak).max(from).min(SHORTEST).ln(), SHORTEST.max(4.0 * peak).ln());
        let step = (high - low) / STEPS as f64;
        (0..STEPS)
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
    #[must_use]
    pub fn tile_size(&self) -> f64 {
        (22.0 * TAU / self.peak()).clamp(2.0, 400.0)
    }

    /// Variance of slopes along one axis of waves that are too short for the tile.
    #[must_use]
    pub fn beyond_tile(&self) -> f32 {
        let finest = PI * SIDE as f64 / self.tile_size();
        (0.5 * self.over_waves(finest, |k, power| k * k * power)) as f32
    }

    /// Variance of slopes along one axis of all waves.
    #[must_use]
    pub fn slope_variance(&self) -> f64 {
        0.5 * self.over_waves(0.0, |k, power| k * k * power)
    }

    /// Their slopes at a time, s.
    #[must_use]
    pub fn slopes(&self, time: f64, seed: u64) -> SlopeTile {
        let size = self.tile_size();
        let cell = TAU / size;
        let speed = self.wind[0].hypot(self.wind[1]);
        let way = self.wind.map(|v| v / speed);
        let amplitude = |k: [f64; 2]| {
            let long = k[0].hypot(k[1]);
            let along = (k[0] * way[0] + k[1] * way[1]) / long;
            let spread = if along > 0.0 { 2.0 / PI * along * along } else { 0.0 };
            let w = frequency(long);
            (0.5 * self.power(w) * group_speed(long) * spread / long).sqrt() * cell
        };
        SlopeTile::new(size, field(size, time, seed, amplitude).into_par_iter())
    }
}

/// Slopes of a random field of waves at a time, `[SIDE, SIDE]`. `amplitude` is the root of half the variance of heights that
/// each wave vector (rad/m) brings, m.
pub(super) fn field(
    size: f64,
    time: f64,
    seed: u64,
    amplitude: impl Fn([f64; 2]) -> f64 + Sync,
) -> Vec<Complex> {
    let cell = TAU / size;
    let half = SIDE as i64 / 2;
    let signed = |i: usize| if (i as i64) < half { i as i64 } else { i as i64 - SIDE as i64 };
    // The wave of a vector, at its phase.
    let wave = |i: i64, j: i64| -> [f64; 2] {
        let k = [i as f64 * cell, j as f64 * cell];
        let strength = amplitude(k);
        if strength == 0.0 {
            return [0.0; 2];
        }
        let index = 2 * (((j + half) as u64) * SIDE as u64 + (i + half) as u64);
        // Of two uniform numbers: a normal one in each of two parts.
        let long = strength * (-(1.0 - uniform(seed, index)).ln()).sqrt();
        let phase = TAU * uniform(seed, index + 1) - frequency(k[0].hypot(k[1])) * time;
        let (sin, cos) = phase.sin_cos();
        [long * cos, long * sin]
    };
    let mut values: Vec<Complex> = vec![[0.0; 2]; SIDE * SIDE];
    values.par_chunks_exact_mut(SIDE).enumerate().for_each(|(row, line)| {
        for (column, value) in line.iter_mut().enumerate() {
            let (i, j) = (signed(column), signed(row));
            // Waves without a partner that runs the other way have no real slope.
            if (i == 0 && j == 0) || i == -half || j == -half {
                continue;
            }
            let (own, other) = (wave(i, j), wave(-i, -j));
            let height = [own[0] + other[0], own[1] - other[1]];
            let [kx, ky] = [i as f64 * cell, j as f64 * cell];
            // i kx H + i (i ky H): slopes along x in the real part, along y in the imaginary one.
            *value = [(-kx * height[1] - ky * height[0]) as f32, (kx * height[0] - ky * height[1]) as f32];
        }
    });
    transform(&mut values);
    values
}
