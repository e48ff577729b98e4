//! The ground: its height along up, and the plane through it.
//!
//! The ground is the lowest large, dense, level surface near the middle of the scene. Splats that
//! face up or down are counted by height, by how much surface they stand for and over how many
//! cells of a grid they lie. The lowest height with a fair share of the best counts of both is the
//! ground: floaters below it have no surface, a cellar or a pond has few cells.

use super::middle::weighted_median;
use super::sample::{SurveyPoint, SurveySample};
use crate::SceneView;
use glam::{DMat3, DVec3};
use wm_base::linear::{eigen, horizontals, outer};
use wm_base::statistics::quantile;

/// Layers of height per scene radius.
const LAYERS_PER_RADIUS: f64 = 200.0;
/// Half thickness of the ground surface, layers.
const HALF_LAYERS: usize = 2;
/// Cells of the grid per scene radius.
const CELLS_PER_RADIUS: f64 = 12.0;
/// Least cosine of the angle between a normal and up: 25 degrees, to include slopes and rough
/// ground.
const MIN_LEVEL_COS: f64 = 0.906;
/// Depth below the ground beyond which a point is below it, scene radii.
const DEEP_RADII: f64 = 0.1;
/// Largest share of points below a ground.
const MAX_BELOW_SHARE: f64 = 0.15;
/// Half the thickness of rough ground, scene radii.
const RELIEF_RADII: f64 = 0.02;
/// Least share of all surface that lies on a ground with a plane.
const MIN_PLANE_SHARE: f64 = 0.01;
/// Least share of all surface that lies on a ground without a plane.
const MIN_LEVEL_SHARE: f64 = 0.1;
/// Least share of the best surface, and of the best number of cells, that the ground has.
const MIN_FAIR_SHARE: f64 = 0.4;

/// Height of the ground along `up`, scene units; `None` if nothing is level.
///
/// `ceiling` bounds it from above, such as by cameras.
pub(crate) fn level(sample: &SurveySample, up: DVec3, ceiling: Option<f64>) -> Option<f64> {
    let (x, y) = horizontals(up);
    let mut heights: Vec<f64> = sample.points.iter().map(|p| p.at.dot(up)).collect();
    let low = quantile(&mut heights, 0.002);
    let high = quantile(&mut heights, 0.998);
    let step = sample.radius / LAYERS_PER_RADIUS;
    let count = ((high - low) / step).min(1e9) as usize + 2 * HALF_LAYERS + 1;
    // A negative, zero or infinite radius has no layers.
    if !(step > 0.0 && count < 1 << 16) {
        return None;
    }
    let mut surface = vec![0.0; count];
    let mut cells: Vec<(usize, i32, i32)> = Vec::new();
    for point in &sample.points {
        let offset = point.at - sample.center;
        let layer = ((point.at.dot(up) - low) / step).clamp(0.0, (count - 1) as f64) as usize;
        let away = (offset.dot(x).powi(2) + offset.dot(y).powi(2)) / sample.radius.powi(2);
        let weight = point.area * (-2.0 * away).exp();
        if point.normal.dot(up).abs() >= MIN_LEVEL_COS {
            surface[layer] += weight;
            let cell = |axis: DVec3| {
                (offset.dot(axis) / sample.radius * CELLS_PER_RADIUS).floor().clamp(-1e9, 1e9) as i32
            };
            cells.push((layer, cell(x), cell(y)));
        }
    }
    let around = |layer: usize| layer.saturating_sub(HALF_LAYERS)..(layer + HALF_LAYERS + 1).min(count);
    let surface: Vec<f64> = (0..count).map(|layer| surface[around(layer)].iter().sum()).collect();
    let cover = cover(&mut cells, count);
    let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    let (most_surface, most_cover) = (most(&surface), most(&cover));
    if most_surface <= 0.0 {
        return None;
    }
    let allowed = |layer: usize| ceiling.is_none_or(|c| low + layer as f64 * step < c);
    let fair = |layer: &usize| {
        surface[*layer] >= MIN_FAIR_SHARE * most_surface
            && cover[*layer] >= MIN_FAIR_SHARE * most_cover
            && allowed(*layer)
    };
    let first = (0..count).find(fair).or_else(|| (0..count).find(|l| surface[*l] == most_surface))?;
    // The surface is met at its edge: the middle of it is the best layer just above.
    let best = (first..(first + 2 * HALF_LAYERS + 1).min(count))
        .max_by(|a, b| surface[*a].total_cmp(&surface[*b]).then(b.cmp(a)))?;
    let height = low + (best as f64 + 0.5) * step;
    Some(median_height(sample, up, height, (HALF_LAYERS as f64 + 0.5) * step))
}

/// Returns true if there is a ground at `height` along `up`: a plane of some width or much level
/// surface, with next to nothing below it. The level parts of a trunk, a bust or a few splats are
/// none.
pub(crate) fn is_there(sample: &SurveySample, up: DVec3, height: f64) -> bool {
    if sample.points.len() < super::sourced::MIN_POINTS {
        return false;
    }
    let origin = sample.center + up * (height - sample.center.dot(up));
    let plane = plane(sample, up, height);
    let normal = plane.unwrap_or(up);
    let share = |is: &dyn Fn(&SurveyPoint) -> bool, of: &dyn Fn(&SurveyPoint) -> f64| {
        let all: f64 = sample.points.iter().map(of).sum();
        sample.points.iter().filter(|point| is(point)).map(of).sum::<f64>() / all.max(f64::MIN_POSITIVE)
    };
    let below = |point: &SurveyPoint| (point.at - origin).dot(normal) < -DEEP_RADII * sample.radius;
    let level = |point: &SurveyPoint| {
        point.normal.dot(up).abs() >= MIN_LEVEL_COS
            && (point.at.dot(up) - height).abs() < RELIEF_RADII * sample.radius
    };
    let least = if plane.is_some() { MIN_PLANE_SHARE } else { MIN_LEVEL_SHARE };
    share(&below, &|_| 1.0) < MAX_BELOW_SHARE && share(&level, &|point| point.area) > least
}

/// Height of the ground along `up` below the cameras of `views`, scene units; `None` if there is
/// none.
pub(crate) fn below(sample: &SurveySample, up: DVec3, views: &[SceneView]) -> Option<f64> {
    level(sample, up, ceiling(views, up)).filter(|height| is_there(sample, up, *height))
}

/// Height above which the ground cannot be: that of the lower cameras; `None` without any.
fn ceiling(views: &[SceneView], up: DVec3) -> Option<f64> {
    let mut heights: Vec<f64> = views.iter().map(|view| view.camera.center().dot(up)).collect();
    (!heights.is_empty()).then(|| quantile(&mut heights, 0.1))
}

/// Height of the lowest points, where nothing is level; 0 if there are none.
pub(crate) fn lowest(sample: &SurveySample, up: DVec3) -> f64 {
    let mut heights: Vec<f64> = sample.points.iter().map(|p| p.at.dot(up)).collect();
    quantile(&mut heights, 0.02)
}

/// Cells of the grid in which a surface of each layer lies, as in `surface`.
fn cover(cells: &mut Vec<(usize, i32, i32)>, count: usize) -> Vec<f64> {
    let mut cover = vec![0.0; count];
    // A cell counts once a layer and its neighbours: count each where it last was too far below.
    cells.sort_unstable_by_key(|(layer, x, y)| (*x, *y, *layer));
    cells.dedup();
    let mut last: Option<(usize, i32, i32)> = None;
    for &(layer, x, y) in cells.iter() {
        let from = match last {
            Some((before, a, b)) if (a, b) == (x, y) => {
                (before + HALF_LAYERS + 1).max(layer.saturating_sub(HALF_LAYERS))
            }
            _ => layer.saturating_sub(HALF_LAYERS),
        };
        for value in &mut cover[from.min(count)..(layer + HALF_LAYERS + 1).min(count)] {
            *value += 1.0;
        }
        last = Some((layer, x, y));
    }
    cover
}

/// Weighted median height of the level points within `reach` of `height`, the middle of the scene
/// counting most.
fn median_height(sample: &SurveySample, up: DVec3, height: f64, reach: f64) -> f64 {
    let mut near: Vec<(f64, f64)> = sample
        .points
        .iter()
        .filter(|p| p.normal.dot(up).abs() >= MIN_LEVEL_COS && (p.at.dot(up) - height).abs() <= reach)
        .map(|p| {
            let away = (p.at - sample.center).reject_from_normalized(up).length_squared();
            (p.at.dot(up), p.area * (-2.0 * away / sample.radius.powi(2)).exp())
        })
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    weighted_median(near.iter().copied()).unwrap_or(height)
}

/// The plane of the ground about `height`, as its normal on the side of `up`.
///
/// `None` where it is not reliable: too few points, too narrow, or too rough.
pub(crate) fn plane(sample: &SurveySample, up: DVec3, height: f64) -> Option<DVec3> {
    let mut normal = up;
    let level: Vec<&SurveyPoint> =
        sample.points.iter().filter(|p| p.normal.dot(up).abs() >= MIN_LEVEL_COS).collect();
    let mut origin = sample.center + up * (height - sample.center.dot(up));
    // From thick to thin: what is a step at first, a kerb or a hedge, drops out.
    for thickness in [0.04, 0.03, 0.02, 0.02, 0.015, 0.015] {
        let reach = thickness * sample.radius;
        let (mut sum, mut weights, mut moments, mut used) = (DVec3::ZERO, 0.0, DMat3::ZERO, 0);
        for point in &level {
            let offset = point.at - origin;
            let off = offset.dot(normal) / reach;
            if off.abs() < 1.0 {
                // Tukey's weight, and the middle of the scene before its rim.
                let away = offset.length_squared() / sample.radius.powi(2);
                let weight = point.area * (1.0 - off * off).powi(2) * (-away).exp();
                sum += offset * weight;
                moments += outer(offset, weight);
                weights += weight;
                used += 1;
            }
        }
        if used < 100 || weights <= 0.0 {
            return None;
        }
        let mean = sum / weights;
        let [(thin, axis), (narrow, _), _] = eigen(moments * (1.0 / weights) - outer(mean, 1.0));
        let wide = narrow.sqrt();
        // A strip does not determine the slope across it.
        if wide < 0.08 * sample.radius || thin.sqrt() > 0.1 * wide {
            return None;
        }
        origin += mean;
        normal = if axis.dot(up) < 0.0 { -axis } else { axis };
    }
    Some(normal)
}
