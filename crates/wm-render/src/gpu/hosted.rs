//! The CPU's part of a GPU's frame: attributes of splats, backgrounds of more than one colour,
//! gathering particles, and pixel effects on the finished picture.

use super::source::TILE_SIDE;
use crate::attributes::{Attribute, AttributeBlock, SplatAttributes};
use crate::frame::Frame;
use crate::hooks::{GROUP, PATCH, PATCH_PIXELS};
use crate::pixel_effects::apply_pixel_effects;
use crate::plan::DrawPass;
use crate::simd::SimdPath;
use crate::stages::composite::background::{BackgroundScratch, BackgroundView};
use crate::stages::composite::gpu::BackgroundForm;
use rayon::prelude::*;

/// Returns the attributes of the splats with indices `source` in the loaded set, in whole groups of
/// sixteen, in the layout of `activated.wgsl`.
pub(crate) fn attributes(attributes: &dyn SplatAttributes, source: &[u32]) -> Vec<f32> {
    const BLOCKS_PER_TASK: usize = 16;
    const SPLATS_PER_BLOCK: usize = AttributeBlock::MAX_SPLATS;
    let mut numbers = vec![0.0; Attribute::COUNT * source.len()];
    let parts = numbers.par_chunks_mut(BLOCKS_PER_TASK * SPLATS_PER_BLOCK * Attribute::COUNT);
    parts.zip(source.par_chunks(BLOCKS_PER_TASK * SPLATS_PER_BLOCK)).for_each(|(numbers, source)| {
        let mut block = AttributeBlock::default();
        for (numbers, source) in
            numbers.chunks_mut(SPLATS_PER_BLOCK * Attribute::COUNT).zip(source.chunks(SPLATS_PER_BLOCK))
        {
            block.read(attributes, source);
            let (rows, _) = numbers.as_chunks_mut::<GROUP>();
            for (group, rows) in rows.chunks_exact_mut(Attribute::COUNT).enumerate() {
                for (row, attribute) in rows.iter_mut().zip(Attribute::ALL) {
                    *row = *block.group(group, attribute);
                }
            }
        }
    });
    numbers
}

const _: () = assert!(PATCH == TILE_SIDE as usize, "patches are those of `nodes.wgsl`");

/// Chooses the form in which a background goes to the GPU.
pub(crate) fn background_form(view: &BackgroundView<'_>) -> BackgroundForm {
    match (view.uniform, view.nodes()) {
        (Some(_), _) => BackgroundForm::Color,
        (None, Some(nodes)) => BackgroundForm::Nodes(nodes as u32),
        (None, None) => BackgroundForm::Picture,
    }
}

/// Paints the background seen through the air, in the form that [`background_form`] chose.
pub(crate) fn background(
    view: &BackgroundView<'_>,
    form: BackgroundForm,
    width: u32,
    height: u32,
) -> Vec<f32> {
    let (width, height) = (width as usize, height as usize);
    let numbers = match form {
        BackgroundForm::Color => 3,
        BackgroundForm::Nodes(nodes) => {
            3 * (nodes * nodes) as usize * width.div_ceil(PATCH) * height.div_ceil(PATCH)
        }
        BackgroundForm::Picture => 3 * width * height,
    };
    let mut background = vec![0.0; numbers];
    match form {
        BackgroundForm::Color => background.copy_from_slice(&view.uniform.unwrap_or_default()),
        BackgroundForm::Nodes(nodes) => {
            let of_patch = (nodes * nodes) as usize;
            let columns = width.div_ceil(PATCH);
            let (nodes, _) = background.as_chunks_mut::<3>();
            nodes.par_chunks_mut(of_patch * columns).enumerate().for_each(|(row, nodes)| {
                let mut scratch = BackgroundScratch::default();
                for (column, nodes) in nodes.chunks_exact_mut(of_patch).enumerate() {
                    view.fill_nodes(column, row, &mut scratch, nodes);
                }
            });
        }
        BackgroundForm::Picture => {
            background.par_chunks_mut(3 * width * PATCH).enumerate().for_each(|(row, pixels)| {
                let (mut scratch, mut patch) = (BackgroundScratch::default(), [[0.0; PATCH_PIXELS]; 3]);
                for column in 0..width.div_ceil(PATCH) {
                    view.fill(column, row, &mut scratch, &mut patch);
                    for (y, line) in pixels.chunks_exact_mut(3 * width).enumerate() {
                        let line = &mut line.as_chunks_mut::<3>().0[column * PATCH..];
                        for (x, pixel) in line.iter_mut().take(PATCH).enumerate() {
                            *pixel = patch.each_ref().map(|channel| channel[y * PATCH + x]);
                        }
                    }
                }
            });
        }
    }
    background
}

/// Applies the pixel effects to a finished picture; `hidden` is the depth where the frame has none.
pub(crate) fn pixel_effects(path: SimdPath, pass: &DrawPass<'_>, frame: &mut Frame, hidden: &[f32]) {
    let Frame { width, rgb, alpha, depth, .. } = frame;
    let depth = if depth.is_empty() { hidden } else { depth };
    apply_pixel_effects(path, &pass.hooks.pixels, *width as usize, rgb, alpha, depth);
}
