//! Unevenness of the ground that no photo shows: it gives puddles their outlines, which are plausible and not surveyed.

use wm_scene::random::uniform;

/// Widths of the bumps, m, and the height of each kind, rms, m.
const KINDS: [[f64; 2]; 3] = [[0.5, 0.002_2], [0.25, 0.001_7], [0.12, 0.001_1]];
/// Rms of smoothed noise whose corners are even in -1 to 1.
const NOISE_RMS: f64 = 0.447_6;
/// Seed of the bumps.
const SEED: u64 = 0x7077_6574;

/// The height of the relief at a level place, m, with an rms of 3 mm.
#[must_use]
pub fn relief(x: f64, y: f64) -> f64 {
    let mut sum = 0.0;
    for (kind, [width, rms]) in KINDS.into_iter().enumerate() {
        sum += rms / NOISE_RMS * noise(kind as u64, x / width, y / width);
    }
    sum
}

/// Smooth noise in -1 to 1.
fn noise(kind: u64, x: f64, y: f64) -> f64 {
    let [i, j] = [x, y].map(f64::floor);
    let [u, v] = [x - i, y - j].map(|t| t * t * t * (t * (6.0 * t - 15.0) + 10.0));
    let corner = |di: f64, dj: f64| {
        let [i, j] = [i + di, j + dj].map(|v| v as i64 as u32);
        2.0 * uniform(SEED + kind, u64::from(i) << 32 | u64::from(j)) - 1.0
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    mix(mix(corner(0.0, 0.0), corner(1.0, 0.0), u), mix(corner(0.0, 1.0), corner(1.0, 1.0), u), v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_relief_has_its_height_and_no_steps() {
        let at = |k: u32| relief(0.037 * f64::from(k), 0.053 * f64::from(k % 997));
        let values: Vec<f64> = (0..20_000).map(at).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let rms = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        assert!((rms / 0.003 - 1.0).abs() < 0.1, "{rms}");
        for k in 0..2000 {
            let x = 0.001 * f64::from(k) - 1.0;
            assert!((relief(x, 0.3) - relief(x + 0.001, 0.3)).abs() < 3e-4);
        }
    }
}
