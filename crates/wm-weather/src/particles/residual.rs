//! What of falling drops is not drawn: extinction of the air.
//!
//! The law for all of them is `sigma_t`. Of each class up to its own distance the drawn drops take their
//! share; the air takes the rest, so that the optical depth of both over `s` metres is `sigma_t s`.

/// Where drawing ends, as a share of a class's distance: whole up to the first, nothing beyond the second.
pub const FADE: [f64; 2] = [0.85, 1.15];
/// Nearest that anything is drawn, m.
pub const NEAREST: f64 = 0.1;
/// Nodes of the table, `OCTAVE` for a factor of 2, from `2^FIRST` m on.
const NODES: usize = 120;
const OCTAVE: usize = 6;
const FIRST: i32 = -3;

/// How much of a class is drawn at `distance`, in units of its own.
#[must_use]
pub fn fade(distance: f64) -> f64 {
    ((FADE[1] - distance) / (FADE[1] - FADE[0])).clamp(0.0, 1.0)
}

/// The integral of [`fade`] from 0.
fn faded(distance: f64) -> f64 {
    let [begin, end] = FADE;
    let over = (distance.min(end) - begin).max(0.0);
    distance.min(begin) + over - 0.5 * over * over / (end - begin)
}

/// What is drawn, as an optical depth over distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Cross-section a m^3 and distance, 1/m and m, of each class.
    drawn: Vec<[f64; 2]>,
    /// Radiance of an endless path, linear RGB.
    airlight: [f64; 3],
    table: [f32; NODES],
}

impl Residual {
    /// Of classes with a cross-section a m^3 (1/m) that are drawn up to a distance (m).
    #[must_use]
    pub fn new(drawn: Vec<[f64; 2]>, airlight: [f64; 3]) -> Self {
        let mut residual = Self { drawn, airlight, table: [0.0; NODES] };
        for node in 0..NODES {
            // The mean extinction up to there: between two nodes it is nearly straight.
            let metres = 2f64.powf(f64::from(FIRST) + node as f64 / OCTAVE as f64);
            residual.table[node] = (residual.depth(metres) / metres) as f32;
        }
        residual
    }

    /// Optical depth of what is drawn over `metres`.
    #[must_use]
    pub fn depth(&self, metres: f64) -> f64 {
        self.drawn
            .iter()
            .map(|[cover, range]| cover * (range * faded(metres / range) - NEAREST).max(0.0))
            .sum()
    }

    /// Radiance of an endless path, linear RGB.
    #[must_use]
    pub fn airlight(&self) -> [f64; 3] {
        self.airlight
    }

    /// [`Self::depth`] from the table, within 1 % of it.
    #[inline]
    #[must_use]
    pub fn tabled(&self, metres: f32) -> f32 {
        let place = (OCTAVE as f32 * (metres.max(1e-6).log2() - FIRST as f32)).clamp(0.0, (NODES - 1) as f32);
        let node = (place as usize).min(NODES - 2);
        let share = place - node as f32;
        let mean = self.table[node] + share * (self.table[node + 1] - self.table[node]);
        // Beyond the last node nothing more is drawn.
        mean * metres.min(2f32.powf(FIRST as f32 + (NODES - 1) as f32 / OCTAVE as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_sum() {
        let drawn = (1..30).map(|i| [1e-4 / f64::from(i), 0.5 * f64::from(i)]).collect();
        let residual = Residual::new(drawn, [1.0; 3]);
        // Numerically: what is drawn along the way.
        let (mut sum, step) = (0.0, 1e-3);
        for i in 0..40_000 {
            let at = (f64::from(i) + 0.5) * step;
            let is_drawn = at > NEAREST;
            sum += if is_drawn { step } else { 0.0 }
                * residual.drawn.iter().map(|[cover, range]| cover * fade(at / range)).sum::<f64>();
            if i % 4000 == 3999 {
                let (exact, tabled) =
                    (residual.depth(at + 0.5 * step), residual.tabled((at + 0.5 * step) as f32));
                assert!((exact / sum - 1.0).abs() < 1e-6, "{at}: {exact} {sum}");
                assert!((f64::from(tabled) / sum - 1.0).abs() < 0.01, "{at}: {tabled} {sum}");
            }
        }
        assert_eq!(residual.tabled(1e7), residual.tabled(1e6));
        assert_eq!(residual.tabled(0.0), 0.0);
    }
}
