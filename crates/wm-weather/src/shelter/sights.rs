//! What the cameras of the photos see through is no surface.
//!
//! Between a camera and what it sees the air is free. Reconstructions have splats there all the same, where no photo tells:
//! flat ones that all cameras see edge on, or too near to a camera to be drawn. From above they would be roofs. So a
//! splat stops nothing if its middle is clearly before what at least two cameras see there, and more of them see
//! through it than see it. Cameras that it is hidden from do not count.

use super::Occluders;
use crate::threads::map;
use glam::DVec3;
use wm_scene::Camera;

/// How far before the surface something is that is seen through, as a share of the way, and m.
const SHARE: f64 = 0.1;
const LEAST: f64 = 0.1;
/// How many cameras must see through it.
const CAMERAS: u32 = 2;

/// What a camera sees.
#[derive(Clone, Debug)]
pub struct Sight {
    /// From where.
    pub camera: Camera,
    /// View z of the surface in each pixel, scene units, `[H, W]`; 0 where there is none.
    pub depth: Vec<f32>,
}

/// What one camera says of a point.
enum Word {
    Seen,
    Through,
    /// It is off the picture, or behind something.
    Nothing,
}

impl Sight {
    fn of(&self, point: DVec3, metres_per_unit: f64) -> Word {
        let Some((x, y, z)) = self.camera.project(point) else { return Word::Nothing };
        let (width, height) = (i64::from(self.camera.width), i64::from(self.camera.height));
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        // With a pixel about it, since edges are not exact.
        if x < 1 || y < 1 || x + 1 >= width || y + 1 >= height {
            return Word::Nothing;
        }
        let pixels = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (y * width + x) as usize));
        let nearest = pixels
            .map(|pixel| match self.depth[pixel] {
                0.0 => f64::INFINITY,
                depth => f64::from(depth),
            })
            .fold(f64::INFINITY, f64::min);
        if z * (1.0 + SHARE) + LEAST / metres_per_unit < nearest {
            Word::Through
        } else if z < nearest * (1.0 + SHARE) + LEAST / metres_per_unit {
            Word::Seen
        } else {
            Word::Nothing
        }
    }
}

impl Occluders {
    /// Those that the cameras do not see through.
    #[must_use]
    pub fn seen_by(mut self, sights: &[Sight], threads: Option<usize>) -> Self {
        let threads = super::occluders::count(threads);
        let origin = DVec3::from_array(self.origin);
        let stays = map(self.all.len(), threads, |index| {
            let point = origin + DVec3::from_array(self.all[index].mean.map(f64::from));
            let (mut seen, mut through) = (0, 0);
            for sight in sights {
                match sight.of(point, self.metres_per_unit) {
                    Word::Seen => seen += 1,
                    Word::Through => through += 1,
                    Word::Nothing => {}
                }
            }
            through < CAMERAS || through <= seen
        });
        let mut stays = stays.into_iter();
        self.all.retain(|_| stays.next().unwrap_or(true));
        self
    }
}
