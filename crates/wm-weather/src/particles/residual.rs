//! Extinction of the air by drops that are not drawn one by one.
//!
//! The law for all of them is `sigma_t`. Of each class up to its own distance the drawn drops take
//! their share; the air takes the rest, so that the optical depth of both over `s` metres is
//! `sigma_t s`.

use fearless_simd::{SimdBase, SimdFloat};
use wm_render::simd::Lanes;

/// End of drawing, as shares of a class's distance: everything up to the first, nothing beyond the
/// second.
pub(crate) const FADE_DISTANCE_SHARES: [f64; 2] = [0.85, 1.15];
/// Least distance at which anything is drawn, m.
pub(crate) const MIN_DISTANCE_M: f64 = 0.1;
/// Nodes of the table, 8 equal steps for a factor of 2, from `2^FIRST` m to `2^LAST`.
pub(crate) const NODES: usize = 8 * (LAST_LOG2 - FIRST_LOG2) as usize;
const FIRST_LOG2: i32 = -3;
const LAST_LOG2: i32 = 17;
/// The first node, m.
pub(crate) const NEAREST_NODE: f32 = 0.125;
/// Largest distance in the table, m, just below the last node: nothing is drawn beyond.
pub(crate) const FARTHEST_NODE: f32 = 131_072.0 * (1.0 - f32::EPSILON);

/// The integral of the drawn share over distances from 0.
fn faded(distance: f64) -> f64 {
    let [begin, end] = FADE_DISTANCE_SHARES;
    let over = (distance.min(end) - begin).max(0.0);
    distance.min(begin) + over - 0.5 * over * over / (end - begin)
}

/// The optical depth of drawn particles over distance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Residual {
    /// Cross-section a m^3 and distance, 1/m and m, of each class.
    drawn: Vec<[f64; 2]>,
    /// Radiance of an endless path, linear RGB.
    pub(crate) airlight: [f64; 3],
    /// Mean extinction up to each node, 1/m, and how much more it is at the next.
    pub(crate) table: [[f32; 2]; NODES],
}

impl Residual {
    /// Builds the table for classes with a cross-section a m^3 (1/m) that are drawn up to a
    /// distance (m).
    pub(crate) fn new(drawn: Vec<[f64; 2]>, airlight: [f64; 3]) -> Self {
        let mut residual = Self { drawn, airlight, table: [[0.0; 2]; NODES] };
        // The mean extinction: between two nodes it is nearly straight.
        let mean = |node: usize| {
            let metres = 2f64.powi(FIRST_LOG2 + node as i32 / 8) * (1.0 + (node % 8) as f64 / 8.0);
            residual.depth(metres) / metres
        };
        let table = std::array::from_fn(|node| [mean(node), mean(node + 1) - mean(node)].map(|v| v as f32));
        residual.table = table;
        residual
    }

    /// Optical depth of what is drawn over `metres`.
    pub(crate) fn depth(&self, metres: f64) -> f64 {
        self.drawn
            .iter()
            .map(|[cover, range]| cover * (range * faded(metres / range) - MIN_DISTANCE_M).max(0.0))
            .sum()
    }

    /// [`Self::depth`] from the table, within 1 % of it.
    #[inline(always)]
    pub(crate) fn tabled<S: Lanes>(&self, simd: S, metres: S::F) -> S::F {
        const ONE_BITS: u32 = 0x3f80_0000;
        let metres = metres.min(simd.set(FARTHEST_NODE));
        // A float's exponent and its next three bits are the number of its node.
        let bits = metres.max(simd.set(NEAREST_NODE)).to_bits();
        let share =
            S::F::from_bits((bits & S::U::splat(simd, 0xf_ffff)) << 3 | S::U::splat(simd, ONE_BITS)) - 1.0;
        let nodes = (bits >> 20) - S::U::splat(simd, (ONE_BITS >> 20).wrapping_add_signed(8 * FIRST_LOG2));
        let (mut mean, mut more) = ([0.0; 16], [0.0; 16]);
        for (lane, node) in nodes.as_slice().iter().enumerate() {
            [mean[lane], more[lane]] = self.table[(*node as usize).min(NODES - 1)];
        }
        simd.load(&more).mul_add(share, simd.load(&mean)) * metres
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::dispatch;
    use wm_render::simd::SimdPath;

    /// Returns the share of a class that is drawn at `distance`, in units of the class's own
    /// distance.
    fn fade(distance: f64) -> f64 {
        ((FADE_DISTANCE_SHARES[1] - distance) / (FADE_DISTANCE_SHARES[1] - FADE_DISTANCE_SHARES[0]))
            .clamp(0.0, 1.0)
    }

    #[inline(always)]
    fn tabled<S: Lanes>(simd: S, residual: &Residual, metres: f64) -> f32 {
        residual.tabled(simd, simd.set(metres as f32))[0]
    }

    #[test]
    fn the_table_is_the_sum() {
        let drawn = (1..30).map(|i| [1e-4 / f64::from(i), 0.5 * f64::from(i)]).collect();
        let residual = Residual::new(drawn, [1.0; 3]);
        let path = SimdPath::available()[0];
        let tabled = |metres: f64| dispatch!(path, s => tabled(s, &residual, metres));
        // Numerically: what is drawn along the way.
        let (mut sum, step) = (0.0, 1e-3);
        for i in 0..40_000 {
            let at = (f64::from(i) + 0.5) * step;
            let is_drawn = at > MIN_DISTANCE_M;
            sum += if is_drawn { step } else { 0.0 }
                * residual.drawn.iter().map(|[cover, range]| cover * fade(at / range)).sum::<f64>();
            if i % 4000 == 3999 {
                let (exact, tabled) = (residual.depth(at + 0.5 * step), tabled(at + 0.5 * step));
                assert!((exact / sum - 1.0).abs() < 1e-6, "{at}: {exact} {sum}");
                assert!((f64::from(tabled) / sum - 1.0).abs() < 0.01, "{at}: {tabled} {sum}");
            }
        }
        assert_eq!(tabled(1e7), tabled(1e6));
        assert_eq!(tabled(0.0), 0.0);
        assert_eq!(NEAREST_NODE, 2f32.powi(FIRST_LOG2));
        assert_eq!(FARTHEST_NODE, 2f32.powi(LAST_LOG2) * (1.0 - f32::EPSILON));
    }
}
