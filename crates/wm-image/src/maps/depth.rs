//! The meaning of the numbers in a depth map.

use super::error::MapFault;
use super::map::Map;
use std::str::FromStr;
use wm_scene::Camera;

/// The quantity that a depth map holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthForm {
    /// View z: the distance from the camera's plane.
    #[default]
    Z,
    /// The distance from the camera's centre, along the ray.
    Ray,
    /// 1 / view z, as stereo and most networks give it; 0 is infinitely far.
    Disparity,
}

impl FromStr for DepthForm {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "z" => Ok(Self::Z),
            "ray" => Ok(Self::Ray),
            "disparity" => Ok(Self::Disparity),
            _ => Err(format!(
                "`{text}` is no kind of depth: z (from the camera's plane), ray (from its centre) or disparity (1 / z)"
            )),
        }
    }
}

impl DepthForm {
    /// View z of each pixel's centre, scene units, `[H, W]` of the map; 0 where it is not known,
    /// infinite in the sky.
    ///
    /// Not known are values that are negative, NaN, or 0 but for disparity. `camera` may have
    /// another size: it is resized. `scale` is the scene units (for disparity, the 1 / scene units)
    /// that a value of 1 stands for, above 0.
    ///
    /// # Errors
    /// [`MapFault::Channels`] if the map has not one channel.
    pub fn to_view_z(self, scale: f64, map: &Map, camera: &Camera) -> Result<Vec<f32>, MapFault> {
        let mut values = map.grey()?;
        let camera = camera.resized(map.width, map.height);
        let width = map.width as usize;
        for (index, value) in values.iter_mut().enumerate() {
            let stored = f64::from(*value) * scale;
            let z = match self {
                Self::Z => stored,
                Self::Ray => {
                    let (x, y) = ((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
                    let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
                    stored / (u * u + v * v + 1.0).sqrt()
                }
                Self::Disparity if stored == f64::INFINITY => f64::NAN,
                Self::Disparity if stored == 0.0 => f64::INFINITY,
                Self::Disparity => 1.0 / stored,
            };
            *value = if z > 0.0 { z as f32 } else { 0.0 };
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_scene::Camera;

    const HOLES: [f32; 4] = [f32::NAN, -1.0, f32::INFINITY, 0.0];

    #[test]
    fn every_form_gives_the_same_surface() {
        let camera = Camera::looking((8, 6), 60.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        // A wall 5 units ahead; the map is half as large.
        let small = camera.resized(4, 3);
        let point = |x: u32, y: u32| {
            let ray = small.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            ray * (5.0 / ray.dot(camera.forward()))
        };
        let pixels = || (0..3).flat_map(|y| (0..4).map(move |x| (x, y)));
        let ray: Vec<f32> = pixels().map(|(x, y)| (point(x, y).length() / 0.5) as f32).collect();
        for (form, values, scale) in [
            (DepthForm::Z, vec![2500.0; 12], 0.002),
            (DepthForm::Ray, ray, 0.5),
            (DepthForm::Disparity, vec![20.0; 12], 0.01),
        ] {
            let found = form.to_view_z(scale, &Map::new(4, 3, 1, values), &camera).unwrap();
            assert!(found.iter().all(|z| (z - 5.0).abs() < 1e-5), "{form:?}: {found:?}");
        }
    }

    #[test]
    fn holes_are_unknown_and_the_sky_is_far() {
        let camera = Camera::looking((4, 1), 60.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        let map = Map::new(4, 1, 1, HOLES.into());
        let found = |form: DepthForm| form.to_view_z(1.0, &map, &camera).unwrap();
        for form in [DepthForm::Z, DepthForm::Ray] {
            assert_eq!(found(form), [0.0, 0.0, f32::INFINITY, 0.0]);
        }
        assert_eq!(found(DepthForm::Disparity), [0.0, 0.0, 0.0, f32::INFINITY]);
    }
}
