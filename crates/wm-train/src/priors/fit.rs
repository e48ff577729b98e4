//! Scale and shift of relative inverse depth, so that it fits the points of the reconstruction.
//!
//! `1 / z = scale d + shift`. The fit is robust: RANSAC over pairs of points, then a few rounds of
//! least squares over the inliers with Huber weights.

use crate::random::{Purpose, Random};
use thiserror::Error;
use wm_base::statistics::quantile;

/// Fewest points of a fit.
pub(crate) const MIN_POINTS: usize = 20;
/// Number of random pairs.
const MAX_TRIES: u64 = 300;
/// Largest relative difference of an inlier, of a mix of the median inverse depth and its own.
const INLIER_TOLERANCE: f64 = 0.1;
/// Least share of inliers, and largest relative residual, of a valid fit.
const MIN_FOLLOWING_SHARE: f64 = 0.5;
const MAX_RESIDUAL: f64 = 0.15;
/// Largest ratio of the residual of a fit with a shift to the spread of depths: for unrelated
/// values it is 1.
const MAX_SPREAD_RATIO: f64 = 0.8;

/// The unknowns of a fit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Freedom {
    /// Scale and shift, as networks leave them open.
    #[default]
    ScaleShift,
    /// The scale: depth in another unit.
    Scale,
    /// Nothing: 1 / scene unit for each unit of the value. The points only tell how far off it is.
    Known(f64),
}

/// A fit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fit {
    /// 1 / scene unit for each unit of the relative value.
    pub scale: f64,
    /// 1 / scene unit.
    pub shift: f64,
    /// Median of the absolute differences from the points' inverse depth, as a share of its median.
    pub residual: f64,
    /// The median difference, 1 / scene unit.
    pub(crate) sigma: f64,
    /// The number of points.
    pub points: usize,
    /// The share of inliers.
    pub follow: f64,
}

/// A reason why there is no fit.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum FitError {
    /// Too few points are seen.
    #[error("{0} points fall on known depth, {MIN_POINTS} are needed")]
    Few(usize),
    /// The values are all the same.
    #[error("its depth is the same everywhere, so there is nothing to fit")]
    Flat,
    /// Far grows where it should fall.
    #[error("its values grow with distance; is it depth, and not disparity?")]
    Inverted,
    /// The values have nothing to do with the points' depths.
    #[error("its depth says no more of {0} points than one distance for all would")]
    Blind(usize),
    /// Too many points lie elsewhere.
    #[error("only {:.0} % of {points} points follow its depth, which is off by {:.0} % in the median", 100.0 * follow, 100.0 * residual)]
    Poor {
        /// Share of points that follow.
        follow: f64,
        /// Median of relative differences.
        residual: f64,
        /// Points.
        points: usize,
    },
}

/// Fits pairs of a relative value and the inverse depth of a point, 1 / scene unit.
///
/// # Errors
/// [`FitError`] if there are too few, or if they do not follow one line.
pub fn fit(pairs: &[[f64; 2]], freedom: Freedom, seed: u64) -> Result<Fit, FitError> {
    let pairs: Vec<[f64; 2]> =
        pairs.iter().copied().filter(|[d, w]| d.is_finite() && w.is_finite() && *w > 0.0).collect();
    if pairs.len() < MIN_POINTS {
        return Err(FitError::Few(pairs.len()));
    }
    let mut inverse: Vec<f64> = pairs.iter().map(|[_, w]| *w).collect();
    let middle = quantile(&mut inverse, 0.5);
    let line = line(&pairs, freedom, middle, seed)?;
    let mut offs: Vec<f64> = pairs.iter().map(|pair| off(line, *pair)).collect();
    let sigma = quantile(&mut offs, 0.5);
    let follow =
        pairs.iter().filter(|pair| follows(line, **pair, middle)).count() as f64 / pairs.len() as f64;
    let residual = sigma / middle;
    if follow < MIN_FOLLOWING_SHARE || residual > MAX_RESIDUAL {
        return Err(FitError::Poor { follow, residual, points: pairs.len() });
    }
    if freedom == Freedom::ScaleShift {
        let mut spread: Vec<f64> = inverse.iter().map(|w| (w - middle).abs()).collect();
        if sigma > MAX_SPREAD_RATIO * quantile(&mut spread, 0.5) {
            return Err(FitError::Blind(pairs.len()));
        }
    }
    if line.0 <= 0.0 {
        return Err(FitError::Inverted);
    }
    Ok(Fit { scale: line.0, shift: line.1, residual, sigma, points: pairs.len(), follow })
}

/// Returns the distance of a pair from `1 / z = line.0 d + line.1`, 1 / scene unit.
fn off(line: (f64, f64), pair: [f64; 2]) -> f64 {
    (line.0 * pair[0] + line.1 - pair[1]).abs()
}

/// Returns true if a pair is an inlier; `middle` is the median inverse depth.
fn follows(line: (f64, f64), pair: [f64; 2], middle: f64) -> bool {
    // Noise has an absolute part, so far points have a wider tolerance.
    off(line, pair) < INLIER_TOLERANCE * (0.3 * middle + 0.7 * pair[1])
}

/// Returns the scale and shift with the most inliers.
fn line(pairs: &[[f64; 2]], freedom: Freedom, middle: f64, seed: u64) -> Result<(f64, f64), FitError> {
    if let Freedom::Known(scale) = freedom {
        return Ok((scale, 0.0));
    }
    let follows = |line, pair| follows(line, pair, middle);
    let random = Random::new(seed, Purpose::Start, 1);
    let mut best: Option<(usize, (f64, f64))> = None;
    for k in 0..MAX_TRIES {
        let [a, b] = [0, 1].map(|i| pairs[random.below(2 * k + i, pairs.len())]);
        let line = match freedom {
            Freedom::ScaleShift => {
                let scale = (a[1] - b[1]) / (a[0] - b[0]);
                (scale, a[1] - scale * a[0])
            }
            Freedom::Scale | Freedom::Known(_) => (a[1] / a[0], 0.0),
        };
        if !(line.0.is_finite() && line.0 != 0.0) {
            continue;
        }
        let count = pairs.iter().filter(|pair| follows(line, **pair)).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, line));
        }
    }
    let (_, mut line) = best.ok_or(FitError::Flat)?;
    for _ in 0..10 {
        let mut sums = [0.0; 5];
        let tolerance = 0.3 * INLIER_TOLERANCE * middle;
        for pair in pairs.iter().filter(|pair| follows(line, **pair)) {
            let weight = (tolerance / off(line, *pair).max(1e-300)).min(1.0);
            let [d, w] = *pair;
            for (sum, value) in sums.iter_mut().zip([1.0, d, w, d * d, d * w]) {
                *sum += weight * value;
            }
        }
        let [n, d, w, dd, dw] = sums;
        let next = match freedom {
            Freedom::ScaleShift => {
                let scale = (n * dw - d * w) / (n * dd - d * d);
                (scale, (w - scale * d) / n)
            }
            Freedom::Scale | Freedom::Known(_) => (dw / dd, 0.0),
        };
        if !(next.0.is_finite() && next.1.is_finite()) {
            return Err(FitError::Flat);
        }
        line = next;
    }
    Ok(line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use wm_base::random::uniform;

    /// Points 3 to 60 units away under a relative depth of `scale` and `shift`, a share of them
    /// anywhere.
    fn pairs(count: u64, scale: f64, shift: f64, strays: f64, noise: f64) -> Vec<[f64; 2]> {
        let pair = |i: u64| {
            let u = |k: u64| uniform(9, 8 * i + k);
            let inverse = 1.0 / (3.0 * 20f64.powf(u(0)));
            let seen = if u(1) < strays { u(2) / 3.0 } else { inverse * (1.0 + noise * (u(3) - 0.5)) };
            [(inverse - shift) / scale, seen]
        };
        (0..count).map(pair).collect()
    }

    proptest! {
        #[test]
        fn the_line_is_found_among_strays(scale in 0.001f64..1000.0, shift in -0.1f64..0.1, strays in 0.0f64..0.35) {
            let found = fit(&pairs(300, scale, shift, strays, 0.02), Freedom::ScaleShift, 1).unwrap();
            prop_assert!((found.scale / scale - 1.0).abs() < 0.02, "{found:?}");
            prop_assert!((found.shift - shift).abs() < 0.002, "{found:?}");
        }
    }

    #[test]
    fn what_cannot_be_fitted_is_said() {
        let good = pairs(300, 2.0, 0.01, 0.1, 0.01);
        assert_eq!(fit(&good[..19], Freedom::ScaleShift, 0), Err(FitError::Few(19)));
        let flat: Vec<_> = good.iter().map(|[_, w]| [0.5, *w]).collect();
        assert_eq!(fit(&flat, Freedom::ScaleShift, 0), Err(FitError::Flat));
        let inverted: Vec<_> = good.iter().map(|[_, w]| [-*w, *w]).collect();
        assert_eq!(fit(&inverted, Freedom::ScaleShift, 0), Err(FitError::Inverted));
        let noise: Vec<_> = (0..300).map(|i| [uniform(3, i), 0.02 + uniform(4, i)]).collect();
        assert!(matches!(fit(&noise, Freedom::ScaleShift, 0), Err(FitError::Poor { .. })));
        let scaled = fit(&pairs(300, 2.0, 0.0, 0.1, 0.01), Freedom::Scale, 0).unwrap();
        assert!((scaled.scale - 2.0).abs() < 0.02 && scaled.shift == 0.0);
        // All at nearly the same distance: any values would do, were it only for how many follow.
        let wall: Vec<_> = (0..300).map(|i| [uniform(3, i), 0.1 + 0.002 * uniform(4, i)]).collect();
        assert_eq!(fit(&wall, Freedom::ScaleShift, 0), Err(FitError::Blind(300)));
        let scaled = pairs(300, 2.0, 0.0, 0.1, 0.01);
        assert_eq!(fit(&scaled, Freedom::Known(2.0), 0).unwrap().scale, 2.0);
        assert!(matches!(fit(&scaled, Freedom::Known(3.0), 0), Err(FitError::Poor { .. })));
        let holes =
            fit(&[good, vec![[f64::NAN, 1.0], [1.0, f64::INFINITY]]].concat(), Freedom::ScaleShift, 0);
        assert_eq!(holes.unwrap().points, 300);
    }
}
