//! The meaning of the numbers in a normal map.

use super::error::MapFault;
use super::map::{Map, Stored};
use glam::DVec3;
use std::str::FromStr;
use wm_scene::Camera;

/// Vectors shorter than this are no normals: those of 8 bits are off by up to 0.007.
const MIN_NORMAL_LENGTH: f64 = 0.05;

/// The axes of normals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalAxes {
    /// The axes of the scene.
    #[default]
    World,
    /// The axes of the camera: x right, y down, z forward (OpenCV).
    Camera,
    /// x right, y up, z towards the viewer (OpenGL), as pictures of normals mostly are.
    OpenGl,
}

impl FromStr for NormalAxes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "world" => Ok(Self::World),
            "camera" => Ok(Self::Camera),
            "opengl" => Ok(Self::OpenGl),
            _ => Err(format!(
                "`{text}` are no axes of normals: world, camera (x right, y down, z forward) or opengl (x right, y up, z back)"
            )),
        }
    }
}

impl NormalAxes {
    /// Normals in world axes, length 1, `[H, W, 3]` of the map; 0 where there is none.
    ///
    /// Counts stand for `2 v - 1` with v their share of the highest count, floats for themselves.
    /// Where a number is not finite or the vector has no length, there is none.
    ///
    /// # Errors
    /// [`MapFault::Channels`] if there are fewer than three.
    pub fn to_world(self, map: &Map, camera: &Camera) -> Result<Vec<f32>, MapFault> {
        let world_from_camera = camera.rotation().transpose();
        let mut out = Vec::with_capacity(3 * map.pixels());
        for values in map.triples()? {
            let local = DVec3::from_array(values.map(|value| match map.stored {
                Stored::Floats => f64::from(value),
                Stored::Counts(full) => 2.0 * f64::from(value) / f64::from(full) - 1.0,
            }));
            let world = match self {
                Self::World => local,
                Self::Camera => world_from_camera * local,
                Self::OpenGl => world_from_camera * DVec3::new(local.x, -local.y, -local.z),
            };
            let normal =
                if world.length() > MIN_NORMAL_LENGTH { world.normalize_or_zero() } else { DVec3::ZERO };
            out.extend(normal.as_vec3().to_array());
        }
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_turned_into_those_of_the_world() {
        let camera = Camera::looking((4, 1), 60.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        // Up, in each kind of axes.
        for (axes, up) in [
            (NormalAxes::World, [0.0, 0.0, 2.0]),
            (NormalAxes::Camera, [0.0, -1.0, 0.0]),
            (NormalAxes::OpenGl, [0.0, 1.0, 0.0]),
        ] {
            let found = axes.to_world(&Map::new(1, 1, 3, up.into()), &camera).unwrap();
            assert!((found[2] - 1.0).abs() < 1e-6, "{axes:?}: {found:?}");
        }
        let holes = [f32::NAN, 0.0, 1.0, 0.0, 0.0, 0.0, f32::INFINITY, 0.0, 0.0];
        assert_eq!(NormalAxes::World.to_world(&Map::new(3, 1, 3, holes.into()), &camera).unwrap(), [0.0; 9]);
        let fault = NormalAxes::World.to_world(&Map::new(1, 1, 1, vec![1.0]), &camera).unwrap_err();
        assert!(fault.to_string().starts_with("1 different channels, but three"), "{fault}");
    }
}
