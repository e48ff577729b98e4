//! Colours of points.

use std::str::FromStr;
use wm_image::ramps;
use wm_sensors::{EchoClass, LidarPoint, LidarSweep};

/// The property that colours points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointColors {
    /// Surfaces by height, red is high, and weather in colours of its own.
    #[default]
    Class,
    /// Ranges: red is near, blue is 100 m away.
    Range,
    /// Intensities, from black to white.
    Intensity,
}

/// Range of the last colour, m.
const MAX_COLOR_RANGE_M: f64 = 100.0;
/// Height of the last colour above the lowest surfaces, m, and the share of surfaces that may lie
/// below those.
const COLOR_HEIGHT_SPAN_M: f64 = 10.0;
const GROUND_QUANTILE: f64 = 0.02;

impl PointColors {
    /// Every choice, with its name.
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Class, "class"), (Self::Range, "range"), (Self::Intensity, "intensity")];

    /// The colours of the points of a sweep, sRGB.
    #[must_use]
    pub fn of(self, sweep: &LidarSweep) -> Vec<[u8; 3]> {
        match self {
            Self::Class => {
                let heights: Vec<f64> = sweep.points.iter().map(|point| in_sensor(sweep, point)[2]).collect();
                let of_surfaces = sweep.points.iter().zip(&heights);
                let lowest = lowest(
                    of_surfaces
                        .filter(|(point, _)| point.class == EchoClass::Surface)
                        .map(|(_, z)| *z)
                        .collect(),
                );
                let points = sweep.points.iter().zip(heights);
                points.map(|(point, height)| class_color(point.class, height - lowest)).collect()
            }
            Self::Range => sweep.points.iter().map(range_color).collect(),
            Self::Intensity => sweep.points.iter().map(intensity_color).collect(),
        }
    }
}

impl FromStr for PointColors {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(colors, _)| *colors)
            .ok_or_else(|| format!("points have no colours by `{text}`: use class, range or intensity"))
    }
}

/// The height of the lowest surfaces, of the heights of all.
pub(super) fn lowest(mut heights: Vec<f64>) -> f64 {
    let index = (GROUND_QUANTILE * heights.len() as f64) as usize;
    if heights.is_empty() {
        return 0.0;
    }
    *heights.select_nth_unstable_by(index, f64::total_cmp).1
}

/// The colour of a class; that of a surface is by its height above the lowest, m.
pub(super) fn class_color(class: EchoClass, height: f64) -> [u8; 3] {
    match class {
        EchoClass::Surface => ramps::turbo(1.0 - (height / COLOR_HEIGHT_SPAN_M).clamp(0.0, 1.0)),
        EchoClass::Drop => [130, 230, 255],
        EchoClass::Flake => [255, 255, 255],
        EchoClass::Air => [190, 150, 255],
        EchoClass::Ghost => [255, 60, 200],
    }
}

pub(super) fn range_color(point: &LidarPoint) -> [u8; 3] {
    ramps::turbo(f64::from(point.range).max(1.0).ln() / MAX_COLOR_RANGE_M.ln())
}

pub(super) fn intensity_color(point: &LidarPoint) -> [u8; 3] {
    // As displays encode light, so that dark surfaces are told apart.
    [(255.0 * f64::from(point.intensity / 255.0).sqrt()).round() as u8; 3]
}

/// Returns a point in the axes of the sensor at the start of the sweep.
pub(super) fn in_sensor(sweep: &LidarSweep, point: &LidarPoint) -> [f64; 3] {
    sweep.frame.in_sensor(point.position, &sweep.pose, sweep.metres_per_unit).to_array()
}
