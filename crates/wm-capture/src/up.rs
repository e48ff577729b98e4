//! Up of a capture, from its cameras and the positions of its photos, before there are any splats.

use super::gps::GpsFit;
use glam::{DMat2, DMat3, DVec2, DVec3};
use std::fmt;
use wm_base::linear::horizontals;
use wm_scene::Camera;
use wm_scene::survey::habits::{Habit, HabitKind, habits};

/// Up of a capture, and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureUp {
    /// The direction against gravity, world axes, length 1.
    pub up: DVec3,
    /// Standard deviation in the direction in which it is known least, degrees.
    pub error: f64,
    /// The evidence for it.
    pub evidence: UpEvidence,
}

/// The evidence for up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UpEvidence {
    /// It was given.
    Given,
    /// The GPS positions of photos, and how far from the cameras they lie, m.
    Gps {
        /// Photos with a position.
        photos: usize,
        /// Median distance, m.
        residual: f64,
    },
    /// Cameras were held upright.
    Upright,
    /// Cameras look straight down from a level plane.
    LookingDown,
}

impl fmt::Display for UpEvidence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Given => f.write_str("given"),
            Self::Gps { photos, residual } => {
                write!(f, "the GPS of {photos} photos, met within {residual:.1} m")
            }
            Self::Upright => f.write_str("the cameras, if they were held upright"),
            Self::LookingDown => f.write_str("the cameras, which look straight down from a level plane"),
        }
    }
}

/// Error of GPS up, degrees, below which it is used alone; above it, the habits of photographers
/// are combined with it.
const SURE_GPS_ERROR_DEG: f64 = 3.0;
/// Elevation of the lowest sky if up is known exactly, degrees: the horizon of hills and of the sea
/// lies near 0.
const MIN_SKY_ELEVATION_DEG: f64 = -2.0;
/// Largest angle by which a doubtful up lowers that elevation, degrees.
const MAX_DOUBT_DEG: f64 = 20.0;

impl CaptureUp {
    /// Finds up; `None` if nothing tells it.
    #[must_use]
    pub fn of(cameras: &[Camera], gps: Option<&GpsFit>) -> Option<Self> {
        let habits = habits(cameras);
        let Some(gps) = gps.filter(|gps| gps.information != DMat3::ZERO) else {
            return habits.into_iter().max_by(|a, b| a.log_odds.total_cmp(&b.log_odds)).map(|habit| Self {
                up: habit.up,
                error: habit.error(),
                evidence: match habit.kind {
                    HabitKind::Upright => UpEvidence::Upright,
                    HabitKind::LookingDown => UpEvidence::LookingDown,
                },
            });
        };
        let evidence = UpEvidence::Gps { photos: gps.photos, residual: gps.residual };
        let alone = Self { up: gps.up, error: gps.up_error().to_degrees(), evidence };
        if alone.error < SURE_GPS_ERROR_DEG {
            return Some(alone);
        }
        // Of the habits the one that the positions contradict least fills in what they leave open.
        let filled = habits.iter().map(|habit| filled(gps, habit, evidence));
        let best = filled.min_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, up)| up);
        Some(best.unwrap_or(alone))
    }

    /// Sine of the elevation below which no photo can show the sky.
    #[must_use]
    pub fn lowest_sky(&self) -> f64 {
        (MIN_SKY_ELEVATION_DEG - (2.0 * self.error).min(MAX_DOUBT_DEG)).to_radians().sin()
    }
}

/// Up by positions and a habit together, and how far apart the two are (squared, in standard
/// deviations).
fn filled(gps: &GpsFit, habit: &Habit, evidence: UpEvidence) -> (f64, CaptureUp) {
    let (x, y) = horizontals(habit.up);
    let known = DMat2::from_cols(
        DVec2::new(x.dot(gps.information * x), x.dot(gps.information * y)),
        DVec2::new(x.dot(gps.information * y), y.dot(gps.information * y)),
    );
    let prior = DMat2::from_diagonal(DVec2::splat(habit.error().to_radians().powi(-2)));
    let off = DVec2::new(gps.up.dot(x), gps.up.dot(y));
    let covariance = (known + prior).inverse();
    let step = covariance * (known * off);
    let rest = off - step;
    let distance = rest.dot(known * rest) + step.dot(prior * step) - 2.0 * habit.log_odds;
    let up = (habit.up + x * step.x + y * step.y).normalize();
    let error = covariance.col(0).x.max(covariance.col(1).y).sqrt().to_degrees();
    (distance, CaptureUp { up, error, evidence })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gps(up: DVec3, information: DMat3) -> GpsFit {
        GpsFit {
            metres_per_unit: 1.0,
            up,
            north: DVec3::Y,
            information,
            residual: 1.0,
            extent: 100.0,
            photos: 9,
        }
    }

    fn walk() -> Vec<Camera> {
        let camera = |i: i32| {
            let eye = DVec3::X * f64::from(i);
            Camera::looking((64, 48), 50.0, eye, eye + DVec3::new(1.0, 0.1, -0.05), DVec3::Z).unwrap()
        };
        (0..12).map(camera).collect()
    }

    #[test]
    fn positions_that_tell_up_are_believed() {
        let known = gps(DVec3::new(0.6, 0.0, 0.8), DMat3::from_diagonal(DVec3::splat(1e5)));
        let found = CaptureUp::of(&walk(), Some(&known)).unwrap();
        assert_eq!(found.up, known.up);
        assert!(found.error < 1.0 && matches!(found.evidence, UpEvidence::Gps { .. }));
        // No sky where photos look below the horizon.
        assert!(found.lowest_sky() < -0.03 && found.lowest_sky() > -0.1);
    }

    #[test]
    fn what_positions_leave_open_the_cameras_fill() {
        // Along x: up may turn towards y as it likes, and is 10 degrees off towards x.
        let tilted = DVec3::new(0.17, 0.6, 0.78).normalize();
        let line = gps(tilted, DMat3::from_diagonal(DVec3::new(1e4, 0.0, 0.0)));
        let found = CaptureUp::of(&walk(), Some(&line)).unwrap();
        assert!((found.up.x - tilted.x).abs() < 0.02 && found.up.y.abs() < 0.1, "{}", found.up);
        assert!(found.error > 5.0);
        let alone = CaptureUp::of(&walk(), None).unwrap();
        assert!(alone.up.dot(DVec3::Z) > 0.99 && alone.evidence == UpEvidence::Upright);
        assert_eq!(CaptureUp::of(&[], None), None);
    }
}
