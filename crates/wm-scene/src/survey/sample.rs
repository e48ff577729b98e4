//! A fair sample of the splats: enough for every estimate of a survey, few enough to be quick.

use super::middle::{center_of, strided};
use super::sky::SkyRegion;
use crate::Splats;
use glam::DVec3;
use wm_base::linear::horizontals;
use wm_base::statistics::quantile;

/// Most splats in a sample. The error of a share or a quantile is about `1 / (2 sqrt(30000))` = 0.3
/// %, far below what any decision here depends on.
const MAX_SPLATS: usize = 30_000;

/// Least opacity of a surface: fainter splats are haze of the reconstruction.
const MIN_OPACITY: f64 = 0.1;

/// One splat that is no sky.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurveyPoint {
    /// Index in the splats.
    pub(crate) index: usize,
    /// Centre, scene units.
    pub(crate) at: DVec3,
    /// Shortest axis, length 1, sign free.
    pub(crate) normal: DVec3,
    /// The surface that it stands for: its area times opacity times flatness, square units. Large
    /// ones are cut to the 95 % quantile, so that no single splat outvotes a surface.
    pub(crate) area: f64,
}

/// The sampled splats and where their middle is.
#[derive(Clone, Debug)]
pub(crate) struct SurveySample {
    /// The sampled splats, in their order.
    pub(crate) points: Vec<SurveyPoint>,
    /// Splats of the scene for each that was looked at.
    pub(crate) stands_for: usize,
    /// The middle, scene units: see [`center_of`].
    pub(crate) center: DVec3,
    /// Distance from the middle within which 95 % of the points are, scene units.
    pub(crate) radius: f64,
}

impl SurveySample {
    /// Takes splats that can be seen and are no sky, at even steps of their index.
    pub(crate) fn of(splats: &Splats, sky: &SkyRegion) -> Self {
        let mut points: Vec<SurveyPoint> = strided(splats.len(), MAX_SPLATS)
            .filter(|index| splats.is_sound(*index) && !sky.holds(splats, *index))
            .filter_map(|index| point(splats, index))
            .collect();
        let mut areas: Vec<f64> = points.iter().map(|p| p.area).collect();
        let most = quantile(&mut areas, 0.95);
        for point in &mut points {
            point.area = point.area.min(most);
        }
        let at: Vec<DVec3> = points.iter().map(|p| p.at).collect();
        let center = center_of(&at);
        let mut distances: Vec<f64> = at.iter().map(|p| p.distance(center)).collect();
        let radius = quantile(&mut distances, 0.95);
        Self { points, stands_for: splats.len().div_ceil(MAX_SPLATS).max(1), center, radius }
    }

    /// Length, width and height (along `up`) of the box that holds all but 1 % of the points to
    /// each side, scene units.
    pub(crate) fn extent(&self, up: DVec3) -> [f64; 3] {
        let (x, y) = horizontals(up);
        let mut size = [x, y, up].map(|axis| {
            let mut along: Vec<f64> = self.points.iter().map(|p| p.at.dot(axis)).collect();
            let low = quantile(&mut along, 0.01);
            quantile(&mut along, 0.99) - low
        });
        size[..2].sort_by(|a, b| b.total_cmp(a));
        size
    }
}

/// The survey's point of a splat; `None` of one that is too faint.
pub(crate) fn point(splats: &Splats, index: usize) -> Option<SurveyPoint> {
    let opacity = splats.opacity(index);
    if opacity < MIN_OPACITY {
        return None;
    }
    let mut scales = splats.scales(index);
    scales.sort_by(f64::total_cmp);
    let [thin, middle, long] = scales;
    // A needle or a ball has no surface that faces anywhere.
    let flatness = if middle > 0.0 { 1.0 - thin / middle } else { 0.0 };
    let at = DVec3::from_array(splats.means[index].map(f64::from));
    let normal = DVec3::from_array(splats.normal(index));
    Some(SurveyPoint { index, at, normal, area: middle * long * opacity * flatness })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_withstands_a_third_of_strays() {
        let near =
            (0..200).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)));
        let far = (0..100).map(|i| DVec3::new(500.0, f64::from(i), 900.0));
        let center = center_of(&near.chain(far).collect::<Vec<_>>());
        assert!(center.distance(DVec3::new(4.5, 4.5, 0.5)) < 1.5, "{center}");
        assert_eq!(center_of(&[]), DVec3::ZERO);
        assert_eq!(center_of(&[DVec3::X; 3]), DVec3::X);
    }
}
