//! PatchMatch: planes for all pixels of one photo, of which good ones spread to their neighbours
//! and are varied.

use super::matching::{MAX_COST, Plane, StereoImage, StereoSource, Window, inverse_depth};
use wm_base::random::uniform;

/// Offsets of the neighbours whose planes a pixel tries: those of the other colour of a
/// chessboard.
const NEIGHBOUR_OFFSETS_PX: [(isize, isize); 8] =
    [(-1, 0), (1, 0), (0, -1), (0, 1), (-5, 0), (5, 0), (0, -5), (0, 5)];
/// Number of best sources over which the cost is averaged: the others may not see the place.
const AVERAGED_SOURCES: usize = 2;
/// Number of sources that are compared once planes are nearly right, and the most sources of all.
const ASKED_SOURCES: usize = 3;
pub(crate) const MAX_SOURCES: usize = 16;
/// Least cosine between a plane's normal and the ray: 80 degrees.
const MIN_COSINE: f32 = 0.17;

/// The sources with which a plane is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SourceChoice {
    /// All sources.
    All,
    /// The sources in which the plane so far matches best.
    Best,
}

/// The parameters of one round over all pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Round {
    /// The number of the round, from 1: it selects the random numbers.
    pub(crate) number: u32,
    /// The range within which planes are varied, 0-1; 1 also tries any plane.
    pub(crate) reach: f32,
    /// The sources with which planes are compared.
    pub(crate) ask: SourceChoice,
}

/// The camera and range of one photo.
#[derive(Clone, Debug)]
pub(crate) struct Reference<'a> {
    /// The image.
    pub(crate) picture: &'a StereoImage,
    /// Focal lengths and principal point, px.
    pub(crate) intrinsics: [f32; 4],
    /// The photos to compare with.
    pub(crate) sources: Vec<StereoSource<'a>>,
    /// Largest inverse depth.
    pub(crate) nearest: f32,
    /// Seed of its random numbers.
    pub(crate) seed: u64,
}

/// The planes of one photo, `[H, W]`, and their costs.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlaneMap {
    /// The planes, as inverse depth over the image.
    pub(crate) planes: Vec<Plane>,
    /// The matching costs, 0-2.
    pub(crate) costs: Vec<f32>,
}

impl Reference<'_> {
    /// Returns the ray through the image point (x, y), z = 1.
    fn ray(&self, x: f32, y: f32) -> [f32; 3] {
        let [fx, fy, cx, cy] = self.intrinsics;
        [(x - cx) / fx, (y - cy) / fy, 1.0]
    }

    /// Returns the plane with the normal `normal` (camera axes) through the point of inverse depth
    /// `inverse` at (x, y); `None` if it is out of range or seen edge-on.
    pub(crate) fn plane(&self, x: f32, y: f32, inverse: f32, normal: [f32; 3]) -> Option<Plane> {
        let ray = self.ray(x, y);
        let facing = dot(normal, ray);
        let length = dot(ray, ray).sqrt();
        if facing.abs() < MIN_COSINE * length || !(inverse > 0.0 && inverse <= self.nearest) {
            return None;
        }
        let [fx, fy, cx, cy] = self.intrinsics;
        let q = normal.map(|v| v * inverse / facing);
        let (a, b) = (q[0] / fx, q[1] / fy);
        Some([a, b, q[2] - a * cx - b * cy])
    }

    /// Returns the normal of a plane, camera axes, towards the camera, of length 1.
    pub(crate) fn normal(&self, plane: &Plane) -> [f32; 3] {
        let [fx, fy, cx, cy] = self.intrinsics;
        let q = [plane[0] * fx, plane[1] * fy, plane[2] + plane[0] * cx + plane[1] * cy];
        let length = dot(q, q).sqrt().max(1e-20);
        // q . ray is the inverse depth, above 0: the plane's far side.
        q.map(|v| -v / length)
    }

    /// Returns true if a plane is in range and not seen edge-on at (x, y).
    fn allows(&self, plane: &Plane, x: f32, y: f32) -> bool {
        let inverse = inverse_depth(plane, x, y);
        let ray = self.ray(x, y);
        let facing = -dot(self.normal(plane), ray);
        inverse > 0.0 && inverse <= self.nearest && facing > MIN_COSINE * dot(ray, ray).sqrt()
    }

    fn cost(&self, window: &Window, plane: &Plane, asked: &[usize]) -> f32 {
        let mut best = [MAX_COST; AVERAGED_SOURCES];
        for source in asked {
            let mut cost = window.cost(&self.sources[*source], plane);
            for place in &mut best {
                if cost < *place {
                    std::mem::swap(place, &mut cost);
                }
            }
        }
        let count = asked.len().clamp(1, AVERAGED_SOURCES);
        best[..count].iter().sum::<f32>() / count as f32
    }

    /// Returns the sources with which a pixel is compared in a round: those that `plane` matches
    /// best, or all.
    fn compared_sources<'b>(
        &self,
        window: &Window,
        plane: &Plane,
        ask: SourceChoice,
        order: &'b mut Vec<usize>,
    ) -> &'b [usize] {
        order.clear();
        order.extend(0..self.sources.len());
        if ask == SourceChoice::All || order.len() <= ASKED_SOURCES {
            return order;
        }
        let mut costs = [MAX_COST; MAX_SOURCES];
        for (cost, source) in costs.iter_mut().zip(&self.sources) {
            *cost = window.cost(source, plane);
        }
        order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]));
        &order[..ASKED_SOURCES]
    }

    /// Returns the random numbers of a pixel in a round.
    fn random(&self, round: u32, pixel: usize) -> impl FnMut() -> f32 {
        let (mut drawn, seed) = (0u64, self.seed ^ u64::from(round) << 48);
        move || {
            drawn += 1;
            uniform(seed, (pixel as u64) << 5 | drawn) as f32
        }
    }

    /// Returns a random normal within about 60 degrees of the direction to the camera.
    fn any_normal(&self, x: f32, y: f32, random: &mut impl FnMut() -> f32) -> [f32; 3] {
        let ray = self.ray(x, y);
        let length = dot(ray, ray).sqrt();
        let off: [f32; 3] = std::array::from_fn(|_| 1.7 * (random() - 0.5));
        let normal: [f32; 3] = [0, 1, 2].map(|k| off[k] - ray[k] / length);
        unit(normal)
    }

    /// Returns the initial planes: at `inverse` where it is known (above 0), elsewhere random.
    pub(crate) fn begin(&self, inverse: &[f32]) -> PlaneMap {
        let mut found = PlaneMap::default();
        for row in 0..self.picture.height {
            for column in 0..self.picture.width {
                let pixel = row * self.picture.width + column;
                let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
                let mut random = self.random(0, pixel);
                let known = inverse.get(pixel).copied().filter(|v| *v > 0.0);
                let at = known.unwrap_or_else(|| random() * self.nearest);
                let normal = self.any_normal(x, y, &mut random);
                let plane = self.plane(x, y, at, normal);
                let plane =
                    plane.or_else(|| self.plane(x, y, at.clamp(1e-6, self.nearest), unit(self.ray(x, y))));
                found.planes.push(plane.unwrap_or([0.0, 0.0, self.nearest]));
            }
        }
        self.judge(&mut found);
        found
    }

    /// Computes the costs of all planes.
    pub(crate) fn judge(&self, found: &mut PlaneMap) {
        let width = self.picture.width;
        found.costs.clear();
        let all: Vec<usize> = (0..self.sources.len()).collect();
        for (pixel, plane) in found.planes.iter().enumerate() {
            let window = Window::new(self.picture, pixel % width, pixel / width);
            found.costs.push(self.cost(&window, plane, &all));
        }
    }

    /// Improves the planes of all pixels once: first those of one colour of the chessboard, then
    /// those of the other.
    pub(crate) fn run(&self, round: Round, found: &mut PlaneMap) {
        let (width, height) = (self.picture.width, self.picture.height);
        let mut order = Vec::new();
        for color in 0..2 {
            for row in 0..height {
                for column in ((row + color) % 2..width).step_by(2) {
                    self.improve(found, column, row, round, &mut order);
                }
            }
        }
    }

    fn improve(&self, found: &mut PlaneMap, column: usize, row: usize, round: Round, order: &mut Vec<usize>) {
        let Round { number, reach, ask } = round;
        let (width, height) = (self.picture.width, self.picture.height);
        let pixel = row * width + column;
        let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
        let window = Window::new(self.picture, column, row);
        let (mut best, mut least) = (found.planes[pixel], found.costs[pixel]);
        let asked = self.compared_sources(&window, &best, ask, order);
        for (dx, dy) in NEIGHBOUR_OFFSETS_PX {
            let (column, row) = (column.wrapping_add_signed(dx), row.wrapping_add_signed(dy));
            if column >= width || row >= height {
                continue;
            }
            let plane = found.planes[row * width + column];
            // A plane equal to the best one was compared before.
            if plane != best && self.allows(&plane, x, y) {
                let cost = self.cost(&window, &plane, asked);
                if cost < least {
                    (best, least) = (plane, cost);
                }
            }
        }
        let mut random = self.random(number, pixel);
        let (inverse, normal) = (inverse_depth(&best, x, y), self.normal(&best));
        let turn: [f32; 3] = std::array::from_fn(|_| reach * (random() - 0.5));
        let turned = unit([0, 1, 2].map(|k| normal[k] + turn[k]));
        let moved = inverse * (1.0 + 0.2 * reach * (random() - 0.5));
        let anywhere = random() * self.nearest;
        let any = self.any_normal(x, y, &mut random);
        let trials = [(moved, normal), (inverse, turned), (moved, turned), (anywhere, any)];
        let count = if reach < 1.0 { 3 } else { 4 };
        for (inverse, normal) in &trials[..count] {
            if let Some(plane) = self.plane(x, y, *inverse, *normal) {
                let cost = self.cost(&window, &plane, asked);
                if cost < least {
                    (best, least) = (plane, cost);
                }
            }
        }
        (found.planes[pixel], found.costs[pixel]) = (best, least);
    }
}

/// Returns the planes of the picture `half`, of half the size, for the picture `whole`.
pub(crate) fn doubled(planes: &[Plane], half: &StereoImage, whole: &StereoImage) -> Vec<Plane> {
    let (width, height) = (whole.width, whole.height);
    let at = |pixel: usize| {
        let (column, row) =
            ((pixel % width / 2).min(half.width - 1), (pixel / width / 2).min(half.height - 1));
        let [a, b, c] = planes[row * half.width + column];
        [0.5 * a, 0.5 * b, c]
    };
    (0..width * height).map(at).collect()
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = dot(v, v).sqrt().max(1e-20);
    v.map(|v| v / length)
}
