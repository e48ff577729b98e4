//! The background seen through the air, on coarse nodes of its own in each patch.

use crate::hooks::{GROUP, Medium, PATCH, PATCH_PIXELS, ShadeGroup};
use crate::renderer::Background;
use crate::simd::SimdPath;
use wm_scene::Camera;

/// Largest distance of nodes, degrees.
const MAX_STEP: f64 = 0.5;

/// The display-referred background of one view.
pub struct BackgroundView<'a> {
    background: &'a Background,
    medium: Option<&'a dyn Medium>,
    /// The colour where it is the same everywhere.
    uniform: Option<[f32; 3]>,
    origin: [f32; 3],
    /// A ray through picture point (x, y) px: `axes[0] x + axes[1] y + axes[2]`, world axes.
    axes: [[f32; 3]; 3],
    /// Nodes along a side of a patch, on its first and last edge and between: 4, 8 or 16.
    nodes: usize,
    path: SimdPath,
}

/// Working memory of [`BackgroundView::fill`].
#[derive(Clone, Debug)]
pub struct BackgroundScratch {
    groups: [ShadeGroup; PATCH_PIXELS / GROUP],
}

impl Default for BackgroundScratch {
    fn default() -> Self {
        let far = ShadeGroup { distance: [f32::INFINITY; GROUP], ..ShadeGroup::default() };
        Self { groups: [far; PATCH_PIXELS / GROUP] }
    }
}

impl<'a> BackgroundView<'a> {
    /// `background` behind `medium` for one view.
    #[must_use]
    pub fn new(
        background: &'a Background,
        medium: Option<&'a dyn Medium>,
        camera: &Camera,
        path: SimdPath,
    ) -> Self {
        let uniform = match (background, medium) {
            (Background::Color(color), None) => Some(*color),
            (_, Some(medium)) => medium.far_color(),
            _ => None,
        };
        // Degrees a pixel near the principal point, where they are most.
        let degrees = (1.0 / camera.fx.min(camera.fy)).to_degrees();
        let enough = |nodes: &usize| PATCH as f64 / (*nodes - 1) as f64 * degrees <= MAX_STEP;
        let nodes = [4, 8].into_iter().find(enough).unwrap_or(16);
        let world_from_camera = camera.rotation().transpose();
        let (right, down) = (world_from_camera.x_axis / camera.fx, world_from_camera.y_axis / camera.fy);
        let corner = world_from_camera.z_axis - right * camera.cx - down * camera.cy;
        Self {
            background,
            medium,
            uniform,
            origin: camera.center().to_array().map(|v| v as f32),
            axes: [right, down, corner].map(|axis| axis.to_array().map(|v| v as f32)),
            nodes,
            path,
        }
    }

    /// Writes the background of the pixels of one patch, row by row, one array a channel.
    #[inline(always)]
    pub fn fill(
        &self,
        (patch_x, patch_y): (usize, usize),
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
        let step = PATCH as f32 / (NODES - 1) as f32;
        let groups = &mut scratch.groups[..NODES * NODES / GROUP];
        for (i, group) in groups.iter_mut().enumerate() {
            self.rays::<NODES>(corner, step, i * GROUP, group);
            match self.background {
                Background::Color(color) => group.rgb = color.map(|v| [v; GROUP]),
                Background::Sky(_) => {
                    for lane in 0..GROUP {
                        let ray = std::array::from_fn(|k| f64::from(group.direction[k][lane]));
                        let color = self.background.color(ray);
                        for k in 0..3 {
                            group.rgb[k][lane] = color[k] as f32;
                        }
                    }
                }
            }
        }
        if let Some(medium) = self.medium {
            medium.shade(self.path, self.origin, groups);
        }
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
