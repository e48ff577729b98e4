//! The surface that one photo's camera sees, and its evidence about points.

use super::FloorPlane;
use glam::{DMat3, DVec3};
use wm_scene::Camera;

/// Distance in front of the surface from which a point is seen through, as a share of the ray's length, and m.
const BEFORE: [f64; 2] = [0.1, 0.1];
/// Distance from the visible surface within which a point is part of it, the same.
const WITH: [f64; 2] = [0.04, 0.1];
/// Pixels to each side that a normal is found from, and how often those are weighed.
const ASIDE: i64 = 3;
const ROUNDS: usize = 3;
/// Largest distance of a pixel from its plane, as a share of its inverse depth; more is an edge.
const OFF: f64 = 0.03;
/// Least cosine between a ray and the normal for the distance between pixels along a surface; and how many places are taken
/// of a pixel of a floor, which is known between pixels too.
const GRAZING: f64 = 0.15;
const MOST: f64 = 32.0;

/// The surface that one photo's camera sees: depth, colour and floors.
#[derive(Clone, Debug)]
pub struct PhotoView {
    /// From where.
    pub(super) camera: Camera,
    /// View z of the surface in each pixel, scene units, `[H, W]`; 0 where there is none.
    pub(super) depth: Vec<f32>,
    /// Its colour, display-referred, `[H, W, 3]`.
    rgb: Vec<f32>,
    /// Floors, and which of them each pixel shows, from 1; 0 for none.
    pub(super) floors: Vec<FloorPlane>,
    pub(super) on: Vec<u16>,
}

/// The evidence of one camera about a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Word {
    /// The point is on the visible surface.
    Seen { floor: bool },
    /// The camera sees through the point.
    Through { floor: bool },
    /// It is off the picture, or behind something.
    Nothing,
}

/// The surface in one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// World, scene units.
    pub point: DVec3,
    /// Towards the camera, length 1; `None` at edges.
    pub normal: Option<DVec3>,
    /// From the camera, length 1.
    pub ray: DVec3,
    /// Distance to the neighbouring pixels' points, scene units.
    pub apart: f64,
    pub rgb: [f32; 3],
}

impl PhotoView {
    /// From where a camera is: view z of the surface in each pixel, scene units, `[H, W]`, 0 where there is none; and its
    /// colour, display-referred, `[H, W, 3]`, grey where that is empty.
    #[must_use]
    pub fn new(camera: Camera, depth: Vec<f32>, rgb: Vec<f32>) -> Self {
        Self { camera, on: vec![0; depth.len()], depth, rgb, floors: Vec::new() }
    }

    /// Returns the evidence about a point (world, scene units).
    pub(super) fn word(&self, point: DVec3, metres_per_unit: f64) -> Word {
        let Some((x, y, z)) = self.camera.project(point) else { return Word::Nothing };
        let (width, height) = (i64::from(self.camera.width), i64::from(self.camera.height));
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        // With a pixel about it, since edges are not exact.
        if x < 1 || y < 1 || x + 1 >= width || y + 1 >= height {
            return Word::Nothing;
        }
        let pixels = (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (y * width + x) as usize));
        let depths = pixels.map(|pixel| match self.depth[pixel] {
            0.0 => (f64::INFINITY, false),
            depth => (f64::from(depth), self.on[pixel] > 0),
        });
        let (nearest, floor) =
            depths.fold((f64::INFINITY, false), |best, other| if other.0 < best.0 { other } else { best });
        if z * (1.0 + BEFORE[0]) + BEFORE[1] / metres_per_unit < nearest {
            Word::Through { floor }
        } else if z < nearest * (1.0 + WITH[0]) + WITH[1] / metres_per_unit
            && super::is_near(z * self.camera.widest_pixel() * metres_per_unit)
        {
            Word::Seen { floor }
        } else {
            Word::Nothing
        }
    }

    /// The rays of the pixels, of length 1, row by row.
    pub(super) fn rays(&self) -> impl Iterator<Item = DVec3> + '_ {
        let pixels = (0..self.camera.height).flat_map(|y| (0..self.camera.width).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5))
    }

    /// The place that a pixel shows; `None` off the picture and where there is nothing.
    fn point(&self, x: i64, y: i64) -> Option<DVec3> {
        let Camera { width, height, fx, fy, cx, cy, .. } = self.camera;
        let is_in = x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height);
        let depth = is_in.then(|| f64::from(self.depth[(y * i64::from(width) + x) as usize]))?;
        let local = DVec3::new((x as f64 + 0.5 - cx) / fx, (y as f64 + 0.5 - cy) / fy, 1.0) * depth;
        (depth > 0.0).then(|| self.camera.center() + self.camera.rotation().transpose() * local)
    }

    /// The normal of the plane through a pixel and those about it, as far as they are of one, world; `None` at edges. The
    /// inverse depth of a plane is linear in the picture.
    fn normal(&self, x: i64, y: i64) -> Option<DVec3> {
        let Camera { width, height, fx, fy, cx, cy, .. } = self.camera;
        let [width, height] = [width, height].map(i64::from);
        if x < ASIDE || y < ASIDE || x + ASIDE >= width || y + ASIDE >= height {
            return None;
        }
        let inverse = |dx: i64, dy: i64| match self.depth[((y + dy) * width + x + dx) as usize] {
            0.0 => 0.0,
            depth => 1.0 / f64::from(depth),
        };
        let own = inverse(0, 0);
        let mut plane: Option<DVec3> = None;
        for _ in 0..ROUNDS {
            let (mut moments, mut right) = (DMat3::ZERO, DVec3::ZERO);
            for (dx, dy) in (-ASIDE..=ASIDE).flat_map(|dy| (-ASIDE..=ASIDE).map(move |dx| (dx, dy))) {
                let (at, value) = (DVec3::new(1.0, dx as f64, dy as f64), inverse(dx, dy));
                let off = plane.map_or(0.0, |plane| (plane.dot(at) - value) / (OFF * own));
                let weight = 1.0 / (1.0 + off * off).powi(2);
                let weighted = weight * at;
                moments += DMat3::from_cols(weighted * at.x, weighted * at.y, weighted * at.z);
                right += weighted * value;
            }
            plane = Some(moments.inverse() * right);
        }
        let plane = plane.filter(|plane| (plane.x / own - 1.0).abs() < OFF)?;
        let along = [plane.y, plane.z];
        let middle = plane.x - along[0] * (x as f64 + 0.5 - cx) - along[1] * (y as f64 + 0.5 - cy);
        let local = DVec3::new(along[0] * fx, along[1] * fy, middle);
        (self.camera.rotation().transpose() * local).try_normalize()
    }

    /// Calls `work` with what is seen in each pixel that shows something.
    pub(super) fn each_spot(&self, mut work: impl FnMut(Spot)) {
        let center = self.camera.center();
        let [width, height] = [self.camera.width, self.camera.height].map(i64::from);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let Some(point) = self.point(x, y) else { continue };
            let pixel = (y * width + x) as usize;
            let ray = (point - center).normalize();
            let rgb = std::array::from_fn(|k| self.rgb.get(3 * pixel + k).copied().unwrap_or(0.5));
            let width = f64::from(self.depth[pixel]) * self.camera.widest_pixel();
            if let Some(floor) = usize::from(self.on[pixel]).checked_sub(1).map(|k| &self.floors[k]) {
                let slant = -floor.normal.dot(ray);
                let places = (1.0 / slant).ceil().min(MOST);
                let apart = (width / (slant * places)).max(width);
                // People do not roll cameras, but hold them upright: floors go back along a column or a row.
                let across = self.camera.rotation() * floor.normal;
                for part in 0..places as u32 {
                    let part = (f64::from(part) + 0.5) / places;
                    let [right, down] =
                        if across.x.abs() > across.y.abs() { [part, 0.5] } else { [0.5, part] };
                    let ray = self.camera.ray(x as f64 + right, y as f64 + down);
                    if let Some((way, _)) = floor.met(center, ray) {
                        work(Spot { point: center + way * ray, normal: Some(floor.normal), ray, apart, rgb });
                    }
                }
                continue;
            }
            let normal = self.normal(x, y).map(|normal| normal * -normal.dot(ray).signum());
            let slant = normal.map_or(1.0, |normal| normal.dot(ray).abs().max(GRAZING));
            work(Spot { point, normal, ray, apart: width / slant, rgb });
        }
    }
}
