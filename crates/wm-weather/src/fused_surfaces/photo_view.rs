//! The surface that one photo's camera sees, and its evidence about points.

use super::floor::FloorPlane;
use super::ground_field::GroundField;
use super::normals::InverseDepths;
use glam::DVec3;
use std::sync::Arc;
use wm_render::simd::SimdPath;
use wm_scene::Camera;

/// Width of the smallest cubes, m, and how often it may double.
pub(super) const MIN_CUBE_WIDTH_M: f64 = 0.12;
pub(super) const MAX_CUBE_DOUBLINGS: u32 = 4;
/// Width of cubes in distances between pixels.
pub(super) const CUBE_WIDTH_PX: f64 = 1.5;
/// Distance in front of the surface from which a point is seen through, as a share of the ray's
/// length, and m.
const SEE_THROUGH_DISTANCES: [f64; 2] = [0.1, 0.1];
/// Distance from the visible surface within which a point is part of it, the same.
const SURFACE_DISTANCES: [f64; 2] = [0.04, 0.1];
/// Least cosine between a ray and the normal for the distance between pixels along a surface; and
/// how many places are taken of a pixel of a floor, which is known between pixels too.
const MIN_GRAZING_COSINE: f64 = 0.15;
const MAX_FLOOR_SAMPLES: f64 = 32.0;
/// Places of a pixel of a floor in each cube, at least.
const MIN_PLACES_PER_CUBE: f64 = 2.0;

/// The surface that one photo's camera sees: depth, colour and floors.
#[derive(Clone, Debug)]
pub struct PhotoView {
    /// The photo's camera.
    pub(super) camera: Camera,
    /// View z of the surface in each pixel, scene units, `[H, W]`; 0 where there is none.
    pub(super) depth: Vec<f32>,
    /// Colour, display-referred, `[H, W, 3]`.
    rgb: Vec<f32>,
    /// Floors, and which of them each pixel shows, from 1; 0 for none.
    pub(super) floors: Vec<FloorPlane>,
    pub(super) on: Vec<u16>,
    /// The ground that pixels [`ON_FIELD`] show.
    field: Option<Arc<GroundField>>,
}

/// A pixel that shows the ground field, in the place of the number of a floor.
const ON_FIELD: u16 = u16::MAX;

/// Returns true if pixels of this width, m, are fused.
pub(super) fn is_near(width: f64) -> bool {
    CUBE_WIDTH_PX * width <= MIN_CUBE_WIDTH_M * f64::from(1 << MAX_CUBE_DOUBLINGS)
}

/// The evidence of one camera about a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PointEvidence {
    /// The point is on the visible surface.
    OnSurface { floor: bool },
    /// The camera sees through the point.
    SeenThrough { floor: bool },
    /// It is off the picture, or behind something.
    Unknown,
}

/// A view's evidence: its nearest surface within a pixel of each, and which of them are floors.
pub(super) struct ViewEvidence {
    camera: Camera,
    /// View z, scene units, infinite where there is no surface; and true for a floor.
    nearest: Vec<(f32, bool)>,
}

impl ViewEvidence {
    /// Returns the evidence about a ball (world, scene units; radius 0 for a point). Where its
    /// middle is off the picture, the nearest part of the picture that it reaches tells.
    pub(crate) fn evidence_at_ball(&self, middle: DVec3, radius: f64, metres_per_unit: f64) -> PointEvidence {
        let Some((x, y, z)) = self.camera.project(middle) else { return PointEvidence::Unknown };
        let [width, height] = [self.camera.width, self.camera.height].map(f64::from);
        let reach = radius * self.camera.fx / z;
        let [inside_x, inside_y] = [x.clamp(1.0, width - 2.0), y.clamp(1.0, height - 2.0)];
        let (off_x, off_y) = ((x - inside_x).abs().floor(), (y - inside_y).abs().floor());
        if off_x > reach || off_y > reach {
            return PointEvidence::Unknown;
        }
        let (width, x, y) = (width as i64, inside_x as i64, inside_y as i64);
        let (nearest, floor) = self.nearest[(y * width + x) as usize];
        let nearest = f64::from(nearest);
        if z * (1.0 + SEE_THROUGH_DISTANCES[0]) + SEE_THROUGH_DISTANCES[1] / metres_per_unit < nearest {
            PointEvidence::SeenThrough { floor }
        } else if z < nearest * (1.0 + SURFACE_DISTANCES[0]) + SURFACE_DISTANCES[1] / metres_per_unit
            && is_near(z * self.camera.widest_pixel() * metres_per_unit)
        {
            PointEvidence::OnSurface { floor }
        } else {
            PointEvidence::Unknown
        }
    }
}

/// The surface in one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// Place, world, scene units.
    pub(crate) point: DVec3,
    /// Normal on the side of the camera, length 1; `None` at edges.
    pub(crate) normal: Option<DVec3>,
    /// Direction from the camera, length 1.
    pub(crate) ray: DVec3,
    /// Distance to the neighbouring pixels' points, scene units.
    pub(crate) apart: f64,
    /// The number of places that it stands for.
    pub(crate) count: f64,
    pub(crate) rgb: [f32; 3],
}

impl PhotoView {
    /// The view of a camera: view z of the surface in each pixel, scene units, `[H, W]`, 0 where
    /// there is none; and its colour, display-referred, `[H, W, 3]`, grey where that is empty.
    #[must_use]
    pub fn new(camera: Camera, depth: Vec<f32>, rgb: Vec<f32>) -> Self {
        Self { camera, on: vec![0; depth.len()], depth, rgb, floors: Vec::new(), field: None }
    }

    /// Returns what the view can tell of points.
    pub(super) fn witness(&self) -> ViewEvidence {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let depth = |pixel: usize| match self.depth[pixel] {
            0.0 => f32::INFINITY,
            depth => depth,
        };
        // Of each pixel the one with the nearest surface of it and those about it, since edges are
        // not exact.
        let nearer = |a: usize, b: usize| if depth(b) < depth(a) { b } else { a };
        let mut across: Vec<usize> = (0..width * height).collect();
        for (pixel, nearest) in across.iter_mut().enumerate() {
            let x = pixel % width;
            *nearest = (pixel - usize::from(x > 0)..=pixel + usize::from(x + 1 < width))
                .reduce(nearer)
                .unwrap_or(pixel);
        }
        let nearest = |pixel: usize| {
            let rows = [pixel.checked_sub(width), Some(pixel), Some(pixel + width)];
            let rows = rows.into_iter().flatten().filter_map(|pixel| across.get(pixel).copied());
            rows.reduce(nearer).map_or((f32::INFINITY, false), |at| (depth(at), self.on[at] > 0))
        };
        ViewEvidence { camera: self.camera, nearest: (0..width * height).map(nearest).collect() }
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

    /// The point of the ground (world, scene units) that is seen in the direction of a point, and
    /// the distance to that along the view axis; `None` where another surface is seen.
    pub(super) fn on_ground(&self, point: DVec3) -> Option<(DVec3, f64)> {
        let (x, y, z) = self.camera.project(point)?;
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        let found = self.point(x, y)?;
        (self.on[(y * i64::from(self.camera.width) + x) as usize] != 0).then_some((found, z))
    }

    /// Puts pixels that show the ground at a grazing angle, or nothing where it is, onto it.
    pub(super) fn snapped_to(mut self, field: &Arc<GroundField>) -> Self {
        let (center, forward) = (self.camera.center(), self.camera.forward());
        let Some(eye) = field.eye(center) else { return self };
        let rays: Vec<DVec3> = self.rays().collect();
        for (pixel, ray) in rays.into_iter().enumerate() {
            if self.on[pixel] != 0 {
                continue;
            }
            let (along, depth) = (ray.dot(forward), f64::from(self.depth[pixel]));
            if let Some(way) = field.snapped(eye, ray, depth / along) {
                (self.depth[pixel], self.on[pixel]) = ((way * along) as f32, ON_FIELD);
            }
        }
        self.field = Some(Arc::clone(field));
        self
    }

    /// Calls `work` with points (world, scene units) whose normal is within a cosine of `up`, those
    /// of each so many pixels of a row and of a column as `stride` says for the distance between
    /// them (scene units), and with that number.
    pub(super) fn each_level_point(
        &self,
        stride: impl Fn(f64) -> usize,
        up: DVec3,
        cosine: f64,
        mut work: impl FnMut(DVec3, usize),
    ) {
        let (inverse_depths, path) = (InverseDepths::new(self.camera, &self.depth), SimdPath::widest());
        let (width, widest) = (self.camera.width as usize, self.camera.widest_pixel());
        for y in 0..self.camera.height as usize {
            let stride_at = |x: usize| stride(f64::from(self.depth[y * width + x]) * widest);
            let is_wanted = |x: usize| {
                let stride = stride_at(x);
                x.is_multiple_of(stride) && y.is_multiple_of(stride)
            };
            for (x, normal) in inverse_depths.normals_of_row(path, y, is_wanted).into_iter().enumerate() {
                if normal.is_some_and(|normal| normal.dot(up).abs() > cosine)
                    && is_wanted(x)
                    && let Some(point) = self.point(x as i64, y as i64)
                {
                    work(point, stride_at(x));
                }
            }
        }
    }

    /// The floor that a pixel shows at a point; `None` for another surface.
    fn floor(&self, pixel: usize, point: DVec3) -> Option<FloorPlane> {
        match self.on[pixel] {
            0 => None,
            ON_FIELD => self.field.as_ref()?.plane(point),
            floor => self.floors.get(usize::from(floor) - 1).copied(),
        }
    }

    /// Calls `work` with what is seen in each pixel that shows something, for cubes of `cube`
    /// (scene units) or more.
    pub(super) fn each_spot(&self, cube: f64, mut work: impl FnMut(Spot)) {
        let center = self.camera.center();
        let [width, height] = [self.camera.width, self.camera.height].map(i64::from);
        let (inverse_depths, path) = (InverseDepths::new(self.camera, &self.depth), SimdPath::widest());
        let mut normals = Vec::new();
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            if x == 0 {
                let first = (y * width) as usize;
                // Those of floors are known.
                let is_wanted = |x: usize| self.on[first + x] == 0 && self.depth[first + x] > 0.0;
                normals = inverse_depths.normals_of_row(path, y as usize, is_wanted);
            }
            let Some(point) = self.point(x, y) else { continue };
            let pixel = (y * width + x) as usize;
            let ray = (point - center).normalize();
            let rgb = std::array::from_fn(|k| self.rgb.get(3 * pixel + k).copied().unwrap_or(0.5));
            let width = f64::from(self.depth[pixel]) * self.camera.widest_pixel();
            if let Some(floor) = self.floor(pixel, point) {
                let slant = -floor.normal.dot(ray);
                let places = (1.0 / slant).ceil().min(MAX_FLOOR_SAMPLES);
                let apart = (width / (slant * places)).max(width);
                // People do not roll cameras, but hold them upright: floors go back along a column
                // or a row.
                let across = self.camera.rotation() * floor.normal;
                // Several in a cube say no more than one.
                let taken = places.min((MIN_PLACES_PER_CUBE * width / (slant * cube)).ceil());
                let count = places / taken;
                for part in 0..taken as u32 {
                    let part = (f64::from(part) + 0.5) / taken;
                    let [right, down] =
                        if across.x.abs() > across.y.abs() { [part, 0.5] } else { [0.5, part] };
                    let ray = self.camera.ray(x as f64 + right, y as f64 + down);
                    if let Some((way, _)) = floor.met(center, ray) {
                        let point = center + way * ray;
                        work(Spot { point, normal: Some(floor.normal), ray, apart, count, rgb });
                    }
                }
                continue;
            }
            let normal = normals[x as usize].map(|normal| normal * -normal.dot(ray).signum());
            let slant = normal.map_or(1.0, |normal| normal.dot(ray).abs().max(MIN_GRAZING_COSINE));
            work(Spot { point, normal, ray, apart: width / slant, count: 1.0, rgb });
        }
    }
}
