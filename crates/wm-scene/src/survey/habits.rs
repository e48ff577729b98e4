//! Up from the poses of photos, by the habits of people who take them.
//!
//! People hold cameras upright: on the mean to about 6 degrees in pitch, and to about 1.5 degrees
//! in roll. A drone that surveys an area looks straight down while it flies back and forth in a
//! level plane; its pictures' up is then a level direction and says nothing.

use crate::Camera;
use glam::{DMat3, DVec3};
use wm_base::linear::{eigen, outer};

/// A direction that is up if photos were taken by this habit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Habit {
    /// The habit.
    pub kind: HabitKind,
    /// Up, length 1.
    pub up: DVec3,
    /// Natural logarithm of how likely the habit is, given the poses.
    pub log_odds: f64,
}

/// A habit of taking photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HabitKind {
    /// Cameras are held upright.
    Upright,
    /// Cameras look straight down from a level plane.
    LookingDown,
}

/// Standard deviation of up by the habit [`HabitKind::Upright`] and [`HabitKind::LookingDown`],
/// degrees: neighbouring photos err alike.
const UP_ERRORS_DEG: [f64; 2] = [12.0, 8.0];
/// Largest penalty of one habit against a direction, nats: habits have exceptions.
const MAX_PENALTY_NATS: f64 = 5.0;
/// Least length of the mean view direction with which all cameras look one way: 20 degrees about
/// it.
const MIN_MEAN_VIEW_LENGTH: f64 = 0.94;
/// Least cosine of the angle between view directions and the normal of the plane of the cameras: 35
/// degrees.
const MIN_FACING_COS: f64 = 0.82;
/// Largest thickness of that plane over its width, as a ratio of standard deviations.
const MAX_FLATNESS: f64 = 0.25;
/// Least width of that plane over its length, as a ratio of standard deviations.
const MIN_WIDTH_RATIO: f64 = 0.25;
/// Share of captures that scan a plane at right angles and are no survey from the air: facades,
/// paintings.
const FACADE_SHARE: f64 = 0.15;
/// Fewest cameras that determine a plane.
const MIN_CAMERAS: usize = 6;

impl Habit {
    /// Standard deviation of its up, degrees.
    #[must_use]
    pub fn error(&self) -> f64 {
        UP_ERRORS_DEG[usize::from(self.kind == HabitKind::LookingDown)]
    }
}

/// The habits by which these photos may have been taken; empty if their poses tell nothing.
#[must_use]
pub fn habits(cameras: &[Camera]) -> Vec<Habit> {
    let down = looking_down(cameras);
    let odds = if down.is_some() { [FACADE_SHARE, 1.0 - FACADE_SHARE] } else { [1.0, 0.0] };
    let upright =
        up_of_upright(cameras).map(|up| Habit { kind: HabitKind::Upright, up, log_odds: odds[0].ln() });
    let down = down.map(|up| Habit { kind: HabitKind::LookingDown, up, log_odds: odds[1].ln() });
    [upright, down].into_iter().flatten().collect()
}

/// Logarithm of how well `up` fits the habits, at most 0; 0 without any.
#[must_use]
pub fn fit(up: DVec3, habits: &[Habit]) -> f64 {
    let one = |habit: &Habit| {
        let off = up.angle_between(habit.up).to_degrees() / habit.error();
        habit.log_odds - (0.5 * off * off).min(MAX_PENALTY_NATS)
    };
    habits.iter().map(one).reduce(f64::max).unwrap_or(0.0)
}

/// Up as upright cameras have it; `None` if they do not tell.
///
/// The mean of the pictures' ups is known to some degrees; the direction to which all x axes are
/// level is known better the more ways they look.
fn up_of_upright(cameras: &[Camera]) -> Option<DVec3> {
    let count = cameras.len() as f64;
    let (mut mean, mut moments) = (DVec3::ZERO, DMat3::ZERO);
    for camera in cameras {
        mean += camera.up() / count;
        moments += outer(camera.rotation().row(0), 1.0 / count);
    }
    // Cameras that are held every way have no common up.
    if cameras.is_empty() || mean.length() < 0.2 {
        return None;
    }
    let mean = mean.normalize();
    let [(least, axis), (spread, _), _] = eigen(moments);
    let axis = if axis.dot(mean) < 0.0 { -axis } else { axis };
    if least > 0.2 * spread || axis.dot(mean) < 0.3 {
        return Some(mean);
    }
    // Precisions; neighbouring views err alike, so that four count as independent.
    let (level, upright) = (4.0 * spread / 0.026f64.powi(2), 1.0 / 0.105f64.powi(2));
    Some((axis * level + mean * upright).normalize())
}

/// Up of cameras that all look at right angles to the plane in which they lie, to its far side;
/// `None` if they do not.
fn looking_down(cameras: &[Camera]) -> Option<DVec3> {
    let count = cameras.len() as f64;
    if cameras.len() < MIN_CAMERAS {
        return None;
    }
    let forward: DVec3 = cameras.iter().map(|camera| camera.rotation().row(2)).sum::<DVec3>() / count;
    let center = cameras.iter().map(Camera::center).sum::<DVec3>() / count;
    let spread =
        cameras.iter().fold(DMat3::ZERO, |sum, camera| sum + outer(camera.center() - center, 1.0 / count));
    let [(thin, normal), (narrow, _), (wide, _)] = eigen(spread);
    let is_plane =
        narrow > MIN_WIDTH_RATIO * MIN_WIDTH_RATIO * wide && thin < MAX_FLATNESS * MAX_FLATNESS * narrow;
    let facing =
        forward.length() > MIN_MEAN_VIEW_LENGTH && forward.normalize().dot(normal).abs() > MIN_FACING_COS;
    // The plane's normal and the mean view direction err in different ways.
    let up = (-normal * normal.dot(forward).signum() - forward.normalize_or_zero()).normalize_or_zero();
    (is_plane && facing && up.is_finite()).then_some(up)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: DVec3, forward: DVec3, up: DVec3) -> Camera {
        Camera::looking((64, 48), 50.0, eye, eye + forward, up).unwrap()
    }

    #[test]
    fn a_survey_from_the_air_looks_down_whatever_its_pictures_call_up() {
        for flips in [false, true] {
            let cameras: Vec<Camera> = (0..20)
                .map(|i| {
                    let eye = DVec3::new(f64::from(i % 5) * 10.0, f64::from(i / 5) * 12.0, 50.0);
                    let north = if flips && i / 5 % 2 == 1 { DVec3::NEG_Y } else { DVec3::Y };
                    camera(eye, DVec3::new(0.05, 0.03, -1.0), north)
                })
                .collect();
            let found = habits(&cameras);
            let down = found.iter().find(|habit| habit.kind == HabitKind::LookingDown).unwrap();
            assert!(down.up.angle_between(DVec3::Z).to_degrees() < 4.0, "{}", down.up);
            assert!(fit(DVec3::Z, &found) > fit(DVec3::Y, &found) + 1.0);
        }
    }

    #[test]
    fn walks_and_rings_are_upright() {
        let walk: Vec<Camera> = (0..20)
            .map(|i| {
                let eye = DVec3::new(f64::from(i), 0.1 * f64::from(i % 3), 1.6);
                camera(eye, DVec3::new(1.0, 0.1, -0.05), DVec3::Z)
            })
            .collect();
        let ring: Vec<Camera> = (0..20)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * 0.314).sin_cos();
                camera(DVec3::new(cos, sin, 1.0) * 30.0, DVec3::new(-cos, -sin, -1.0), DVec3::Z)
            })
            .collect();
        for cameras in [walk, ring] {
            let found = habits(&cameras);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].kind == HabitKind::Upright && found[0].up.dot(DVec3::Z) > 0.998, "{found:?}");
        }
        assert!(habits(&[]).is_empty());
    }
}
