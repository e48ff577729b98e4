//! Unevenness of the ground that no photo shows: it gives puddles their outlines, and films and
//! damp ground their patches, which are plausible and not surveyed.

use std::sync::LazyLock;
use wm_base::random::uniform;

/// Widths of the bumps, m, and the height of each kind, rms, m.
const BUMP_KINDS: [[f64; 2]; 3] = [[0.5, 0.002_2], [0.25, 0.001_7], [0.12, 0.001_1]];
/// Rms of smoothed noise whose corners are even in -1 to 1.
const NOISE_RMS: f64 = 0.447_6;
const BUMP_SEED: u64 = 0x7077_6574;

/// The height of the relief at a level place, m, with an rms of 3 mm.
pub(crate) fn relief(x: f64, y: f64) -> f64 {
    let mut sum = 0.0;
    for (kind, [width, rms]) in BUMP_KINDS.into_iter().enumerate() {
        let ease = |t: f64| t * t * t * (t * (6.0 * t - 15.0) + 10.0);
        sum += rms / NOISE_RMS * smooth_noise(BUMP_SEED + kind as u64, [x / width, y / width], ease);
    }
    sum
}

/// Shares of the ground over which water goes from none to full, of pores, which take it up from
/// their sides, and of films.
const PORE_TRANSITION_SHARE: f32 = 0.8;
const FILM_TRANSITION_SHARE: f32 = 0.3;

/// Returns the share of the ground that is lower than a place of this height of the relief, m, 0-1.
pub(crate) fn lower_share(height: f64) -> f32 {
    /// Heights that parts of the ground are below, m, in order.
    static HEIGHTS: LazyLock<Vec<f64>> = LazyLock::new(|| {
        // Places that are far enough from each other.
        let mut heights: Vec<f64> =
            (0..10_000u32).map(|k| relief(0.71 * f64::from(k % 100), 0.83 * f64::from(k / 100))).collect();
        heights.sort_by(f64::total_cmp);
        heights
    });
    HEIGHTS.partition_point(|other| *other < height) as f32 / HEIGHTS.len() as f32
}

/// Returns the filled shares of pores and of the texture, 0-1, at a place with a share `lower` of
/// the ground below it, where ground has these in the mean. Hollows fill first and dry last.
pub(crate) fn patchy(shares: [f32; 2], lower: f32) -> [f32; 2] {
    let [pores, film] = shares;
    [
        filled_from_below(pores, lower, PORE_TRANSITION_SHARE),
        filled_from_below(film, lower, FILM_TRANSITION_SHARE),
    ]
}

/// A ramp that falls from 1 to 0 over `width` of the shares of the ground, with a mean of `mean`,
/// at the share `lower`.
fn filled_from_below(mean: f32, lower: f32, width: f32) -> f32 {
    // The end of the ramp, which begins below 0 or ends above 1 if little or nearly all is filled.
    let end = if mean < 0.5 * width {
        (2.0 * mean * width).sqrt()
    } else if mean > 1.0 - 0.5 * width {
        1.0 + width - (2.0 * (1.0 - mean) * width).sqrt()
    } else {
        mean + 0.5 * width
    };
    ((end - lower) / width).clamp(0.0, 1.0)
}

/// Smooth noise in -1 to 1, between corners a length of 1 apart by an `ease` from 0 to 1.
pub(crate) fn smooth_noise(seed: u64, place: [f64; 2], ease: impl Fn(f64) -> f64) -> f64 {
    between_corners(place, ease, |key| 2.0 * uniform(seed, key) - 1.0)
}

/// The value at a place of a field that has a `value` by key at each corner, a length of 1 apart,
/// and goes from one to the next by an `ease` from 0 to 1.
pub(crate) fn between_corners(place: [f64; 2], ease: impl Fn(f64) -> f64, value: impl Fn(u64) -> f64) -> f64 {
    let [i, j] = place.map(f64::floor);
    let [u, v] = [place[0] - i, place[1] - j].map(ease);
    let corner = |di: f64, dj: f64| {
        let [i, j] = [i + di, j + dj].map(|v| v as i64 as u32);
        value(u64::from(i) << 32 | u64::from(j))
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    mix(mix(corner(0.0, 0.0), corner(1.0, 0.0), u), mix(corner(0.0, 1.0), corner(1.0, 1.0), u), v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patches_hold_the_water_that_the_ground_has() {
        for mean in [0.0f32, 0.02, 0.1, 0.3, 0.5, 0.8, 0.95, 1.0] {
            let places: Vec<[f32; 2]> = (0..40_000u32)
                .map(|k| {
                    let height = relief(0.13 * f64::from(k % 200), 0.11 * f64::from(k / 200));
                    patchy([mean; 2], lower_share(height))
                })
                .collect();
            for kind in 0..2 {
                let found = places.iter().map(|place| place[kind]).sum::<f32>() / places.len() as f32;
                assert!((found - mean).abs() < 0.02, "{kind}: {found} for {mean}");
            }
        }
        assert_eq!(patchy([0.0; 2], 0.0), [0.0; 2]);
        assert!(patchy([1.0; 2], 1.0).iter().all(|share| (share - 1.0).abs() < 1e-5));
        // Hollows fill first.
        let shares: Vec<f32> = (0..=10u8).map(|k| patchy([0.4; 2], f32::from(k) / 10.0)[1]).collect();
        assert!(shares.is_sorted_by(|a, b| a >= b) && shares[0] == 1.0 && shares[10] == 0.0, "{shares:?}");
    }

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
