//! How large a place is, by how high people hold cameras.

use wm_scene::survey::Survey;
use wm_scene::{Camera, View};

/// Height above the ground at which photos are taken by hand, m.
pub const HELD_AT: f64 = 1.6;
/// Steepest view of a camera that is held level, sine of its angle.
const LEVEL: f64 = 0.3;

/// Metres a unit, if the photos were taken by a person who stands on the ground and looks ahead: nearly
/// all of them level, and all at nearly one height. `None` for anything else, drones above all.
#[must_use]
pub fn by_camera_height(views: &[View], survey: &Survey) -> Option<f64> {
    let up = survey.up.value;
    let is_level = |camera: &Camera| camera.forward().dot(up).abs() < LEVEL;
    let level = views.iter().filter(|view| is_level(&view.camera)).count();
    if views.len() < 3 || level * 10 < views.len() * 9 {
        return None;
    }
    let mut heights: Vec<f64> = views.iter().map(|view| survey.height(view.camera.center())).collect();
    heights.sort_by(f64::total_cmp);
    let quantile = |share: f64| heights[((heights.len() - 1) as f64 * share) as usize];
    let middle = quantile(0.5);
    (middle > 0.0 && quantile(0.9) - quantile(0.1) < middle).then(|| HELD_AT / middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_scene::{Metadata, Scene};

    fn views(height: f64, down: f64) -> Vec<View> {
        (0..6)
            .map(|i| {
                let eye = DVec3::new(f64::from(i), 0.0, height);
                let target = eye + DVec3::new(0.0, 4.0, -down);
                View {
                    name: i.to_string(),
                    camera: Camera::look_at((60, 40), 50.0, eye, target, DVec3::Z).unwrap(),
                }
            })
            .collect()
    }

    #[test]
    fn only_level_photos_tell_a_height() {
        let given = Metadata { up: Some(DVec3::Z), ground: Some(0.0), ..Metadata::default() };
        let survey = Survey::of(&Scene::default(), &given);
        assert!((by_camera_height(&views(0.4, 0.2), &survey).unwrap() - 4.0).abs() < 1e-9);
        assert_eq!(by_camera_height(&views(30.0, 20.0), &survey), None);
        assert_eq!(by_camera_height(&views(-1.0, 0.0), &survey), None);
        assert_eq!(by_camera_height(&views(0.4, 0.2)[..2], &survey), None);
    }
}
