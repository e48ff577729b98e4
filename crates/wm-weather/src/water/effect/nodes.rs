//! Reflections at nodes every few pixels, where they change little from pixel to pixel.

use super::scene::{Pixels, Scene, Water};
use crate::water::surface::{FILM_SLOPE_RMS, NODE_SPACING_PX, WaterSurface};
use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::hooks::GROUP;
use wm_render::simd::{Lanes, SimdPath};

/// Numbers that are looked up at nodes every [`NODE_SPACING_PX`] pixels, and interpolated between
/// them.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeKind {
    /// The share of light that films reflect, and that light, linear RGB: too blurred to differ
    /// between nodes.
    Films,
    /// Reciprocal of the distance from rough water to what it mirrors, 1/m. Slopes and light are
    /// found at each pixel.
    Reach,
}

impl NodeKind {
    /// Numbers a node.
    const fn parts(self) -> usize {
        match self {
            Self::Films => 4,
            Self::Reach => 1,
        }
    }

    /// Returns true if water with these static slopes is of this kind.
    #[inline(always)]
    fn holds(self, still: f32) -> bool {
        (still > FILM_SLOPE_RMS) == (self == Self::Films)
    }
}

/// Numbers at nodes of the picture; NaN where the water is not of the kind.
pub(super) struct ReflectionNodes {
    of: NodeKind,
    /// Nodes in a row, a multiple of [`GROUP`].
    columns: usize,
    /// One row of nodes after the other, each with its numbers of one kind after the other.
    nodes: Vec<f32>,
}

impl ReflectionNodes {
    /// Samples the water of this kind at the nodes of a picture.
    pub(super) fn new(scene: &Scene<'_>, path: SimdPath, of: NodeKind) -> Self {
        let size = (scene.of.camera.width as usize, scene.of.camera.height as usize);
        let columns = (size.0.next_multiple_of(GROUP) / NODE_SPACING_PX + 1).next_multiple_of(GROUP);
        let row_length = of.parts() * columns;
        let mut nodes = vec![f32::NAN; row_length * (size.1.div_ceil(NODE_SPACING_PX) + 1)];
        nodes.par_chunks_mut(row_length).enumerate().for_each(|(row, nodes)| {
            let y = (row * NODE_SPACING_PX).min(size.1 - 1);
            if scene.of.surface.rows.contains(&(y as u32)) {
                dispatch!(path, s => scene.look_at_nodes(s, of, y, nodes));
            }
        });
        Self { of, columns, nodes }
    }

    /// Number `part` at sixteen pixels from pixel (`x`, `y`) on; NaN where not all nodes about them
    /// are known.
    #[inline(always)]
    pub(super) fn at(&self, x: usize, y: usize, part: usize) -> [f32; GROUP] {
        let (column, row) = (x / NODE_SPACING_PX, y / NODE_SPACING_PX);
        let down = (y % NODE_SPACING_PX) as f32 / NODE_SPACING_PX as f32;
        let of_row = |row: usize| {
            &self.nodes[(self.of.parts() * row + part) * self.columns + column..][..GROUP_NODE_COUNT]
        };
        const GROUP_NODE_COUNT: usize = GROUP / NODE_SPACING_PX + 1;
        let (upper, lower) = (of_row(row), of_row(row + 1));
        let mut nodes = [0.0f32; GROUP_NODE_COUNT];
        for i in 0..GROUP_NODE_COUNT {
            nodes[i] = upper[i] + (lower[i] - upper[i]) * down;
        }
        let mut found = [0.0f32; GROUP];
        for i in 0..GROUP {
            let (left, right) = (nodes[i / NODE_SPACING_PX], nodes[i / NODE_SPACING_PX + 1]);
            found[i] = left + (right - left) * ((i % NODE_SPACING_PX) as f32 / NODE_SPACING_PX as f32);
        }
        found
    }

    /// Writes what sixteen pixels of films mirror, from pixel `at` on, where the nodes about them
    /// are known, and takes these pixels from those that are looked into.
    #[inline(always)]
    pub(super) fn write(&self, x: usize, y: usize, pixels: &mut Pixels, water: &mut Water) {
        let reflected = self.at(x, y, 0);
        let mut known = [false; GROUP];
        let mut is_any = false;
        for i in 0..GROUP {
            known[i] = !reflected[i].is_nan() & self.of.holds(pixels.still[i]) & !pixels.z[i].is_nan();
            is_any |= known[i];
        }
        if !is_any {
            return;
        }
        let light = [self.at(x, y, 1), self.at(x, y, 2), self.at(x, y, 3)];
        for i in 0..GROUP {
            water.reflected[i] = if known[i] { reflected[i] } else { water.reflected[i] };
            for k in 0..3 {
                water.mirrored[k][i] = if known[i] { light[k][i] } else { water.mirrored[k][i] };
            }
            pixels.z[i] = if known[i] { f32::NAN } else { pixels.z[i] };
        }
    }
}

const _: () = assert!(GROUP.is_multiple_of(NODE_SPACING_PX), "pixels between two nodes are of one group");

impl Scene<'_> {
    /// Samples the water of one kind at the nodes of a row.
    #[inline(always)]
    fn look_at_nodes<S: Lanes>(&self, simd: S, of: NodeKind, y: usize, nodes: &mut [f32]) {
        let WaterSurface { depth, roughness, .. } = self.of.surface;
        let width = self.of.camera.width as usize;
        let columns = nodes.len() / of.parts();
        for first in (0..width.div_ceil(NODE_SPACING_PX) + 1).step_by(GROUP) {
            let mut pixels = Pixels {
                x: [0.5; GROUP],
                y: y as f32 + 0.5,
                z: [f32::NAN; GROUP],
                still: [0.0; GROUP],
                reach: [f32::NAN; GROUP],
            };
            for i in 0..GROUP {
                let x = ((first + i) * NODE_SPACING_PX).min(width - 1);
                let at = y * width + x;
                let still = roughness.get(at).copied().unwrap_or(0.0);
                if of.holds(still) {
                    (pixels.x[i], pixels.z[i], pixels.still[i]) = (x as f32 + 0.5, depth[at], still);
                }
            }
            let mut water = Water::new(false);
            for start in (0..GROUP).step_by(S::N) {
                match of {
                    NodeKind::Films => self.look(simd, start, &pixels, &mut water),
                    NodeKind::Reach => self.find_reach(simd, start, &mut pixels),
                }
            }
            let [red, green, blue] = &water.mirrored;
            let light = [&water.reflected, red, green, blue];
            let parts = if of == NodeKind::Reach { &[&pixels.reach][..] } else { &light };
            for (part, row) in parts.iter().zip(nodes.chunks_mut(columns)) {
                for i in 0..GROUP {
                    row[first + i] = if pixels.z[i].is_nan() { f32::NAN } else { part[i] };
                }
            }
        }
    }
}
