//! Pictures of sweeps: ranges and intensities by direction, and points from above.

use super::colors::{class_color, in_sensor, intensity_color, lowest, range_color};
use crate::sweep_picture::{LINE_COLOR, SweepPicture};
use std::str::FromStr;
use wm_image::PictureSize;
use wm_sensors::{EchoClass, LidarPoint, LidarSweep};

/// A way to look at a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SweepView {
    /// Ranges by direction: red is near, blue is 100 m away.
    Range,
    /// Intensities by direction.
    Intensity,
    /// From above, the sensor in the middle and ahead of it above: surfaces by height, weather in
    /// colours of its own.
    Above,
}

impl SweepView {
    /// Every view, with its name.
    pub const ALL: [(Self, &'static str); 3] =
        [(Self::Range, "range"), (Self::Intensity, "intensity"), (Self::Above, "above")];

    /// The name in options and file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(view, _)| *view == self).map_or("", |(_, name)| name)
    }
}

impl FromStr for SweepView {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(view, _)| *view)
            .ok_or_else(|| format!("`{text}` is no view: use range, intensity or above"))
    }
}

/// Side of a picture from above, px.
const ABOVE_SIDE_PX: u32 = 1000;
/// Largest width of a picture by direction, and its usual height, px.
const MAX_WIDTH_PX: u32 = 2048;
const DEFAULT_HEIGHT_PX: u32 = 320;
/// Share of the points that a picture from above shows.
const SHOWN_POINT_SHARE: f64 = 0.95;
/// Distances that it shows at least and at most, m.
const RADIUS_LIMITS_M: [f64; 2] = [10.0, 100.0];

impl SweepView {
    /// Draws a sweep.
    #[must_use]
    pub fn draw(self, sweep: &LidarSweep) -> SweepPicture {
        match self {
            Self::Range => by_direction(sweep, range_color),
            Self::Intensity => by_direction(sweep, intensity_color),
            Self::Above => above(sweep),
        }
    }
}

/// Points by row and column, or by angles where there are no rows; the nearest is in front.
fn by_direction(sweep: &LidarSweep, color: impl Fn(&LidarPoint) -> [u8; 3]) -> SweepPicture {
    let mut order: Vec<&LidarPoint> = sweep.points.iter().collect();
    order.sort_by(|a, b| b.range.total_cmp(&a.range));
    let extent = |k: usize| {
        let all = sweep.points.iter().map(|point| f64::from(point.angles[k]));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    };
    let [[left, right], [bottom, top]] = [extent(0), extent(1)];
    if let Some([rows, columns]) = sweep.grid {
        let width = columns.clamp(1, MAX_WIDTH_PX);
        // By azimuth: columns of sensors whose rows look aside are staggered. Beyond a full turn
        // the picture begins anew.
        let turn = (right - left).clamp(1e-6, std::f64::consts::TAU);
        let start = if turn < std::f64::consts::TAU { right } else { std::f64::consts::PI };
        let tall = DEFAULT_HEIGHT_PX.div_ceil(rows.max(1)).max(1);
        let mut picture = SweepPicture::new(PictureSize::new(width, rows.max(1) * tall));
        for point in order {
            let share = (start - f64::from(point.angles[0])) / turn;
            let x = (share * f64::from(width)).floor().rem_euclid(f64::from(width));
            for y in 0..tall {
                picture.set(x as i64, i64::from(u32::from(point.ring) * tall + y), color(point));
            }
        }
        return picture;
    }
    let (wide, high) = ((right - left).max(1e-6), (top - bottom).max(1e-6));
    let height = 3 * DEFAULT_HEIGHT_PX;
    let width = if wide.is_finite() { (f64::from(height) * wide / high).round() as u32 } else { height };
    let mut picture = SweepPicture::new(PictureSize::new(width.clamp(16, MAX_WIDTH_PX), height));
    let size = picture.size;
    for point in order {
        let [azimuth, elevation] = point.angles.map(f64::from);
        let x = ((right - azimuth) / wide * f64::from(size.width - 1)).round() as i64;
        let y = ((top - elevation) / high * f64::from(size.height - 1)).round() as i64;
        let color = color(point);
        (0..4).for_each(|k| picture.set(x + k % 2, y + k / 2, color));
    }
    picture
}

fn above(sweep: &LidarSweep) -> SweepPicture {
    let mut points: Vec<([f64; 3], EchoClass)> =
        sweep.points.iter().map(|point| (in_sensor(sweep, point), point.class)).collect();
    // Weather over surfaces, what is high over what is low.
    points.sort_by(|(a, first), (b, second)| {
        let is_weather = |class: &EchoClass| *class != EchoClass::Surface;
        is_weather(first).cmp(&is_weather(second)).then(a[2].total_cmp(&b[2]))
    });
    let surfaces = points.iter().filter(|(_, class)| *class == EchoClass::Surface);
    let lowest = lowest(surfaces.map(|(at, _)| at[2]).collect());
    let mut distances: Vec<f64> = points.iter().map(|(at, _)| at[0].hypot(at[1])).collect();
    distances.sort_by(f64::total_cmp);
    let shown = distances
        .get((SHOWN_POINT_SHARE * distances.len() as f64) as usize)
        .copied()
        .unwrap_or(RADIUS_LIMITS_M[0]);
    let reach = shown.clamp(RADIUS_LIMITS_M[0], RADIUS_LIMITS_M[1]);
    let scale = 0.5 * f64::from(ABOVE_SIDE_PX) / reach;
    let middle = f64::from(ABOVE_SIDE_PX / 2);
    let mut picture = SweepPicture::new(PictureSize::new(ABOVE_SIDE_PX, ABOVE_SIDE_PX));
    for ring in 1..=(reach * 1.5 / 10.0) as u32 {
        let radius = 10.0 * f64::from(ring) * scale;
        let steps = (8.0 * radius) as u32;
        for step in 0..steps {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / f64::from(steps)).sin_cos();
            picture.set((middle + radius * cos) as i64, (middle + radius * sin) as i64, LINE_COLOR);
        }
    }
    for ([x, y, z], class) in points {
        let color = class_color(class, z - lowest);
        // Ahead is above, left is left.
        picture.set((middle - y * scale) as i64, (middle - x * scale) as i64, color);
    }
    for step in -6..=6 {
        picture.set(middle as i64 + step, middle as i64, [255; 3]);
        picture.set(middle as i64, middle as i64 + step, [255; 3]);
    }
    picture
}
