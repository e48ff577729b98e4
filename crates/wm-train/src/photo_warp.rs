//! Warps of pixels between two photos.

use glam::{DMat3, DVec3};
use wm_scene::Camera;

/// Maps image points with an inverse depth from one photo to another.
///
/// The image, in homogeneous coordinates, of the point at inverse view z `d` behind image point (x,
/// y) is `base (x, y, 1) + d lift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PhotoWarp {
    /// The map of points at infinite distance.
    pub(crate) base: [[f32; 3]; 3],
    /// The vector that is added for each unit of inverse view z.
    pub(crate) lift: [f32; 3],
}

impl PhotoWarp {
    /// Makes the map from the pixels of `from` to those of `to`.
    pub(crate) fn new(from: &Camera, to: &Camera) -> Self {
        let relative = to.viewmat * from.viewmat.inverse();
        let matrix =
            |c: &Camera| DMat3::from_cols(DVec3::X * c.fx, DVec3::Y * c.fy, DVec3::new(c.cx, c.cy, 1.0));
        let base = matrix(to) * DMat3::from_mat4(relative) * matrix(from).inverse();
        let lift = matrix(to) * relative.w_axis.truncate();
        Self {
            base: [0, 1, 2].map(|row| base.row(row).to_array().map(|v| v as f32)),
            lift: lift.to_array().map(|v| v as f32),
        }
    }

    /// Returns the image point, px, and the inverse view z in the other photo of the point at
    /// inverse view z `inverse` behind image point (x, y), px; `None` behind the other camera.
    #[inline(always)]
    pub(crate) fn point(&self, x: f32, y: f32, inverse: f32) -> Option<(f32, f32, f32)> {
        let row =
            |r: usize| self.base[r][0] * x + self.base[r][1] * y + self.base[r][2] + self.lift[r] * inverse;
        let depth = row(2);
        (depth > 1e-6).then(|| (row(0) / depth, row(1) / depth, inverse / depth))
    }
}
