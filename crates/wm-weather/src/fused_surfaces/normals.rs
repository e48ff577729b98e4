//! Normals of a picture of depth, from the planes through each pixel and those about it.

use glam::DVec3;
use wm_render::dispatch;
use wm_render::simd::SimdPath;
use wm_scene::Camera;

/// Pixels to each side that a plane is fitted to, and the rounds of weighing them.
const PLANE_RADIUS_PX: usize = 3;
const WEIGHING_ROUND_COUNT: usize = 2;
/// Largest distance of a pixel from its plane, as a share of its inverse depth; more is an edge.
const MAX_PLANE_ERROR: f32 = 0.03;
/// Pixels that are fitted side by side, so that the compiler makes vectors of them.
const LANES: usize = 8;

/// The inverse depths of a view, from which normals are found.
pub(super) struct InverseDepths {
    camera: Camera,
    /// Inverse depths, with `LANES` zeros after each row.
    values: Vec<f32>,
    stride: usize,
}

/// A plane for each of `LANES` pixels side by side: inverse depth at the pixel, and its slope along
/// x and y. The inverse depth of a plane is linear in the picture.
type Planes = [[f32; LANES]; 3];

impl InverseDepths {
    pub(crate) fn new(camera: Camera, depth: &[f32]) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let stride = width + LANES;
        let mut values = vec![0.0; stride * height];
        for (row, depths) in values.chunks_mut(stride).zip(depth.chunks(width.max(1))) {
            for (value, depth) in row.iter_mut().zip(depths) {
                *value = if *depth > 0.0 { depth.recip() } else { 0.0 };
            }
        }
        Self { camera, values, stride }
    }

    /// The normals of a row of pixels, world axes, length 1, of either sign; `None` at edges and
    /// near the picture's border. Those that are not wanted may be left out.
    pub(crate) fn normals_of_row(
        &self,
        path: SimdPath,
        y: usize,
        is_wanted: impl Fn(usize) -> bool,
    ) -> Vec<Option<DVec3>> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let mut normals = vec![None; width];
        if y < PLANE_RADIUS_PX || y + PLANE_RADIUS_PX >= height || width <= 2 * PLANE_RADIUS_PX {
            return normals;
        }
        let inner = PLANE_RADIUS_PX..width - PLANE_RADIUS_PX;
        for first in inner.clone().step_by(LANES) {
            let last = inner.end.min(first + LANES);
            if !(first..last).any(&is_wanted) {
                continue;
            }
            let planes = dispatch!(path, _simd => self.fit(first, y));
            for (lane, normal) in normals[first..last].iter_mut().enumerate() {
                let own = self.values[y * self.stride + first + lane];
                let plane = planes.map(|of| of[lane]);
                // False for NaN too.
                if own > 0.0 && (plane[0] / own - 1.0).abs() < MAX_PLANE_ERROR {
                    *normal = self.normal([first + lane, y], plane.map(f64::from));
                }
            }
        }
        normals
    }

    /// Fits planes to `LANES` pixels from (x, y) on.
    #[inline(always)]
    fn fit(&self, x: usize, y: usize) -> Planes {
        let window = |dy: usize, dx: usize| -> &[f32; LANES] {
            let from = (y + dy - PLANE_RADIUS_PX) * self.stride + x + dx - PLANE_RADIUS_PX;
            self.values[from..].first_chunk().expect("rows end in zeros")
        };
        let offset = |k: usize| k as f32 - PLANE_RADIUS_PX as f32;
        let side = 2 * PLANE_RADIUS_PX + 1;
        let own = window(PLANE_RADIUS_PX, PLANE_RADIUS_PX);
        let inverse_off: [f32; LANES] = std::array::from_fn(|k| 1.0 / (MAX_PLANE_ERROR * own[k]));
        // All alike at first: then the sums of the offsets' products are known.
        let mut planes: Planes = [[0.0; LANES]; 3];
        for (dy, dx) in (0..side).flat_map(|dy| (0..side).map(move |dx| (dy, dx))) {
            let values = window(dy, dx);
            for k in 0..LANES {
                planes[0][k] += values[k];
                planes[1][k] += offset(dx) * values[k];
                planes[2][k] += offset(dy) * values[k];
            }
        }
        let squares: f32 = (0..side).map(|k| offset(k).powi(2)).sum::<f32>() * side as f32;
        for (plane, sum) in planes.iter_mut().zip([(side * side) as f32, squares, squares]) {
            plane.iter_mut().for_each(|value| *value /= sum);
        }
        for _ in 0..WEIGHING_ROUND_COUNT {
            let (mut moments, mut right) = ([[0.0; LANES]; 6], [[0.0; LANES]; 3]);
            for dy in 0..side {
                let mut row = [[0.0; LANES]; 5];
                for dx in 0..side {
                    let (values, along) = (window(dy, dx), offset(dx));
                    for k in 0..LANES {
                        let expected = planes[0][k] + offset(dy) * planes[2][k] + along * planes[1][k];
                        let off = (expected - values[k]) * inverse_off[k];
                        let spread = 1.0 + off * off;
                        let weight = 1.0 / (spread * spread);
                        row[0][k] += weight;
                        row[1][k] += along * weight;
                        row[2][k] += along * along * weight;
                        row[3][k] += weight * values[k];
                        row[4][k] += along * weight * values[k];
                    }
                }
                let down = offset(dy);
                for k in 0..LANES {
                    let [w, wx, wxx, wv, wxv] = row.map(|of| of[k]);
                    for (sum, value) in
                        moments.iter_mut().zip([w, wx, down * w, wxx, down * wx, down * down * w])
                    {
                        sum[k] += value;
                    }
                    for (sum, value) in right.iter_mut().zip([wv, wxv, down * wv]) {
                        sum[k] += value;
                    }
                }
            }
            // Cramer's rule, of all lanes at once.
            for k in 0..LANES {
                let [w, wx, wy, wxx, wxy, wyy] = moments.map(|of| f64::from(of[k]));
                let [v, xv, yv] = right.map(|of| f64::from(of[k]));
                let [a, b, c] = [wxx * wyy - wxy * wxy, wxy * wy - wx * wyy, wx * wxy - wxx * wy];
                let [d, e, f] = [w * wyy - wy * wy, wx * wy - w * wxy, w * wxx - wx * wx];
                let scale = 1.0 / (w * a + wx * b + wy * c);
                planes[0][k] = ((a * v + b * xv + c * yv) * scale) as f32;
                planes[1][k] = ((b * v + d * xv + e * yv) * scale) as f32;
                planes[2][k] = ((c * v + e * xv + f * yv) * scale) as f32;
            }
        }
        planes
    }

    /// The normal of a pixel's plane, world axes.
    fn normal(&self, pixel: [usize; 2], depths: [f64; 3]) -> Option<DVec3> {
        let [x, y] = pixel;
        let [own, right, down] = depths;
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let middle = own - right * (x as f64 + 0.5 - cx) - down * (y as f64 + 0.5 - cy);
        let local = DVec3::new(right * fx, down * fy, middle);
        (self.camera.rotation().transpose() * local).try_normalize()
    }
}
