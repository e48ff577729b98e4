//! Pictures of a radar's sweeps, from above.

use crate::sweep_picture::{LINE_COLOR, SweepPicture};
use std::str::FromStr;
use wm_image::{PictureSize, ramps};
use wm_sensors::radar::{RadarClass, RadarDetection, RadarSweep};

/// A way to look at a radar's sweep, from above, the sensor below the middle and ahead of it above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadarView {
    /// By radial velocity: blue comes nearer, white stands, red goes away.
    Velocity,
    /// By radar cross section: blue is -30 dBsm, red is 30 dBsm.
    Rcs,
}

impl RadarView {
    /// Every view, with its name.
    pub const ALL: [(Self, &'static str); 2] = [(Self::Velocity, "above"), (Self::Rcs, "rcs")];

    /// The name in options and file names.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(view, _)| *view == self).map_or("", |(_, name)| name)
    }
}

impl FromStr for RadarView {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|(_, name)| *name == text);
        found
            .map(|(view, _)| *view)
            .ok_or_else(|| format!("`{text}` is no view of a radar: use above or rcs"))
    }
}

/// Largest side of a picture, and the room around the field of view, px.
const MAX_SIDE_PX: f64 = 1000.0;
const MARGIN_PX: f64 = 20.0;
/// Radar cross sections of the first and the last colour, dBsm.
const RCS_RANGE_DBSM: [f64; 2] = [-30.0, 30.0];
/// Radius of a detection, px: of the weakest, and what each dB over the threshold adds.
const DISC_RADIUS_PX: [f64; 2] = [2.0, 0.06];

impl RadarView {
    /// Draws a sweep.
    #[must_use]
    pub fn draw(self, sweep: &RadarSweep) -> SweepPicture {
        let field = Field::of(sweep);
        let mut picture = SweepPicture::new(field.size);
        field.draw_grid(sweep, &mut picture);
        // False alarms have any velocity: the fastest of the others gives the scale.
        let real = sweep.detections.iter().filter(|one| one.class != RadarClass::Noise);
        let fastest = real.map(|one| f64::from(one.velocity.abs())).fold(1.0, f64::max);
        let mut order: Vec<&RadarDetection> = sweep.detections.iter().collect();
        order.sort_by(|a, b| a.snr.total_cmp(&b.snr));
        for one in order {
            let share = match self {
                Self::Velocity => 0.5 + 0.5 * f64::from(one.velocity) / fastest,
                Self::Rcs => {
                    (f64::from(one.rcs) - RCS_RANGE_DBSM[0]) / (RCS_RANGE_DBSM[1] - RCS_RANGE_DBSM[0])
                }
            };
            let color = match self {
                Self::Velocity => ramps::signed(share.clamp(0.0, 1.0)),
                Self::Rcs => ramps::turbo(1.0 - share.clamp(0.0, 1.0)),
            };
            let radius = DISC_RADIUS_PX[0] + DISC_RADIUS_PX[1] * f64::from(one.snr).clamp(0.0, 60.0);
            let at = sweep.frame.in_sensor(one.position, &sweep.pose, sweep.metres_per_unit);
            let place = field.pixel([at.x, at.y]);
            // Rain is hollow, noise is a dot.
            match one.class {
                RadarClass::Surface => disc(&mut picture, place, [0.0, radius], color),
                RadarClass::Rain => disc(&mut picture, place, [radius, radius + 1.5], color),
                RadarClass::Noise => disc(&mut picture, place, [0.0, 1.0], color),
            }
        }
        picture
    }
}

fn set_pixel(picture: &mut SweepPicture, point: [f64; 2], color: [u8; 3]) {
    let [x, y] = point.map(|v| v.floor() as i64);
    picture.set(x, y, color);
}

/// Fills the ring between two radii about a point, px.
fn disc(picture: &mut SweepPicture, center: [f64; 2], radii: [f64; 2], color: [u8; 3]) {
    let ([x, y], [inner, outer]) = (center, radii);
    let reach = outer.ceil() as i64;
    for row in -reach..=reach {
        for column in -reach..=reach {
            let off = (column as f64).hypot(row as f64);
            if (inner..=outer).contains(&off) {
                set_pixel(picture, [x + column as f64, y + row as f64], color);
            }
        }
    }
}

/// The part of the plane that a picture shows.
struct Field {
    size: PictureSize,
    /// px a metre.
    scale: f64,
    /// m: the farthest ahead and the farthest to the left.
    corner: [f64; 2],
}

impl Field {
    fn of(sweep: &RadarSweep) -> Self {
        let [low, high] = sweep.azimuth;
        // The ends of the arc, its extremes, and the sensor.
        let quarters = (-8..=8).map(|k| f64::from(k) * std::f64::consts::FRAC_PI_2);
        let angles: Vec<f64> =
            quarters.filter(|angle| (low..=high).contains(angle)).chain([low, high]).collect();
        let extent = |of: fn(f64) -> f64| {
            angles
                .iter()
                .map(|angle| sweep.reach * of(*angle))
                .fold([0.0f64; 2], |[least, most], v| [least.min(v), most.max(v)])
        };
        let [[back, ahead], [right, left]] = [extent(f64::cos), extent(f64::sin)];
        let scale = MAX_SIDE_PX / (ahead - back).max(left - right).max(1e-3);
        let pixels = |metres: f64| (metres * scale + 2.0 * MARGIN_PX).ceil() as u32;
        Self {
            size: PictureSize::new(pixels(left - right), pixels(ahead - back)),
            scale,
            corner: [ahead, left],
        }
    }

    /// The pixel of a place, m ahead and to the left.
    fn pixel(&self, point: [f64; 2]) -> [f64; 2] {
        let [x, y] = point;
        [MARGIN_PX + (self.corner[1] - y) * self.scale, MARGIN_PX + (self.corner[0] - x) * self.scale]
    }

    /// Arcs every 10 or 50 m, and the edges of the field of view.
    fn draw_grid(&self, sweep: &RadarSweep, picture: &mut SweepPicture) {
        let [low, high] = sweep.azimuth;
        let at = |range: f64, azimuth: f64| [range * azimuth.cos(), range * azimuth.sin()];
        let step = if sweep.reach > 120.0 { 50.0 } else { 10.0 };
        for ring in 1..=(sweep.reach / step + 1e-6) as u32 {
            let range = step * f64::from(ring);
            let count = ((high - low) * range * self.scale * 2.0).ceil().max(1.0);
            for index in 0..=count as u32 {
                let azimuth = low + (high - low) * f64::from(index) / count;
                set_pixel(picture, self.pixel(at(range, azimuth)), LINE_COLOR);
            }
        }
        let count = (2.0 * sweep.reach * self.scale).ceil().max(1.0);
        for index in 0..=count as u32 {
            let range = sweep.reach * f64::from(index) / count;
            set_pixel(picture, self.pixel(at(range, low)), LINE_COLOR);
            set_pixel(picture, self.pixel(at(range, high)), LINE_COLOR);
        }
    }
}
