//! The wide view that drops show.

use crate::lanes::SetLanes;
use crate::linear_picture::{LinearPicture, halved};
use fearless_simd::{SimdBase, SimdFloat};
use wm_render::Frame;
use wm_render::simd::{Lanes, SimdPath};
use wm_scene::Camera;

/// Side of the wide picture.
pub(super) const WIDE_SIDE_PX: u32 = 256;
/// Focal length: the view shows 76 degrees to all sides.
const FOCAL_LENGTH_PX: f64 = 32.0;
/// Greatest tangent of an angle from the axis in the picture.
const MAX_TANGENT: f32 = (WIDE_SIDE_PX as f64 / 2.0 / FOCAL_LENGTH_PX) as f32 - 0.03;

/// The camera of the wide view: at the eye of the picture's camera, along its view.
#[must_use]
pub fn wide_camera(camera: &Camera) -> Camera {
    let middle = f64::from(WIDE_SIDE_PX) / 2.0;
    Camera {
        width: WIDE_SIDE_PX,
        height: WIDE_SIDE_PX,
        fx: FOCAL_LENGTH_PX,
        fy: FOCAL_LENGTH_PX,
        cx: middle,
        cy: middle,
        ..*camera
    }
}

/// A wide picture in linear light at every fineness.
#[derive(Clone, Debug)]
pub(crate) struct WideView {
    levels: Vec<LinearPicture>,
}

impl WideView {
    /// Makes all levels of a drawn picture, which must be of [`wide_camera`].
    pub(crate) fn new(path: SimdPath, frame: &Frame) -> Self {
        let mut levels = vec![LinearPicture::new(path, frame)];
        while let Some(last) = levels.last().filter(|last| last.width > 2) {
            let (half, pixels) = halved(last.width, &last.pixels);
            levels.push(LinearPicture { width: half, height: half, pixels });
        }
        Self { levels }
    }

    /// The mean light of the whole view.
    pub(crate) fn mean(&self) -> [f32; 3] {
        let four = &self.levels[self.levels.len() - 1].pixels;
        std::array::from_fn(|k| four.iter().map(|pixel| pixel[k]).sum::<f32>() / four.len() as f32)
    }

    /// The light from a direction of the camera's axes, x right, y down, z ahead, of a cone `angle`
    /// radians wide.
    #[inline(always)]
    pub(crate) fn at(&self, direction: [f32; 3], angle: f32) -> [f32; 4] {
        let [x, y, z] = direction;
        let inverse = 1.0 / z.max(0.05);
        let (u, v) =
            ((x * inverse).clamp(-MAX_TANGENT, MAX_TANGENT), (y * inverse).clamp(-MAX_TANGENT, MAX_TANGENT));
        // Pixels of the edge are narrower angles.
        let wide = angle * FOCAL_LENGTH_PX as f32 * (1.0 + u * u + v * v).sqrt();
        let level = ((wide.max(1.0).to_bits() >> 23) as usize - 127).min(self.levels.len() - 1);
        let [u, v] = [u, v].map(|tangent| tangent * FOCAL_LENGTH_PX as f32 + 0.5 * WIDE_SIDE_PX as f32);
        self.levels[level].at(u, v, level)
    }

    /// [`Self::at`] for those lanes that have a bit in `wanted`.
    #[inline(always)]
    pub(super) fn look<S: Lanes>(
        &self,
        simd: S,
        direction: [S::F; 3],
        angle: S::F,
        wanted: u32,
        light: &mut [[f32; 4]; 16],
    ) {
        let [x, y, z] = direction;
        let one = simd.set(1.0);
        let inverse = one / z.max(simd.set(0.05));
        let u = (x * inverse).max(simd.set(-MAX_TANGENT)).min(simd.set(MAX_TANGENT));
        let v = (y * inverse).max(simd.set(-MAX_TANGENT)).min(simd.set(MAX_TANGENT));
        // Pixels of the edge are narrower angles.
        let wide = (angle * FOCAL_LENGTH_PX as f32 * u.mul_add(u, v.mul_add(v, one)).sqrt()).max(one);
        let (mut columns, mut rows, mut widths) = ([0.0; 16], [0.0; 16], [1.0f32; 16]);
        (u * FOCAL_LENGTH_PX as f32 + 0.5 * WIDE_SIDE_PX as f32).store_slice(&mut columns[..S::N]);
        (v * FOCAL_LENGTH_PX as f32 + 0.5 * WIDE_SIDE_PX as f32).store_slice(&mut rows[..S::N]);
        wide.store_slice(&mut widths[..S::N]);
        for i in SetLanes(wanted) {
            let level = ((widths[i].to_bits() >> 23) as usize - 127).min(self.levels.len() - 1);
            light[i] = self.levels[level].at(columns[i], rows[i], level);
        }
    }
}
