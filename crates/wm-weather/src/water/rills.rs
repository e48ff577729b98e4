//! Thin streams of water on slopes, and the waves that run down them.
//!
//! A film that runs downhill breaks into waves whose crests lie across the slope. Their phase is
//! the height of the ground, so that crests follow the ground and all waves run downhill, and bumps
//! of the ground shift it; so a wave is a function of place and time alone.

use crate::wetness::smooth_noise;
use std::f64::consts::TAU;

/// Lengths of the waves, m, the speed at which they run, m/s, and their slopes, amplitudes.
const RILL_WAVES: [[f64; 3]; 3] = [[0.16, 0.34, 0.045], [0.095, 0.29, 0.04], [0.055, 0.25, 0.035]];
/// Width of the bumps by which phases are shifted, m, and by how many waves.
const BUMP_WIDTH_M: f64 = 0.22;
const PHASE_SHIFT_WAVES: f64 = 1.1;
/// Nodes to each side over which the slope of the ground is taken.
const SLOPE_RADIUS_NODES: usize = 2;
const BUMP_SEED: u64 = 0x5249_4c4c;

/// The streams of a place, on the nodes of its [`WaterGrid`](super::WaterGrid).
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Rills {
    /// Share of the ground under running water at each node, 0-1.
    strength: Vec<f32>,
    /// Heights of the ground, m; not a number where there is none.
    ground: Vec<f32>,
    /// Gradient of the ground about a node along the two level axes; 0 where it is not known, and
    /// where nothing runs.
    uphill: Vec<[f32; 2]>,
    /// The mean of that under the streams.
    usual: f64,
    /// Slope of the ground under the streams in the mean, from node to node.
    slope: f64,
}

/// Slopes of a piece of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Slope {
    /// Mean slopes along the two level axes.
    pub(crate) mean: [f32; 2],
    /// Variance within the piece along one axis.
    pub(crate) variance: f32,
}

/// The nodes of a grid: the first one, m, their distance, m, and their columns and rows.
pub(super) type Nodes = ([f64; 2], f64, [usize; 2]);

impl Rills {
    /// The streams of these strengths on some ground; `None` if there are none.
    pub(crate) fn new(strength: Vec<f32>, ground: Vec<f32>, step: f64, columns: usize) -> Option<Self> {
        let (mut sum, mut weights) = (0.0, 0.0);
        let is_running = |at: usize| strength[at] > 0.0 && at % columns + 1 < columns;
        for (at, own) in strength.iter().enumerate().filter(|(at, _)| is_running(*at)) {
            let beside = [at + 1, at + columns].map(|next| ground.get(next).map(|next| next - ground[at]));
            if let [Some(along), Some(across)] = beside
                && (along + across).is_finite()
            {
                sum += f64::from(own * along.hypot(across));
                weights += f64::from(*own);
            }
        }
        (weights > 0.0).then(|| {
            let uphill = uphill(&strength, &ground, step as f32, columns);
            let (mut rise, mut under) = (0.0, 0.0);
            for (own, [x, y]) in strength.iter().zip(&uphill).filter(|(_, rise)| **rise != [0.0; 2]) {
                rise += f64::from(own * x.hypot(*y));
                under += f64::from(*own);
            }
            let usual = if under > 0.0 { (rise / under).max(0.005) } else { 0.01 };
            Self { strength, ground, uphill, usual, slope: (sum / weights / step).max(0.01) }
        })
    }

    /// Adds the slopes of the waves at a place, m along the level axes, of a piece `width` m wide,
    /// at a time, s.
    #[inline]
    pub(super) fn add(&self, nodes: Nodes, point: [f64; 2], width: f32, time: f64, sum: &mut Slope) {
        let (origin, step, [columns, rows]) = nodes;
        let [x, y] = point;
        let (u, v) = ((x - origin[0]) / step, (y - origin[1]) / step);
        if !(u >= 0.0 && v >= 0.0 && u < (columns - 1) as f64 && v < (rows - 1) as f64) {
            return;
        }
        let (column, row) = (u as usize, v as usize);
        let first = row * columns + column;
        let corners = [first, first + 1, first + columns, first + columns + 1];
        let (right, down) = ((u - column as f64) as f32, (v - row as f64) as f32);
        let mix = |[a, b, c, d]: [f32; 4]| {
            let (upper, lower) = (a + right * (b - a), c + right * (d - c));
            upper + down * (lower - upper)
        };
        let strength = mix(corners.map(|at| self.strength[at]));
        if strength <= 0.0 {
            return;
        }
        let height = f64::from(mix(corners.map(|at| self.ground[at])));
        let uphill = [0, 1].map(|k| f64::from(mix(corners.map(|at| self.uphill[at][k]))));
        let steep = uphill[0].hypot(uphill[1]);
        if !(height.is_finite() && steep > 1e-4) {
            return;
        }
        for (k, [length, speed, amplitude]) in RILL_WAVES.into_iter().enumerate() {
            // Waves of a steeper place are shorter.
            let own = (length * self.usual / steep).max(1e-3);
            let ease = |t: f64| t * t * (3.0 - 2.0 * t);
            let bumps = PHASE_SHIFT_WAVES
                * smooth_noise(BUMP_SEED + k as u64, [x / BUMP_WIDTH_M, y / BUMP_WIDTH_M], ease);
            let phase = TAU * (height / (self.slope * length) + speed / length * time + bumps);
            // Where it is flat nothing runs: one wave would tilt all of it.
            let amplitude = f64::from(strength) * amplitude * (steep / self.usual).min(1.0);
            // What a pixel is too wide to show is roughness.
            let seen = (1.5 - 2.0 * f64::from(width) / own).clamp(0.0, 1.0);
            let slope = seen * amplitude * phase.cos();
            (0..2).for_each(|k| sum.mean[k] += (slope * uphill[k] / steep) as f32);
            sum.variance += (0.25 * (1.0 - seen * seen) * amplitude * amplitude) as f32;
        }
    }
}

/// The rise of the ground about nodes near streams, over [`SLOPE_RADIUS_NODES`] nodes to each side:
/// from one node to the next it has the ground's noise.
fn uphill(strength: &[f32], ground: &[f32], step: f32, columns: usize) -> Vec<[f32; 2]> {
    let mut uphill = vec![[0.0; 2]; ground.len()];
    let beside = [0, 1, columns - 1, columns, columns + 1];
    for at in 0..ground.len() {
        // A node is mixed into the cells before it, too.
        let is_near = beside.iter().any(|off| {
            strength.get(at + off).is_some_and(|own| *own > 0.0)
                || at.checked_sub(*off).is_some_and(|near| strength[near] > 0.0)
        });
        let (x, far) = (at % columns, SLOPE_RADIUS_NODES * columns);
        if !is_near
            || x < SLOPE_RADIUS_NODES
            || x + SLOPE_RADIUS_NODES >= columns
            || at < far
            || at + far >= ground.len()
        {
            continue;
        }
        let rises = [
            ground[at + SLOPE_RADIUS_NODES] - ground[at - SLOPE_RADIUS_NODES],
            ground[at + far] - ground[at - far],
        ];
        if rises.iter().all(|rise| rise.is_finite()) {
            uphill[at] = rises.map(|rise| rise / (2.0 * SLOPE_RADIUS_NODES as f32 * step));
        }
    }
    uphill
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slope(rills: &Rills, x: f64, y: f64, width: f32, time: f64) -> Slope {
        let mut sum = Slope::default();
        rills.add(([0.0; 2], 0.1, [40, 40]), [x, y], width, time, &mut sum);
        sum
    }

    fn tilted() -> Rills {
        let ground: Vec<f32> = (0..1600).map(|at| 0.004 * (at % 40) as f32).collect();
        Rills::new(vec![1.0; 1600], ground, 0.1, 40).unwrap()
    }

    /// On an even slope along x, waves have slopes along x alone, and what is seen comes back
    /// downhill.
    #[test]
    fn waves_run_downhill() {
        let rills = tilted();
        let places: Vec<f64> = (0..900).map(|k| 0.5 + 0.003 * f64::from(k)).collect();
        let line = |shift: f64, time: f64| -> Vec<f64> {
            places.iter().map(|x| f64::from(slope(&rills, x + shift, 2.0, 0.001, time).mean[0])).collect()
        };
        let alike = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let now = line(0.0, 3.0);
        let [down, up] = [-0.01, 0.01].map(|shift| alike(&now, &line(shift, 3.033)));
        assert!(down > 1.2 * up && down > 0.7 * alike(&now, &now), "{down} {up}");
        assert!(places.iter().all(|x| slope(&rills, *x, 2.0, 0.001, 3.0).mean[1].abs() < 1e-6));
        let rms = (alike(&now, &now) / now.len() as f64).sqrt();
        assert!((0.03..0.07).contains(&rms), "{rms}");
    }

    #[test]
    fn what_a_pixel_cannot_show_is_roughness() {
        let wide = slope(&tilted(), 2.0, 2.0, 1.0, 0.0);
        assert!(wide.mean == [0.0; 2] && wide.variance > 5e-4, "{wide:?}");
        assert_eq!(slope(&tilted(), -1.0, 2.0, 0.01, 0.0), Slope::default());
        assert!(Rills::new(vec![0.0; 4], vec![0.0; 4], 0.1, 2).is_none());
    }
}
