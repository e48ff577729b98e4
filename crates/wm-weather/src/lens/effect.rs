//! The glass over a finished picture.

use super::drops::{drops, looked_for};
use super::geometry::GlassView;
use super::glass::Glass;
use super::layer::{DropLayer, LayerScale, MIN_RADIUS_PX};
use super::veil::Haze;
use super::wide::WideView;
use crate::linear_picture::convert;
use rayon::prelude::*;
use wm_render::hooks::GROUP;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::{Frame, PictureEffect, dispatch};
use wm_scene::Camera;

/// A glass as a picture pass: its only input is the picture of [`super::wide_camera`].
pub struct LensEffect<'a> {
    /// The glass.
    pub glass: &'a Glass,
    /// The camera of the picture.
    pub camera: &'a Camera,
}

/// Most drops on the glass in front of a camera.
const MOST_DROPS: f64 = 3e7;

impl Glass {
    /// Checks that a camera has no more than `MOST_DROPS` drops before it.
    ///
    /// # Errors
    /// One line with their number and what helps.
    pub fn check(&self, camera: &Camera) -> Result<(), String> {
        let Some([low, high]) = self.part_with_drops(camera) else { return Ok(()) };
        let count = (high[0] - low[0]) * (high[1] - low[1]) * looked_for(self);
        if count <= MOST_DROPS {
            return Ok(());
        }
        Err(format!(
            "lens: {count:.1e} drops on the glass before this camera, more than {MOST_DROPS:e}: set larger drops (lens.size), \
             a nearer glass (lens.distance) or a narrower view"
        ))
    }

    /// The part of the glass where drops are large enough to be seen: its least and greatest
    /// corner, m from the point on the view's axis. `None` if there is no such part.
    pub(super) fn part_with_drops(&self, camera: &Camera) -> Option<[[f64; 2]; 2]> {
        if self.rain.is_dry(self.time) {
            return None;
        }
        let least = MIN_RADIUS_PX * LayerScale::before(self, camera).pixels as f64;
        let [low, high] = GlassView::new(self, camera).part_with(self.rain.widest(), least, camera)?.bounds;
        Some([low.map(|v| v - self.aperture), high.map(|v| v + self.aperture)])
    }
}

impl PictureEffect for LensEffect<'_> {
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        let Self { glass, camera } = *self;
        let wide = WideView::new(path, inputs[0]);
        let view = GlassView::new(glass, camera);
        let scale = LayerScale::before(glass, camera);
        let drops = glass.part_with_drops(camera).map_or_else(Vec::new, |bounds| drops(glass, bounds));
        let layer =
            (!drops.is_empty()).then(|| DropLayer::new(glass, &view, camera, &drops, &wide, scale, path));
        let haze = Haze::new(glass, &view, camera, picture, &wide);
        if layer.is_none() && haze.is_none() {
            return;
        }
        let width = picture.width as usize;
        let rows = picture.rgb.par_chunks_mut(3 * width).enumerate();
        rows.for_each_init(RowScratch::default, |RowScratch { drops, added, seen }, (y, line)| {
            seen.clear();
            let start = layer.as_ref().and_then(|layer| layer.row(y, drops));
            if let Some((layer, start)) = layer.as_ref().zip(start) {
                layer.columns(drops, width, start, seen);
            }
            match &haze {
                Some(haze) => {
                    haze.row(y, added);
                    dispatch!(path, s => lay_with_haze(s, line, seen, haze, added));
                }
                None => dispatch!(path, s => lay_drops(s, line, seen)),
            }
        });
    }
}

/// Working memory of a row.
#[derive(Default)]
struct RowScratch {
    drops: Vec<[f32; 4]>,
    added: Vec<[f32; 4]>,
    seen: Vec<(u32, [f32; 4])>,
}

/// Lays drops over the columns of a row that show them.
#[inline(always)]
fn lay_drops<S: Lanes>(simd: S, line: &mut [f32], seen: &[(u32, [f32; 4])]) {
    let mut over = RowBlend::default();
    for (x, drop) in seen {
        over.add(simd, line, *x as usize, *drop, CLEAR_HAZE);
    }
    over.lay(simd, line);
}

/// Lays drops and haze over all columns of a row.
#[inline(always)]
fn lay_with_haze<S: Lanes>(
    simd: S,
    line: &mut [f32],
    seen: &[(u32, [f32; 4])],
    haze: &Haze,
    added: &[[f32; 4]],
) {
    let mut over = RowBlend::default();
    let mut seen = seen.iter().peekable();
    for x in 0..line.len() / 3 {
        let drop = seen.next_if(|(column, _)| *column as usize == x).map_or([0.0; 4], |(_, drop)| *drop);
        over.add(simd, line, x, drop, haze.column(added, x));
    }
    over.lay(simd, line);
}

/// Haze that adds nothing and keeps all.
const CLEAR_HAZE: [f32; 4] = [0.0, 0.0, 0.0, 1.0];

/// Drops and haze over up to sixteen pixels of a row, one array per number.
#[derive(Default)]
struct RowBlend {
    count: usize,
    columns: [usize; GROUP],
    /// Red, green and blue of drops times their cover, and their cover.
    drops: [[f32; GROUP]; 4],
    /// Red, green and blue that are added, and the share of light that is kept.
    haze: [[f32; GROUP]; 4],
}

impl RowBlend {
    /// Adds a column, and lays all over the row when there are sixteen.
    #[inline(always)]
    fn add<S: Lanes>(&mut self, simd: S, line: &mut [f32], x: usize, drop: [f32; 4], haze: [f32; 4]) {
        let i = self.count;
        self.columns[i] = x;
        (0..4).for_each(|k| self.drops[k][i] = drop[k]);
        (0..4).for_each(|k| self.haze[k][i] = haze[k]);
        self.count += 1;
        if self.count == GROUP {
            self.lay(simd, line);
        }
    }

    /// Lays it over the row, in linear light.
    #[inline(always)]
    fn lay<S: Lanes>(&mut self, simd: S, line: &mut [f32]) {
        let (pixels, _) = line.as_chunks_mut::<3>();
        let mut light = [[0.0f32; GROUP]; 3];
        for i in 0..self.count {
            let pixel = &pixels[self.columns[i]];
            (0..3).for_each(|k| light[k][i] = pixel[k].max(0.0));
        }
        convert::<S, false>(simd, &mut light);
        for k in 0..3 {
            for i in 0..GROUP {
                let seen = light[k][i] * (1.0 - self.drops[3][i]) + self.drops[k][i];
                light[k][i] = seen * self.haze[3][i] + self.haze[k][i];
            }
        }
        convert::<S, true>(simd, &mut light);
        for i in 0..self.count {
            pixels[self.columns[i]] = [light[0][i], light[1][i], light[2][i]];
        }
        self.count = 0;
    }
}
