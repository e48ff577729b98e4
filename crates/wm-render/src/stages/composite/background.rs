//! The background seen through the air: on coarse nodes of its own in each patch, or pixel by
//! pixel.

use crate::hooks::{Backdrop, Detail, GROUP, Medium, PATCH, PATCH_PIXELS, ShadeGroup};
use crate::plan::{DrawPass, Shading};
use crate::simd::SimdPath;
use crate::stages::shade::cpu::through_air;
use wm_scene::Camera;

/// Largest distance of nodes, degrees.
const MAX_STEP: f64 = 0.5;

/// The display-referred background of one view.
pub(crate) struct BackgroundView<'a> {
    backdrop: &'a dyn Backdrop,
    medium: Option<&'a dyn Medium>,
    shading: Shading,
    /// The colour where it is the same everywhere.
    pub(crate) uniform: Option<[f32; 3]>,
    origin: [f32; 3],
    /// A ray through picture point (x, y) px: `axes[0] x + axes[1] y + axes[2]`, world axes.
    axes: [[f32; 3]; 3],
    /// Angle of the widest pixel, radians.
    pixel: f64,
    detail: Detail,
    /// Nodes along a side of a patch, on its first and last edge and between: 4, 8 or 16.
    nodes: usize,
    path: SimdPath,
}

/// Working memory of [`BackgroundView::fill`].
#[derive(Clone, Debug)]
pub(crate) struct BackgroundScratch {
    groups: [ShadeGroup; PATCH_PIXELS / GROUP],
}

impl Default for BackgroundScratch {
    fn default() -> Self {
        let far = ShadeGroup { distance: [f32::INFINITY; GROUP], ..ShadeGroup::default() };
        Self { groups: [far; PATCH_PIXELS / GROUP] }
    }
}

impl<'a> BackgroundView<'a> {
    /// The background of a pass.
    pub(crate) fn of(pass: &'a DrawPass<'_>, path: SimdPath) -> Self {
        Self::new(pass.backdrop(), pass.hooks.medium, pass.shading, &pass.camera, path)
    }

    /// `backdrop` behind `medium` for one view.
    pub(crate) fn new(
        backdrop: &'a dyn Backdrop,
        medium: Option<&'a dyn Medium>,
        shading: Shading,
        camera: &Camera,
        path: SimdPath,
    ) -> Self {
        let (uniform, detail) = match (shading, medium) {
            (Shading::Color, None) => (backdrop.uniform(), backdrop.detail()),
            (Shading::Color, Some(medium)) => (medium.far_color(), backdrop.detail()),
            (Shading::Transmittance, None) => (Some([1.0; 3]), Detail::Smooth),
            (Shading::Transmittance, Some(_)) => (None, Detail::Smooth),
        };
        let pixel = camera.widest_pixel();
        let degrees = pixel.to_degrees();
        let enough = |nodes: &usize| PATCH as f64 / (*nodes - 1) as f64 * degrees <= MAX_STEP;
        let nodes = [4, 8].into_iter().find(enough).unwrap_or(16);
        let world_from_camera = camera.rotation().transpose();
        let (right, down) = (world_from_camera.x_axis / camera.fx, world_from_camera.y_axis / camera.fy);
        let corner = world_from_camera.z_axis - right * camera.cx - down * camera.cy;
        Self {
            backdrop,
            medium,
            shading,
            uniform,
            origin: camera.center().to_array().map(|v| v as f32),
            axes: [right, down, corner].map(|axis| axis.to_array().map(|v| v as f32)),
            pixel,
            detail,
            nodes,
            path,
        }
    }

    /// Writes the background of the pixels of one patch, row by row, one array per channel.
    #[inline(always)]
    pub(crate) fn fill(
        &self,
        patch_x: usize,
        patch_y: usize,
        scratch: &mut BackgroundScratch,
        out: &mut [[f32; PATCH_PIXELS]; 3],
    ) {
        if let Some(color) = self.uniform {
            for k in 0..3 {
                out[k] = [color[k]; PATCH_PIXELS];
            }
            return;
        }
        let corner = [(patch_x * PATCH) as f32, (patch_y * PATCH) as f32];
        if self.detail == Detail::Fine {
            return self.fill_pixels(corner[0], corner[1], scratch, out);
        }
        // Constant numbers of nodes, so that the loops unroll.
        match self.nodes {
            4 => self.fill_with::<4>(corner, scratch, out),
            8 => self.fill_with::<8>(corner, scratch, out),
            _ => self.fill_with::<16>(corner, scratch, out),
        }
    }

    #[inline(always)]
    fn fill_with<const NODES: usize>(
        &self,
        corner: [f32; 2],
        scratch: &mut BackgroundScratch,
        out: &mut [[f32; PATCH_PIXELS]; 3],
    ) {
        let groups = self.seen_nodes::<NODES>(corner, scratch);
        for k in 0..3 {
            // Along the rows of nodes first, then down the columns of pixels.
            let mut rows = [[0.0; PATCH]; NODES];
            for (y, row) in rows.iter_mut().enumerate() {
                let node = |x: usize| groups[(y * NODES + x) / GROUP].rgb[k][(y * NODES + x) % GROUP];
                for (x, value) in row.iter_mut().enumerate() {
                    let (first, share) = place::<NODES>(x);
                    *value = node(first) + (node(first + 1) - node(first)) * share;
                }
            }
            for (y, line) in out[k].as_chunks_mut::<PATCH>().0.iter_mut().enumerate() {
                let (first, share) = place::<NODES>(y);
                for x in 0..PATCH {
                    line[x] = rows[first][x] + (rows[first + 1][x] - rows[first][x]) * share;
                }
            }
        }
    }

    /// The nodes of a patch, row by row.
    #[inline(always)]
    fn seen_nodes<'s, const NODES: usize>(
        &self,
        corner: [f32; 2],
        scratch: &'s mut BackgroundScratch,
    ) -> &'s [ShadeGroup] {
        let step = PATCH as f32 / (NODES - 1) as f32;
        let groups = &mut scratch.groups[..NODES * NODES / GROUP];
        for (i, group) in groups.iter_mut().enumerate() {
            self.rays::<NODES>(corner, step, i * GROUP, group);
        }
        self.shade_rays(groups);
        groups
    }

    /// Nodes along a side of a patch, between which the background is mixed; `None` where there is
    /// one a pixel or more.
    #[cfg(feature = "gpu")]
    pub(crate) fn nodes(&self) -> Option<usize> {
        (self.detail == Detail::Smooth && self.nodes < PATCH).then_some(self.nodes)
    }

    /// Writes the colours of the nodes of one patch, `[nodes, nodes, 3]`.
    #[cfg(feature = "gpu")]
    pub(crate) fn fill_nodes(
        &self,
        patch_x: usize,
        patch_y: usize,
        scratch: &mut BackgroundScratch,
        out: &mut [[f32; 3]],
    ) {
        let corner = [(patch_x * PATCH) as f32, (patch_y * PATCH) as f32];
        let groups = match self.nodes {
            4 => self.seen_nodes::<4>(corner, scratch),
            _ => self.seen_nodes::<8>(corner, scratch),
        };
        for (i, node) in out.iter_mut().enumerate() {
            *node = [0, 1, 2].map(|k| groups[i / GROUP].rgb[k][i % GROUP]);
        }
    }

    /// One ray a pixel.
    #[inline(always)]
    fn fill_pixels(
        &self,
        left: f32,
        top: f32,
        scratch: &mut BackgroundScratch,
        out: &mut [[f32; PATCH_PIXELS]; 3],
    ) {
        let groups = &mut scratch.groups[..];
        for (row, group) in groups.iter_mut().enumerate() {
            // A group is a row: both are 16 long.
            self.rays::<PATCH>([left + 0.5, top + 0.5], 1.0, row * PATCH, group);
        }
        self.shade_rays(groups);
        for k in 0..3 {
            for (pixels, group) in out[k].as_chunks_mut::<PATCH>().0.iter_mut().zip(&*groups) {
                *pixels = group.rgb[k];
            }
        }
    }

    /// Colours the rays, through the air.
    #[inline(always)]
    fn shade_rays(&self, groups: &mut [ShadeGroup]) {
        if self.shading == Shading::Color {
            self.backdrop.paint(self.pixel, groups);
        }
        through_air(self.path, self.medium, self.shading, self.origin, groups);
    }

    /// The rays of nodes `first..first + GROUP` of a patch, row by row.
    #[inline(always)]
    fn rays<const NODES: usize>(&self, corner: [f32; 2], step: f32, first: usize, group: &mut ShadeGroup) {
        let [right, down, at] = self.axes;
        for lane in 0..GROUP {
            let (column, row) = ((first + lane) % NODES, (first + lane) / NODES);
            let (x, y) = (corner[0] + step * column as f32, corner[1] + step * row as f32);
            let ray: [f32; 3] = std::array::from_fn(|k| right[k] * x + down[k] * y + at[k]);
            let scale = 1.0 / (ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]).sqrt();
            for k in 0..3 {
                group.direction[k][lane] = ray[k] * scale;
            }
        }
    }
}

/// The node before the centre of pixel `pixel` of a side, and the way to the next, 0-1.
#[inline(always)]
fn place<const NODES: usize>(pixel: usize) -> (usize, f32) {
    let at = (pixel as f32 + 0.5) * (NODES - 1) as f32 / PATCH as f32;
    let first = (at as usize).min(NODES - 2);
    (first, at - first as f32)
}
