//! A Poisson process in the whole of space, asked for by what a camera sees.
//!
//! Space is cut in cubes. What a cube holds follows from its key alone: points in the order of their thresholds, whose
//! gaps are exponential, so that those below any threshold are a Poisson process of that density.

use crate::dome::to_level;
use wm_render::hooks::ParticleView;

/// A sequence of random numbers as a pure function of its key.
#[derive(Clone, Copy, Debug)]
pub struct Draws(u64);

impl Draws {
    /// The numbers of a key.
    #[inline]
    #[must_use]
    pub fn new(key: u64) -> Self {
        Self(key)
    }

    /// The next 64 bits: SplitMix64.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mixed(self.0)
    }

    /// The next number, uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    /// The next gap between points of a process of density 1.
    #[inline]
    pub fn gap(&mut self) -> f64 {
        -(1.0 - self.uniform()).ln()
    }
}

/// Sine and cosine of a number of turns, within 2e-6.
#[inline]
#[must_use]
pub fn wave(turns: f64) -> [f64; 2] {
    // Of half the angle, by their series on a quarter turn either way, and doubled.
    let x = (turns - turns.round()) * std::f64::consts::PI;
    let q = x * x;
    let series = |terms: &[f64]| terms.iter().fold(0.0, |sum: f64, term| sum * q + term);
    let sin =
        x * series(&[-1.0 / 39_916_800.0, 1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0]);
    let cos = series(&[-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0]);
    [2.0 * sin * cos, (cos - sin) * (cos + sin)]
}

#[inline]
fn mixed(mut z: u64) -> u64 {
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// The cubes of one process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// Which process.
    pub key: u64,
    /// Edge of a cube, m.
    pub edge: f64,
    /// Points a m^3 up to a threshold of 1.
    pub density: f64,
}

/// Points that a cube holds on the average up to a threshold of 1, where that makes no cube too small or too large.
const TYPICAL: f64 = 12.0;
/// Shortest and longest edge, m.
const EDGES: [f64; 2] = [0.25, 8.0];

impl Cells {
    /// Cubes for a density, points a m^3.
    #[must_use]
    pub fn new(key: u64, density: f64) -> Self {
        let edge = (TYPICAL / density.max(1e-12)).cbrt().clamp(EDGES[0], EDGES[1]);
        Self { key, edge, density }
    }

    /// The points of a cube, in the order of their thresholds.
    #[inline]
    #[must_use]
    pub fn points(&self, cell: [i64; 3]) -> Points {
        let mut key = self.key;
        for index in cell {
            key = mixed(key ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03)).wrapping_add(0x9e37_79b9);
        }
        let volume = self.edge * self.edge * self.edge;
        Points { draws: Draws::new(key), step: 1.0 / (self.density * volume), threshold: 0.0 }
    }
}

/// The points of one cube, without end.
pub struct Points {
    draws: Draws,
    step: f64,
    threshold: f64,
}

/// A point.
pub struct Point {
    /// Whether it is there.
    pub threshold: f64,
    /// Where in its cube, 0-1.
    pub place: [f64; 3],
    /// Numbers of its own.
    pub draws: Draws,
}

impl Iterator for Points {
    type Item = Point;

    #[inline]
    fn next(&mut self) -> Option<Point> {
        self.threshold += self.step * self.draws.gap();
        // A sequence of its own, so that how many numbers one takes changes no other.
        let mut draws = Draws::new(self.draws.bits());
        let place = [draws.uniform(), draws.uniform(), draws.uniform()];
        Some(Point { threshold: self.threshold, place, draws })
    }
}

/// What a camera sees up to a distance, in level axes and metres from its centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Cone {
    /// Normals of planes through the camera, into the view, length 1: its four sides and the one that it looks along.
    pub planes: [[f64; 3]; 5],
    /// The camera's centre, m, where the process stands still.
    pub center: [f64; 3],
    /// Farthest, m.
    pub range: f64,
    /// How far outside points may lie, m.
    pub margin: f64,
}

impl Cone {
    /// The planes of a view; `axes` are the level ones, world axes.
    #[must_use]
    pub fn planes(view: &ParticleView, axes: &[[f64; 3]; 3]) -> [[f64; 3]; 5] {
        let turned = |n: [f32; 3]| to_level(axes, n.map(f64::from));
        let [a, b, c, d] = view.sides.map(turned);
        [a, b, c, d, turned(view.rotation[2])]
    }

    /// Whether a point, m from the camera, is within, or nearer to it than the margin.
    #[inline]
    #[must_use]
    pub fn holds(&self, at: &[f64; 3]) -> bool {
        self.planes.iter().all(|n| n[0] * at[0] + n[1] * at[1] + n[2] * at[2] > -self.margin)
    }

    /// The numbers of the slices of cubes along the first axis.
    #[must_use]
    pub fn slices(&self, edge: f64) -> std::ops::Range<i64> {
        let (low, high) = self.bounds(0, [None, None]);
        let index = |v: f64| ((self.center[0] + v) / edge).floor() as i64;
        if low > high { 0..0 } else { index(low)..index(high) + 1 }
    }

    /// Least and greatest coordinate along an axis of what is within, given intervals of those before it.
    fn bounds(&self, axis: usize, known: [Option<[f64; 2]>; 2]) -> (f64, f64) {
        let reach = self.range + self.margin;
        // Farthest that the ball goes where the others are nearest to 0.
        let nearest = |interval: [f64; 2]| interval[0].max(0.0) + (-interval[1]).max(0.0);
        let used: f64 = known.iter().flatten().map(|interval| nearest(*interval).powi(2)).sum();
        let most = (reach * reach - used).max(0.0).sqrt();
        let (mut low, mut high) = if used > reach * reach { (1.0, -1.0) } else { (-most, most) };
        for n in &self.planes {
            // n . p >= -margin, with the free axes anywhere in the ball.
            let mut rest = self.margin;
            for k in 0..3 {
                rest += match known.get(k).copied().flatten().filter(|_| k < axis) {
                    Some([from, to]) => (n[k] * from).max(n[k] * to),
                    None if k == axis => 0.0,
                    None => n[k].abs() * reach,
                };
            }
            if n[axis] > 1e-9 {
                low = low.max(-rest / n[axis]);
            } else if n[axis] < -1e-9 {
                high = high.min(-rest / n[axis]);
            } else if rest < 0.0 {
                high = low - 1.0;
            }
        }
        (low, high)
    }

    /// Calls `visit` with each cube of a slice that may be within: its indices, and its first corner from the camera, m.
    pub fn each_cell(&self, edge: f64, slice: i64, mut visit: impl FnMut([i64; 3], [f64; 3])) {
        let from = |k: usize, index: i64| index as f64 * edge - self.center[k];
        let index = |k: usize, v: f64| ((self.center[k] + v) / edge).floor() as i64;
        let x = from(0, slice);
        let first = Some([x, x + edge]);
        let (low, high) = self.bounds(1, [first, None]);
        if low > high {
            return;
        }
        for column in index(1, low)..=index(1, high) {
            let y = from(1, column);
            let (low, high) = self.bounds(2, [first, Some([y, y + edge])]);
            if low > high {
                continue;
            }
            for layer in index(2, low)..=index(2, high) {
                visit([slice, column, layer], [x, y, from(2, layer)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_scene::Camera;

    #[test]
    fn waves_are_sines() {
        for i in -3000..3000 {
            let turns = f64::from(i) * 0.001_37;
            let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
            let [s, c] = wave(turns);
            assert!((s - sin).abs() < 2e-6 && (c - cos).abs() < 2e-6, "{turns}: {s} {c}");
        }
    }

    #[test]
    fn cubes_hold_what_their_density_says() {
        let cells = Cells::new(5, 20.0);
        let count = |threshold: f64| -> Vec<f64> {
            (0..4000)
                .map(|i| cells.points([i, -i, 3]).take_while(|p| p.threshold < threshold).count() as f64)
                .collect()
        };
        for threshold in [0.3, 1.0, 2.5] {
            let counts = count(threshold);
            let wanted = threshold * 20.0 * cells.edge.powi(3);
            let mean = counts.iter().sum::<f64>() / 4000.0;
            let variance = counts.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 4000.0;
            // A Poisson process: mean and variance are equal; four standard errors of 4,000 cubes.
            assert!((mean - wanted).abs() < 4.0 * (wanted / 4000.0).sqrt(), "{mean} {wanted}");
            assert!((variance / wanted - 1.0).abs() < 0.1, "{variance} {wanted}");
        }
        let again: Vec<f64> = cells.points([7, 8, 9]).take(5).map(|p| p.threshold).collect();
        assert!(again.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn every_point_in_view_is_in_a_visited_cube() {
        for (eye, towards) in [(DVec3::new(0.3, 0.2, 1.0), DVec3::new(9.0, 4.0, -2.0)), (DVec3::Z, -DVec3::X)]
        {
            let camera = Camera::look_at((90, 60), 55.0, eye, eye + towards, DVec3::Z).unwrap();
            let view = ParticleView::new(&camera);
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let cone = Cone {
                planes: Cone::planes(&view, &axes),
                center: [123.4, -56.7, 8.9],
                range: 6.0,
                margin: 0.05,
            };
            let edge = 0.7;
            let mut visited = std::collections::HashSet::new();
            for slice in cone.slices(edge) {
                cone.each_cell(edge, slice, |cell, corner| {
                    assert!((corner[1] + cone.center[1] - cell[1] as f64 * edge).abs() < 1e-9);
                    assert!(visited.insert(cell));
                });
            }
            let (mut seen, mut all) = (0, 0);
            for i in 0..60_000u64 {
                let p = [0, 1, 2].map(|k| 14.0 * wm_scene::synthetic::uniform(k, i) - 7.0);
                all += 1;
                let is_near = p.iter().map(|v| v * v).sum::<f64>() < 36.0;
                let Some((x, y, _)) = camera.project(eye + DVec3::from_array(p)).filter(|_| is_near) else {
                    continue;
                };
                if x >= 0.0 && y >= 0.0 && x < 90.0 && y < 60.0 {
                    seen += 1;
                    let cell = [0, 1, 2].map(|k| ((cone.center[k] + p[k]) / edge).floor() as i64);
                    assert!(visited.contains(&cell), "{p:?}");
                }
            }
            // And not many more: the cubes at the sides of a cone this narrow are about as many as those inside.
            let volume = 14f64.powi(3) * f64::from(seen) / f64::from(all);
            let cubes = visited.len() as f64 * edge.powi(3);
            assert!(cubes < 3.0 * volume, "{cubes} m^3 for {volume}");
        }
    }
}
