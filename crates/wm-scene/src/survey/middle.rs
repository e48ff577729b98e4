//! Few of many, and their middle.

use glam::DVec3;
use wm_base::statistics::quantile;

/// Indices below `count` at even steps, about `most` of them.
pub(crate) fn strided(count: usize, most: usize) -> impl Iterator<Item = usize> {
    (0..count).step_by(count.div_ceil(most).max(1))
}

/// The weighted median of values that are sorted, each with its weight; `None` if there are none.
pub(crate) fn weighted_median(mut sorted: impl Iterator<Item = (f64, f64)> + Clone) -> Option<f64> {
    let half = 0.5 * sorted.clone().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let reached = sorted.find(|(_, weight)| {
        sum += weight;
        sum >= half
    });
    reached.map(|(value, _)| value)
}

/// The middle of most of `points`, whatever the rest does: the geometric median, then that of the
/// nearer three fifths. The origin if there are none.
///
/// The geometric median turns with the scene, other than the median of each coordinate.
pub(crate) fn center_of(points: &[DVec3]) -> DVec3 {
    let few: Vec<DVec3> = strided(points.len(), 5000).map(|i| points[i]).collect();
    let center = geometric_median(&few);
    let mut distances: Vec<f64> = few.iter().map(|p| p.distance(center)).collect();
    let reach = quantile(&mut distances, 0.6);
    let near: Vec<DVec3> = few.into_iter().filter(|p| p.distance(center) <= reach).collect();
    geometric_median(&near)
}

/// The point with the least sum of distances, by Weiszfeld's iteration from the median of each
/// coordinate.
fn geometric_median(points: &[DVec3]) -> DVec3 {
    let median = |axis: usize| quantile(&mut points.iter().map(|p| p[axis]).collect::<Vec<_>>(), 0.5);
    let mut center = DVec3::new(median(0), median(1), median(2));
    let mut distances: Vec<f64> = points.iter().map(|p| p.distance(center)).collect();
    let softening = 1e-3 * quantile(&mut distances, 0.5) + f64::MIN_POSITIVE;
    for _ in 0..20 {
        let (sum, weight) = points.iter().fold((DVec3::ZERO, 0.0), |(sum, weight), p| {
            let w = 1.0 / (p.distance(center) + softening);
            (sum + *p * w, weight + w)
        });
        if weight > 0.0 && weight.is_finite() {
            center = sum / weight;
        }
    }
    center
}
