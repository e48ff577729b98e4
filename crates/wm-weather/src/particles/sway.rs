//! Flakes sway: each by itself, and with those near it.

use super::random::{uniform, wave};
use crate::lanes::TWO_23;
use fearless_simd::{SimdBase, SimdFloat};
use std::f64::consts::TAU;
use wm_render::simd::Lanes;

/// Swaying by itself: speed sideways, m/s, and frequency, Hz, from and to.
const SWAY_SPEEDS: [f64; 2] = [0.15, 0.5];
const SWAY_FREQUENCIES_HZ: [f64; 2] = [0.5, 1.5];
/// Frequencies that flakes may have, as a power of 2: so few that turns of any time stay exact in
/// 32 bits.
const FREQUENCY_COUNT_LOG2: u32 = 12;

/// A wave in which flakes near each other sway together.
struct Eddy {
    /// Amplitude, m.
    reach: f64,
    /// Wavelength, m, along `from`.
    length: f64,
    /// s.
    period: f64,
    from: [f64; 2],
}

impl Eddy {
    /// Direction of the swaying: across the wave, since air does not compress. So flakes crowd
    /// nowhere, up to products of two waves' slopes (7 % of the density, root mean square).
    fn to(&self) -> [f64; 2] {
        [-self.from[1], self.from[0]]
    }
}

/// Waves of some metres, in all directions.
const EDDIES: [Eddy; 4] = [
    Eddy { reach: 0.12, length: 2.3, period: 2.9, from: [1.0, 0.0] },
    Eddy { reach: 0.2, length: 4.1, period: 4.3, from: [-0.13, 0.99] },
    Eddy { reach: 0.3, length: 7.7, period: 6.7, from: [-0.97, -0.26] },
    Eddy { reach: 0.4, length: 13.0, period: 9.1, from: [0.38, -0.93] },
];

/// Ratio of the waves' phase change going up to that sideways.
const VERTICAL_PHASE_RATIO: f64 = 0.6;

/// Farthest that a flake sways, m.
pub(crate) fn farthest() -> f64 {
    EDDIES.iter().map(|eddy| eddy.reach).sum::<f64>() + SWAY_SPEEDS[1] / (TAU * SWAY_FREQUENCIES_HZ[0])
}

/// Phases of the waves at a place, 0-1.
pub(crate) type SwayPhases = [f32; EDDIES.len()];

/// Swaying at one instant of all flakes that fall alike.
pub(crate) struct Sway {
    time: f64,
    /// Turns of the slowest flake, and how many more those of the next frequency are: shares of
    /// 2^32.
    turns: [u32; 2],
}

impl Sway {
    /// At `time`, s.
    pub(crate) fn new(time: f64) -> Self {
        let step =
            (SWAY_FREQUENCIES_HZ[1] - SWAY_FREQUENCIES_HZ[0]) / f64::from(1u32 << FREQUENCY_COUNT_LOG2);
        Self { time, turns: [SWAY_FREQUENCIES_HZ[0] * time, step * time].map(whole_turns) }
    }

    /// Returns the phases of the waves at `at`, m, in the flakes' own axes that do not move, 0-1.
    pub(crate) fn phases(&self, at: &[f64; 3]) -> SwayPhases {
        std::array::from_fn(|k| {
            let Eddy { length, period, from: [x, y], .. } = EDDIES[k];
            let turns = (at[0] * x + at[1] * y + VERTICAL_PHASE_RATIO * at[2]) / length + self.time / period;
            (turns - turns.floor()) as f32
        })
    }

    /// Moves flakes from `at` (level axes, m) and adds to their velocities, m/s. `phases` are those
    /// of a place that they are `from` away from, m; `own` are two numbers of each.
    #[inline(always)]
    pub(crate) fn apply<S: Lanes>(
        &self,
        simd: S,
        phases: &SwayPhases,
        from: &[S::F; 3],
        own: [S::U; 2],
        at: &mut [S::F; 3],
        velocity: &mut [S::F; 3],
    ) {
        // The upper bits are the frequency, those below the speed.
        let number = own[0] >> (32 - FREQUENCY_COUNT_LOG2);
        let share = uniform(simd, own[0] << FREQUENCY_COUNT_LOG2);
        let speed = share
            .mul_add(simd.set((SWAY_SPEEDS[1] - SWAY_SPEEDS[0]) as f32), simd.set(SWAY_SPEEDS[0] as f32));
        let turns = number * S::U::splat(simd, self.turns[1]) + own[1] + S::U::splat(simd, self.turns[0]);
        let [sin, cos] = wave(simd, uniform(simd, turns));
        // The mantissa of 2^23 holds a whole number below it: their sum.
        let number = S::F::from_bits(number | S::U::splat(simd, TWO_23.to_bits())) - TWO_23;
        let step = ((SWAY_FREQUENCIES_HZ[1] - SWAY_FREQUENCIES_HZ[0])
            / f64::from(1u32 << FREQUENCY_COUNT_LOG2)) as f32;
        let rate = number.mul_add(simd.set(step), simd.set(SWAY_FREQUENCIES_HZ[0] as f32)) * TAU as f32;
        let reach = speed / rate;
        at[0] = reach.mul_add(sin, at[0]);
        at[1] -= reach * cos;
        velocity[0] = speed.mul_add(cos, velocity[0]);
        velocity[1] = speed.mul_add(sin, velocity[1]);
        for (eddy, phase) in EDDIES.iter().zip(phases) {
            let [x, y] = eddy.from.map(|v| (v / eddy.length) as f32);
            let rise = (VERTICAL_PHASE_RATIO / eddy.length) as f32;
            let turns = from[0].mul_add(
                simd.set(x),
                from[1].mul_add(simd.set(y), from[2].mul_add(simd.set(rise), simd.set(*phase))),
            );
            let [sin, cos] = wave(simd, turns);
            for k in 0..2 {
                let reach = eddy.reach * eddy.to()[k];
                at[k] = sin.mul_add(simd.set(reach as f32), at[k]);
                velocity[k] = cos.mul_add(simd.set((TAU / eddy.period * reach) as f32), velocity[k]);
            }
        }
    }
}

/// The part of a number of turns behind the point, as a share of 2^32.
fn whole_turns(turns: f64) -> u32 {
    ((turns - turns.floor()) * 4_294_967_296.0) as u64 as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::random::RandomSequence;
    use wm_render::dispatch;
    use wm_render::simd::SimdPath;

    #[inline(always)]
    fn moved<S: Lanes>(simd: S, sway: &Sway, from: [f64; 3], own: [u32; 2]) -> [[f64; 3]; 2] {
        let phases = sway.phases(&from.map(f64::floor));
        let mut at = from.map(|v| simd.set((v - v.floor()) as f32));
        let (within, mut velocity) = (at, [simd.set(0.0); 3]);
        let own = own.map(|v| S::U::splat(simd, v));
        sway.apply(simd, &phases, &within, own, &mut at, &mut velocity);
        [std::array::from_fn(|k| f64::from(at[k][0]) + from[k].floor()), velocity.map(|v| f64::from(v[0]))]
    }

    #[test]
    fn flakes_go_where_their_velocity_says() {
        let mut draws = RandomSequence::new(1);
        let (mut most, mut farthest_seen) = (0.0f64, 0.0f64);
        for path in SimdPath::available() {
            for _ in 0..2000 {
                let from = [0, 1, 2].map(|_| 400.0 * draws.uniform() - 200.0);
                let own = [draws.bits() as u32, draws.bits() as u32];
                // Up to a day.
                let (time, step) = (86_400.0 * draws.uniform(), 0.01);
                let [first, second] = [time - step, time + step].map(|time| {
                    let sway = Sway::new(time);
                    dispatch!(path, s => moved(s, &sway, from, own))
                });
                let sway = Sway::new(time);
                let [middle, velocity] = dispatch!(path, s => moved(s, &sway, from, own));
                for k in 0..3 {
                    let went = (second[0][k] - first[0][k]) / (2.0 * step);
                    assert!((went - velocity[k]).abs() < 0.02, "{path} {time}: {went} for {}", velocity[k]);
                    most = most.max(velocity[k].abs());
                }
                let far = (0..3).map(|k| (middle[k] - from[k]).powi(2)).sum::<f64>().sqrt();
                farthest_seen = farthest_seen.max(far);
            }
        }
        assert!(farthest_seen < farthest() && most > 0.5, "{farthest_seen} {most}");
    }

    #[test]
    fn flakes_do_not_crowd() {
        let (mut draws, path) = (RandomSequence::new(2), SimdPath::available()[0]);
        let own = [draws.bits() as u32, draws.bits() as u32];
        let (sway, step, count) = (Sway::new(3.0), 0.02, 2000);
        let mut squares = 0.0;
        for _ in 0..count {
            // From the middle of a metre, so that no step leaves it.
            let from = [0, 1, 2].map(|_| (60.0 * draws.uniform()).floor() + 0.5);
            let slope = |axis: usize| {
                let [low, high] = [-step, step].map(|step| {
                    let mut from = from;
                    from[axis] += step;
                    dispatch!(path, s => moved(s, &sway, from, own))[0]
                });
                [0, 1].map(|k| (high[k] - low[k]) / (2.0 * step))
            };
            let [x, y] = [slope(0), slope(1)];
            // The volume that the flakes of one are spread over.
            let volume = x[0] * y[1] - x[1] * y[0];
            squares += (volume - 1.0).powi(2) / f64::from(count);
        }
        assert!(squares.sqrt() < 0.1, "{}", squares.sqrt());
    }
}
