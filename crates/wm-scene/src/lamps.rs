//! Lamps and lit windows of a place, which a weather lights by night.
//!
//! They are facts of the scene, kept with its [`crate::Metadata`]: nothing in the photos of a day
//! tells them.

use crate::values::MAX_SCENE_COORDINATE;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// A lamp.
///
/// The luminous intensity at the angle `t` from the aim is `I cos^n t` on the side of the aim, with
/// `n` so that half of it is left at half of the beam's width; without an aim it is the same to all
/// sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// Position, world axes, scene units.
    pub at: [f64; 3],
    /// Luminous flux, lm, above 0.
    #[serde(default = "Lamp::default_lumens")]
    pub lumens: f64,
    /// Colour temperature, K, 1,000 to 20,000.
    #[serde(default = "Lamp::default_kelvin")]
    pub kelvin: f64,
    /// The direction that it shines in, world axes, of any length but 0; `None` for all sides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aim: Option<[f64; 3]>,
    /// Full width of the beam, where half of the intensity is left, degrees, 2 to 178; used with an
    /// aim.
    #[serde(default = "Lamp::default_beam")]
    pub beam: f64,
    /// Radius of the ball that is seen shining, m, above 0, at most 5.
    #[serde(default = "Lamp::default_radius")]
    pub radius: f64,
}

impl Lamp {
    /// Flux of a lamp of a residential street, lm.
    #[must_use]
    pub const fn default_lumens() -> f64 {
        5_000.0
    }

    /// Colour of warm white light-emitting diodes, K.
    #[must_use]
    pub(crate) const fn default_kelvin() -> f64 {
        3_000.0
    }

    /// The beam of a flat lamp that shines by the cosine, degrees.
    #[must_use]
    pub(crate) const fn default_beam() -> f64 {
        120.0
    }

    /// Radius of the lit part of a lamp head, m.
    #[must_use]
    pub(crate) const fn default_radius() -> f64 {
        0.12
    }

    /// A lamp of the defaults that shines to all sides.
    #[must_use]
    pub fn new(at: [f64; 3]) -> Self {
        Self {
            at,
            lumens: Self::default_lumens(),
            kelvin: Self::default_kelvin(),
            aim: None,
            beam: Self::default_beam(),
            radius: Self::default_radius(),
        }
    }

    /// The exponent `n` of its intensity; 0 without an aim.
    #[must_use]
    pub fn exponent(&self) -> f64 {
        match self.aim {
            Some(_) => 0.5f64.ln() / (0.5 * self.beam.to_radians()).cos().ln(),
            None => 0.0,
        }
    }

    /// Luminous intensity on its axis, cd.
    #[must_use]
    pub fn intensity(&self) -> f64 {
        match self.aim {
            // The integral of cos^n over half of all directions is 2 pi / (n + 1).
            Some(_) => self.lumens * (self.exponent() + 1.0) / TAU,
            None => self.lumens / (2.0 * TAU),
        }
    }

    /// The first fault, in one line.
    fn fault(&self) -> Option<String> {
        let range = |name: &str, value: f64, range: RangeInclusive<f64>, unit: &str| {
            let (low, high) = (range.start(), range.end());
            (!range.contains(&value))
                .then(|| format!("its {name} is {value} {unit}: it must be from {low} to {high}"))
        };
        if !is_near(&self.at) {
            return Some("its place must be finite and within 10^10 units of zero".into());
        }
        if self.aim.is_some_and(|aim| !is_finite(&aim) || aim == [0.0; 3]) {
            return Some("its aim must be finite and not 0".into());
        }
        range("flux", self.lumens, 1e-3..=1e7, "lm")
            .or_else(|| range("colour temperature", self.kelvin, 1e3..=2e4, "K"))
            .or_else(|| range("beam", self.beam, 2.0..=178.0, "degrees"))
            .or_else(|| range("radius", self.radius, 1e-3..=5.0, "m"))
    }
}

/// A lit window: a rectangle that shines like paper lit from behind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LitWindow {
    /// A lower corner, world axes, scene units.
    pub corner: [f64; 3],
    /// From there along the lower edge, to the right as seen from outside.
    pub across: [f64; 3],
    /// From the corner along the edge upwards.
    pub upwards: [f64; 3],
    /// Luminance, cd/m^2, above 0.
    #[serde(default = "LitWindow::default_luminance")]
    pub luminance: f64,
    /// Colour temperature, K, 1,000 to 20,000.
    #[serde(default = "LitWindow::default_kelvin")]
    pub kelvin: f64,
}

impl LitWindow {
    /// Luminance of a room's window with its lights on, cd/m^2.
    #[must_use]
    pub const fn default_luminance() -> f64 {
        30.0
    }

    /// Colour of living rooms, K.
    #[must_use]
    pub(crate) const fn default_kelvin() -> f64 {
        2_700.0
    }

    /// The upright rectangle between two opposite corners on a wall. `up` has length 1; `eye` is on
    /// the wall's outside. `None` if the corners are above each other or level.
    #[must_use]
    pub fn between(corners: [DVec3; 2], up: DVec3, eye: DVec3) -> Option<Self> {
        let [low, high] =
            if up.dot(corners[0]) <= up.dot(corners[1]) { corners } else { [corners[1], corners[0]] };
        let diagonal = high - low;
        let upwards = up * up.dot(diagonal);
        let across = diagonal - upwards;
        let least = 1e-3 * diagonal.length();
        if !diagonal.is_finite() || upwards.length() <= least || across.length() <= least {
            return None;
        }
        // Seen from outside, across x upwards points to the eye.
        let is_outside = across.cross(upwards).dot(eye - low) >= 0.0;
        let (corner, across) = if is_outside { (low, across) } else { (low + across, -across) };
        Some(Self {
            corner: corner.to_array(),
            across: across.to_array(),
            upwards: upwards.to_array(),
            luminance: Self::default_luminance(),
            kelvin: Self::default_kelvin(),
        })
    }

    /// The middle, and the outward normal as long as the area, both in world axes, scene units.
    #[must_use]
    pub fn middle_and_area(&self) -> (DVec3, DVec3) {
        let [corner, across, upwards] = [self.corner, self.across, self.upwards].map(DVec3::from_array);
        (corner + 0.5 * (across + upwards), across.cross(upwards))
    }

    /// The first fault, in one line.
    fn fault(&self) -> Option<String> {
        if ![self.corner, self.across, self.upwards].iter().all(is_near) {
            return Some("its corner and edges must be finite and within 10^10 units of zero".into());
        }
        let (middle, area) = self.middle_and_area();
        if !middle.is_finite() || !area.is_finite() || area.length() <= 0.0 {
            return Some("its edges must make a rectangle".into());
        }
        if !(1e-3..=1e6).contains(&self.luminance) {
            let luminance = self.luminance;
            return Some(format!("its luminance is {luminance} cd/m^2: it must be from 0.001 to 1e6"));
        }
        (!(1e3..=2e4).contains(&self.kelvin)).then(|| {
            let kelvin = self.kelvin;
            format!("its colour temperature is {kelvin} K: it must be from 1000 to 20000")
        })
    }
}

/// Most lamps, and most windows, of a place.
pub(crate) const MAX_LAMPS: usize = 256;

/// The first fault of lamps and windows, in one line.
pub(crate) fn fault(lamps: &[Lamp], windows: &[LitWindow]) -> Option<String> {
    for (name, count) in [("lamps", lamps.len()), ("windows", windows.len())] {
        if count > MAX_LAMPS {
            return Some(format!("{name}: {count} are too many; there may be {MAX_LAMPS}"));
        }
    }
    let first = |name: &str, index: usize, fault: String| format!("{name}: number {}: {fault}", index + 1);
    let lamp = lamps.iter().enumerate().find_map(|(i, lamp)| Some(first("lamps", i, lamp.fault()?)));
    let window =
        || windows.iter().enumerate().find_map(|(i, window)| Some(first("windows", i, window.fault()?)));
    lamp.or_else(window)
}

/// Returns true for a point that a scene can have.
fn is_near(point: &[f64; 3]) -> bool {
    point.iter().all(|v| v.abs() <= f64::from(MAX_SCENE_COORDINATE))
}

fn is_finite(v: &[f64; 3]) -> bool {
    v.iter().all(|v| v.is_finite())
}

/// Lamps along a line of points: a row at `spacing` on one side of it, `aside` from it and `height`
/// above the ground under it, each shining down. All lengths are in scene units, `up` has length 1,
/// and `ground` is the height of the ground along it under each point.
#[must_use]
pub fn along_path(
    path: &[DVec3],
    up: DVec3,
    ground: impl Fn(DVec3) -> f64,
    spacing: f64,
    aside: f64,
    height: f64,
) -> Vec<Lamp> {
    let level: Vec<DVec3> = path.iter().map(|point| *point - up * up.dot(*point)).collect();
    let length: f64 = level.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    let count = (length / spacing).floor().clamp(0.0, (MAX_LAMPS - 1) as f64) as usize + 1;
    // In the middle of what is left at both ends.
    let first = 0.5 * (length - spacing * (count - 1) as f64).max(0.0);
    let mut lamps = Vec::with_capacity(count);
    for index in 0..count {
        let mut left = first + spacing * index as f64;
        let mut at = level.first().copied().unwrap_or_default();
        let mut along = DVec3::ZERO;
        for pair in level.windows(2) {
            let step = pair[1] - pair[0];
            along = step.try_normalize().unwrap_or(along);
            at = pair[0] + along * left.min(step.length());
            left -= step.length();
            if left <= 0.0 {
                break;
            }
        }
        let side = along.cross(up);
        let foot = at + side * aside;
        let at = foot + up * (ground(foot) + height);
        lamps.push(Lamp { aim: Some((-up).to_array()), ..Lamp::new(at.to_array()) });
    }
    lamps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The flux of a lamp comes back from its intensity summed over all directions.
    #[test]
    fn the_intensity_holds_the_flux() {
        for beam in [20.0, 60.0, 120.0, 170.0] {
            let lamp = Lamp { aim: Some([0.0, 0.0, -1.0]), beam, ..Lamp::new([0.0; 3]) };
            let n = 100_000;
            let sum: f64 = (0..n)
                .map(|i| ((f64::from(i) + 0.5) / f64::from(n)).powf(lamp.exponent()) / f64::from(n))
                .sum();
            assert!((lamp.intensity() * TAU * sum / lamp.lumens - 1.0).abs() < 1e-3, "{beam}");
            let half = (0.5 * beam.to_radians()).cos().powf(lamp.exponent());
            assert!((half - 0.5).abs() < 1e-9, "{half}");
        }
        assert!((Lamp::new([0.0; 3]).intensity() * 2.0 * TAU - 5_000.0).abs() < 1e-9);
    }

    #[test]
    fn a_window_between_two_corners_looks_out() {
        let corners = [DVec3::new(1.0, 4.0, 3.0), DVec3::new(2.0, 4.0, 1.5)];
        for eye in [DVec3::ZERO, DVec3::new(0.0, 9.0, 0.0)] {
            let window = LitWindow::between(corners, DVec3::Z, eye).unwrap();
            let (middle, out) = window.middle_and_area();
            assert!(middle.distance(DVec3::new(1.5, 4.0, 2.25)) < 1e-12);
            assert!((out.length() - 1.5).abs() < 1e-12 && out.dot(eye - middle) > 0.0, "{out}");
            assert_eq!(window.upwards, [0.0, 0.0, 1.5]);
        }
        assert_eq!(LitWindow::between([DVec3::ZERO, DVec3::Z], DVec3::Z, DVec3::X), None);
    }

    #[test]
    fn a_row_along_a_path_keeps_its_spacing() {
        let path = [DVec3::new(0.0, 0.0, 1.6), DVec3::new(60.0, 0.0, 1.7), DVec3::new(60.0, 45.0, 1.6)];
        let lamps = along_path(&path, DVec3::Z, |_| 0.2, 25.0, 3.0, 6.0);
        assert_eq!(lamps.len(), 5);
        assert!(lamps.iter().all(|lamp| (lamp.at[2] - 6.2).abs() < 1e-12));
        assert_eq!(lamps[0].at[..2], [2.5, -3.0]);
        assert_eq!(lamps[4].at[..2], [63.0, 42.5]);
        // One stands where nobody walked.
        assert_eq!(along_path(&path[..1], DVec3::Z, |_| 0.0, 25.0, 3.0, 6.0).len(), 1);
    }

    #[test]
    fn faults_are_said() {
        let say = |lamp: Lamp| fault(&[Lamp::new([0.0; 3]), lamp], &[]).unwrap();
        let base = Lamp::new([1.0; 3]);
        assert_eq!(
            say(Lamp { lumens: -5.0, ..base }),
            "lamps: number 2: its flux is -5 lm: it must be from 0.001 to 10000000"
        );
        assert!(say(Lamp { at: [f64::NAN; 3], ..base }).contains("finite"));
        assert!(say(Lamp { aim: Some([0.0; 3]), ..base }).contains("aim"));
        assert!(fault(&vec![base; 300], &[]).unwrap().contains("too many"));
    }
}
