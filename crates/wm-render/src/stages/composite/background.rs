//! The background seen through the air, on a coarse grid.

use crate::hooks::{GROUP, Medium, PATCH, PATCH_PIXELS, ShadeGroup};
use crate::renderer::Background;
use crate::simd::SimdPath;
use wm_scene::Camera;

/// The display-referred background of one view.
#[derive(Clone, Debug, PartialEq)]
pub enum BackgroundGrid {
    /// The same everywhere.
    Uniform([f32; 3]),
    /// Nodes every `step` px, the first at the picture's top left corner.
    Nodes {
        /// Distance of nodes, px; divides the patch.
        step: usize,
        /// Nodes in a row.
        columns: usize,
        /// `[rows, columns, 3]`.
        rgb: Vec<[f32; 3]>,
    },
}

impl BackgroundGrid {
    /// Evaluates `background` behind `medium` for one view.
    #[must_use]
    pub fn new(
        background: &Background,
        medium: Option<&dyn Medium>,
        camera: &Camera,
        path: SimdPath,
    ) -> Self {
        if let (Background::Color(color), None) = (background, medium) {
            return Self::Uniform(*color);
        }
        if let Some(color) = medium.and_then(Medium::far_color) {
            return Self::Uniform(color);
        }
        // Degrees a pixel near the principal point, where they are most.
        let degrees = (1.0 / camera.fx.min(camera.fy)).to_degrees();
        let step = [8, 4, 2].into_iter().find(|step| f64::from(*step) * degrees <= 0.5).unwrap_or(1) as usize;
        let columns = (camera.width as usize).div_ceil(PATCH) * PATCH / step + 1;
        let rows = (camera.height as usize).div_ceil(PATCH) * PATCH / step + 1;
        let origin = camera.center().to_array().map(|v| v as f32);
        let count = rows * columns;
        let mut groups = vec![ShadeGroup::default(); count.div_ceil(GROUP)];
        for i in 0..count {
            let (group, lane) = (&mut groups[i / GROUP], i % GROUP);
            let ray = camera.ray((i % columns * step) as f64, (i / columns * step) as f64);
            let color = background.color(ray.to_array());
            group.distance[lane] = f32::INFINITY;
            for k in 0..3 {
                group.direction[k][lane] = ray[k] as f32;
                group.rgb[k][lane] = color[k] as f32;
            }
        }
        if let Some(medium) = medium {
            medium.shade(path, origin, &mut groups);
        }
        let rgb = (0..count).map(|i| std::array::from_fn(|k| groups[i / GROUP].rgb[k][i % GROUP])).collect();
        Self::Nodes { step, columns, rgb }
    }

    /// Writes the background of the pixels of one patch, row by row, one array a channel.
    #[inline(always)]
    pub fn fill(&self, patch_x: usize, patch_y: usize, out: &mut [[f32; PATCH_PIXELS]; 3]) {
        match self {
            Self::Uniform(color) => {
                for k in 0..3 {
                    out[k] = [color[k]; PATCH_PIXELS];
                }
            }
            Self::Nodes { step, columns, rgb } => {
                let cells = PATCH / step;
                let scale = 1.0 / *step as f32;
                for cell in 0..cells * cells {
                    let (cell_x, cell_y) = (cell % cells, cell / cells);
                    let node = (patch_y * cells + cell_y) * columns + patch_x * cells + cell_x;
                    let corners = [rgb[node], rgb[node + 1], rgb[node + columns], rgb[node + columns + 1]];
                    for y in 0..*step {
                        let fy = (y as f32 + 0.5) * scale;
                        let row = (cell_y * step + y) * PATCH + cell_x * step;
                        for k in 0..3 {
                            let left = corners[0][k] + (corners[2][k] - corners[0][k]) * fy;
                            let right = corners[1][k] + (corners[3][k] - corners[1][k]) * fy;
                            let slope = (right - left) * scale;
                            for x in 0..*step {
                                out[k][row + x] = left + slope * (x as f32 + 0.5);
                            }
                        }
                    }
                }
            }
        }
    }
}
