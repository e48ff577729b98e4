//! Drops as a picture of their own: their light and their cover, as coarse as the aperture blurs
//! them.
//!
//! Drops that touch are one surface: each adds `(1 - rho^2 / S^2)^2` about it, with `rho` its
//! distance from the middle in radii, and water is where the sum is as great as on the rim of a
//! single one. The slope is that of a cap for a single drop, and goes over where drops meet.

use super::drops::GlassDrop;
use super::geometry::GlassView;
use super::glass::Glass;
use super::wide::WideView;
use crate::linear_picture::mix;
use crate::water::WATER_INDEX;
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};
use wm_scene::Camera;

/// Radii up to which a drop joins others.
const JOINING_REACH_RADII: f32 = 1.4;
/// Sum of what drops add at the rim of one.
const RIM_SUM: f32 = (1.0 - 1.0 / (JOINING_REACH_RADII * JOINING_REACH_RADII))
    * (1.0 - 1.0 / (JOINING_REACH_RADII * JOINING_REACH_RADII));
/// Rows that one thread draws at a time.
const BAND_ROWS: usize = 8;
/// Least radius that is drawn, px of the layer.
pub(super) const MIN_RADIUS_PX: f64 = 0.4;
/// Radius, m, from which a drop sags, and how much.
const SAGGING_RADIUS_M: f32 = 2.5e-3;
const SAG_SHARE: f32 = 0.22;
/// Coverage of a pixel below which drops in it are invisible.
const MIN_COVER: f32 = 1.0 / 1024.0;
/// Empty pixels before and after a row that is laid over the picture.
const PADDING_PX: usize = 2;
/// Light inside, which a rim reflects, as a share of the mean outside.
const INSIDE_LIGHT_SHARE: f32 = 0.05;

/// The fineness of a layer, and its blur.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LayerScale {
    /// Picture pixels in one of the layer.
    pub(crate) pixels: usize,
    /// Radius of the disc of blur, px of the layer; 0 if edges alone are blurred.
    pub(crate) disc: f32,
    /// Width of an edge, px of the layer.
    pub(crate) edge: f32,
    /// Layer pixels beyond each side of the picture.
    pub(crate) margin: usize,
}

impl LayerScale {
    /// The scale for a glass in front of a camera.
    pub(crate) fn before(glass: &Glass, camera: &Camera) -> Self {
        let focal = (camera.fx * camera.fy).sqrt();
        Self::new((glass.aperture / glass.distance * focal) as f32)
    }

    /// For a blur of this diameter, px of the picture.
    pub(crate) fn new(blur: f32) -> Self {
        let pixels = match blur {
            blur if blur < 2.5 => 1,
            blur if blur < 18.0 => ((blur / 3.0).round() as usize).max(2),
            _ => (blur / 6.0) as usize,
        };
        let disc = if pixels == 1 { 0.0 } else { 0.5 * blur / pixels as f32 };
        let edge = if pixels == 1 { blur.max(1.0) } else { 1.0 };
        Self { pixels, disc, edge, margin: disc.ceil() as usize + usize::from(pixels > 1) }
    }
}

/// The drops in front of a picture.
pub(super) struct DropLayer {
    pub(crate) scale: LayerScale,
    pub(crate) width: usize,
    /// Light times cover, and cover; row by row.
    pub(crate) pixels: Vec<[f32; 4]>,
    /// First and last column with drops of each row, empty where there is none.
    spans: Vec<[usize; 2]>,
}

/// A drop as it is drawn, px of the layer.
struct DrawnDrop {
    at: [f32; 2],
    inverse: [f32; 2],
    reach: [f32; 2],
    radius: f32,
}

/// Numbers that all pixels share.
struct Optics<'a> {
    wide: &'a WideView,
    inside: [f32; 3],
    /// Sine of the contact angle.
    rim: f32,
    tilt: [f32; 2],
    sag: f32,
}

impl DropLayer {
    /// Draws drops in front of a camera.
    pub(crate) fn new(
        glass: &Glass,
        view: &GlassView,
        camera: &Camera,
        drops: &[GlassDrop],
        wide: &WideView,
        scale: LayerScale,
        path: SimdPath,
    ) -> Self {
        let side = |length: u32| (length as usize).div_ceil(scale.pixels) + 2 * scale.margin;
        let (width, height) = (side(camera.width), side(camera.height));
        let finer = 1.0 / scale.pixels as f64;
        let drawn: Vec<DrawnDrop> = drops
            .iter()
            .filter_map(|drop| {
                let (at, px) = view.project(drop.at);
                let radii = [drop.radius * px[0] * finer, drop.radius * drop.aspect * px[1] * finer];
                if radii[0].min(radii[1]) < MIN_RADIUS_PX {
                    return None;
                }
                let at = at.map(|v| (v * finer + scale.margin as f64) as f32);
                let radii = radii.map(|v| v as f32);
                let reach = radii.map(|v| v * JOINING_REACH_RADII);
                let is_seen = at[0] + reach[0] > 0.0
                    && at[0] - reach[0] < width as f32
                    && at[1] + reach[1] > 0.0
                    && at[1] - reach[1] < height as f32;
                is_seen.then(|| DrawnDrop {
                    at,
                    inverse: radii.map(|v| 1.0 / v),
                    reach,
                    radius: (radii[0] * radii[1]).sqrt(),
                })
            })
            .collect();
        let mut bands: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(BAND_ROWS)];
        for (i, drop) in drawn.iter().enumerate() {
            let row = |y: f32| (y.max(0.0) as usize / BAND_ROWS).min(bands.len() - 1);
            let (first, last) = (row(drop.at[1] - drop.reach[1]), row(drop.at[1] + drop.reach[1]));
            bands[first..=last].iter_mut().for_each(|band| band.push(i as u32));
        }
        let (sin, cos) = glass.tilt.sin_cos();
        // Metres of a pixel of the layer, for how large a drop is.
        let metre = view.project([0.0; 2]).1[0] * finer;
        let optics = Optics {
            wide,
            inside: wide.mean().map(|v| v * INSIDE_LIGHT_SHARE),
            rim: glass.contact.sin() as f32,
            tilt: [sin as f32, cos as f32],
            sag: 1.0 / (SAGGING_RADIUS_M * metre as f32),
        };
        let mut pixels = vec![[0.0f32; 4]; width * height];
        let mut spans = vec![[0, 0]; height];
        let lines = pixels.par_chunks_mut(BAND_ROWS * width).zip(spans.par_chunks_mut(BAND_ROWS)).zip(&bands);
        lines.enumerate().for_each_init(Vec::new, |sums, (band, ((pixels, spans), list))| {
            if list.is_empty() {
                return;
            }
            sums.clear();
            sums.resize(pixels.len(), [0.0f32; 4]);
            let drops = list.iter().map(|i| &drawn[*i as usize]);
            let first_row = band * BAND_ROWS;
            dispatch!(path, s => optics.draw(s, drops, first_row, width, sums, spans, pixels, scale, camera));
        });
        let mut layer = Self { scale, width, pixels, spans };
        if scale.disc > 0.0 && !drawn.is_empty() {
            layer.blur(path);
        }
        layer
    }

    /// Blurs by the disc of the aperture.
    fn blur(&mut self, path: SimdPath) {
        let radius = self.scale.disc;
        let reach = (radius + 0.5).ceil() as isize;
        let mut taps = Vec::new();
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let weight = (radius + 0.5 - ((dx * dx + dy * dy) as f32).sqrt()).clamp(0.0, 1.0);
                if weight > 0.0 {
                    taps.push((dx, dy, weight));
                }
            }
        }
        let sum: f32 = taps.iter().map(|(_, _, weight)| weight).sum();
        let (width, height) = (self.width, self.spans.len());
        let source = std::mem::take(&mut self.pixels);
        let mut blurred = vec![[0.0f32; 4]; source.len()];
        let spans: Vec<[usize; 2]> = (0..height)
            .map(|y| {
                let rows = y.saturating_sub(reach as usize)..(y + reach as usize + 1).min(height);
                let near = self.spans[rows].iter().filter(|span| span[0] < span[1]);
                let joined = near.fold([usize::MAX, 0], |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
                match joined[0] < joined[1] {
                    true => {
                        [joined[0].saturating_sub(reach as usize), (joined[1] + reach as usize).min(width)]
                    }
                    false => [0, 0],
                }
            })
            .collect();
        blurred.par_chunks_mut(width).zip(&spans).enumerate().for_each(|(y, (line, span))| {
            if span[0] < span[1] {
                dispatch!(path, _s => blur_row(&source, width, height, y, line, *span, &taps, sum));
            }
        });
        self.pixels = blurred;
        self.spans = spans;
    }

    /// Writes the light and the cover along a row of a picture, between the columns of the layer
    /// that have drops. Returns the first of the columns that are written; `None` where there are
    /// no drops.
    pub(crate) fn row(&self, y: usize, line: &mut Vec<[f32; 4]>) -> Option<usize> {
        let LayerScale { pixels: scale, margin, .. } = self.scale;
        let at = (y as f32 + 0.5) / scale as f32 - 0.5 + margin as f32;
        let top = (at.max(0.0) as usize).min(self.spans.len() - 1);
        let below = (top + 1).min(self.spans.len() - 1);
        let part = at.max(0.0) - top as f32;
        let spans = [self.spans[top], self.spans[below]].into_iter().filter(|span| span[0] < span[1]);
        let [first, last] = spans.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        let [top, below] = [top, below].map(|row| &self.pixels[row * self.width..][first..last]);
        line.clear();
        line.extend([[0.0; 4]; PADDING_PX]);
        line.extend(top.iter().zip(below).map(|(a, b)| mix(a, b, part)));
        line.extend([[0.0; 4]; PADDING_PX]);
        Some(first)
    }

    /// Appends each column below `width` that shows a drop, from left to right, with its light and
    /// its cover, from what [`Self::row`] wrote from the column `start` of the layer on.
    pub(crate) fn columns(
        &self,
        line: &[[f32; 4]],
        width: usize,
        start: usize,
        seen: &mut Vec<(u32, [f32; 4])>,
    ) {
        let LayerScale { pixels: scale, margin, .. } = self.scale;
        let shift = if scale % 2 == 0 { 0.5 } else { 0.0 };
        for (i, pair) in line.windows(2).enumerate() {
            let [a, b] = [&pair[0], &pair[1]];
            if a[3].max(b[3]) <= MIN_COVER {
                continue;
            }
            // Pixels of the picture between the middles of both.
            let first = (i + start) as isize - (margin + PADDING_PX) as isize;
            let first = first * scale as isize + scale as isize / 2;
            for j in 0..scale {
                let x = first + j as isize;
                if (0..width as isize).contains(&x) {
                    let part = (j as f32 + shift) / scale as f32;
                    seen.push((x as u32, mix(a, b, part)));
                }
            }
        }
    }
}

/// Writes a row of what a disc of `taps` blurs, between two columns.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "the layer, the row and the disc of one pass")]
fn blur_row(
    source: &[[f32; 4]],
    width: usize,
    height: usize,
    y: usize,
    line: &mut [[f32; 4]],
    span: [usize; 2],
    taps: &[(isize, isize, f32)],
    sum: f32,
) {
    let [first, last] = span;
    for (dx, dy, weight) in taps {
        let row = y as isize + dy;
        if row < 0 || row >= height as isize {
            continue;
        }
        // Columns whose neighbour is in the layer.
        let from = (first as isize).max(-dx) as usize;
        let to = (last as isize).min(width as isize - dx).max(from as isize) as usize;
        let start = row as usize * width + (from as isize + dx) as usize;
        let weight = weight / sum;
        for (out, pixel) in line[from..to].iter_mut().zip(&source[start..]) {
            (0..4).for_each(|k| out[k] += weight * pixel[k]);
        }
    }
}

/// Adds a drop to the sums of some rows: the weight, the slope twice, and its radius.
#[inline(always)]
fn add(drop: &DrawnDrop, first: usize, width: usize, sums: &mut [[f32; 4]], spans: &mut [[usize; 2]]) {
    let rows = sums.len() / width;
    let top = (drop.at[1] - drop.reach[1] - 0.5).ceil().max(first as f32) as usize;
    let bottom = ((drop.at[1] + drop.reach[1] + 0.5).floor().max(0.0) as usize).min(first + rows);
    let left = (drop.at[0] - drop.reach[0] - 0.5).ceil().max(0.0) as usize;
    let right = ((drop.at[0] + drop.reach[0] + 0.5).floor().max(0.0) as usize).min(width);
    if left >= right {
        return;
    }
    let scale = 1.0 / (JOINING_REACH_RADII * JOINING_REACH_RADII);
    for y in top..bottom {
        let dy = (y as f32 + 0.5 - drop.at[1]) * drop.inverse[1];
        let line = &mut sums[(y - first) * width..][left..right];
        for (x, sum) in line.iter_mut().enumerate() {
            let dx = ((left + x) as f32 + 0.5 - drop.at[0]) * drop.inverse[0];
            let part = (1.0 - (dx * dx + dy * dy) * scale).max(0.0);
            let weight = part * part;
            sum[0] += weight;
            sum[1] += part * dx;
            sum[2] += part * dy;
            sum[3] += weight * drop.radius;
        }
        let span = &mut spans[y - first];
        *span = if span[0] < span[1] { [span[0].min(left), span[1].max(right)] } else { [left, right] };
    }
}

impl Optics<'_> {
    /// Draws drops into rows from the row `first` of the layer on.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "the rows, their buffers and the optics of one pass")]
    fn draw<'d, S: Lanes>(
        &self,
        simd: S,
        drops: impl Iterator<Item = &'d DrawnDrop>,
        first: usize,
        width: usize,
        sums: &mut [[f32; 4]],
        spans: &mut [[usize; 2]],
        pixels: &mut [[f32; 4]],
        scale: LayerScale,
        camera: &Camera,
    ) {
        drops.for_each(|drop| add(drop, first, width, sums, spans));
        let place = |at: usize, middle: f64| {
            (at as f32 - scale.margin as f32 + 0.5) * scale.pixels as f32 - middle as f32
        };
        let step = scale.pixels as f32 / camera.fx as f32;
        for (k, span) in spans.iter().enumerate() {
            let down = place(first + k, camera.cy) / camera.fy as f32;
            for x in (span[0]..span[1]).step_by(S::N) {
                let own = k * width + x..k * width + span[1].min(x + S::N);
                let (sums, pixels) = (&sums[own.clone()], &mut pixels[own]);
                let right = place(x, camera.cx) / camera.fx as f32;
                self.shade(simd, sums, scale.edge, right, step, down, pixels);
            }
        }
    }

    /// Writes the light times cover, and the cover, of pixels with these sums that look along
    /// `(right + i step, down, 1)`; as many as there are lanes, or fewer.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "the pixels of a block and where they are on the glass")]
    fn shade<S: Lanes>(
        &self,
        simd: S,
        sums: &[[f32; 4]],
        edge: f32,
        right: f32,
        step: f32,
        down: f32,
        pixels: &mut [[f32; 4]],
    ) {
        let mut columns = [[0.0; 16]; 5];
        for (i, sum) in sums.iter().enumerate() {
            for k in 0..4 {
                columns[k][i] = sum[k];
            }
            columns[4][i] = right + i as f32 * step;
        }
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let whole = simd.load(&columns[0]);
        let is_wet = whole.simd_gt(simd.set(0.02 * RIM_SUM));
        if !is_wet.any_true() {
            return;
        }
        let whole = is_wet.select(whole, one);
        let root = whole.sqrt();
        let radius = simd.load(&columns[3]) / whole;
        // Distance from the middle in radii, as a single drop has it.
        let away = (one - root).max(zero).sqrt() * JOINING_REACH_RADII;
        let cover = ((one - away) * radius * (1.0 / edge) + 0.5).max(zero).min(one);
        let is_seen = is_wet & cover.simd_gt(zero);
        let seen = is_seen.to_bitmask() as u32;
        if seen == 0 {
            return;
        }
        let slope = [simd.load(&columns[1]) / root, simd.load(&columns[2]) / root];
        let steep = slope[0].mul_add(slope[0], slope[1] * slope[1]).sqrt();
        // Rims are as steep as the contact angle wherever drops meet.
        let inner = away.min(one);
        let rim = inner * inner * inner * inner;
        let wanted = (inner - steep).mul_add(rim, steep).min(one);
        let scale = wanted * self.rim / steep.max(simd.set(1e-4));
        let heavy = (radius * self.sag).min(one);
        let sag = heavy * heavy * (one - wanted * wanted) * (SAG_SHARE * self.rim);
        let normal = [slope[0] * scale, slope[1] * scale - sag];
        let flat = normal[0].mul_add(normal[0], normal[1] * normal[1]);
        let up = (one - flat).max(simd.set(1e-4)).sqrt();
        // The ray along the axes of the glass, bent by its inner side.
        let [sin, cos] = self.tilt;
        let right = simd.load(&columns[4]);
        let (below, ahead) = (down * cos + sin, cos - down * sin);
        let inverse =
            one / (right.mul_add(right, simd.set(below * below + ahead * ahead)).sqrt() * WATER_INDEX);
        let (x, y) = (right * inverse, inverse * below);
        let z = (one - x * x - y * y).sqrt();
        let inside = x.mul_add(normal[0], y.mul_add(normal[1], z * up));
        let squared = one - (one - inside * inside) * (WATER_INDEX * WATER_INDEX);
        let is_bent = squared.simd_gt(zero);
        let outside = is_bent.select(squared, one).sqrt();
        let bend = outside - inside * WATER_INDEX;
        let (x, y, z) = (
            x.mul_add(simd.set(WATER_INDEX), bend * normal[0]),
            y.mul_add(simd.set(WATER_INDEX), bend * normal[1]),
            z.mul_add(simd.set(WATER_INDEX), bend * up),
        );
        let way = [x, y * cos - z * sin, y * sin + z * cos];
        // What a pixel sees of the view, which the rim squeezes.
        let squeezed = inside * WATER_INDEX / outside.max(simd.set(0.15)) - 1.0;
        let cone = simd.set(self.rim) / radius.max(simd.set(0.5)) / up * squeezed;
        let cone = cone.max(-cone).min(simd.set(0.8));
        let bent = (is_seen & is_bent).to_bitmask() as u32;
        let mut light = [[0.0; 4]; 16];
        self.wide.look(simd, way, cone, bent, &mut light);
        let lost = one - outside;
        let reflected = (lost * lost) * (lost * lost) * lost * 0.98 + 0.02;
        let reflected = is_bent.select(reflected, one);
        let (mut covers, mut shares) = ([0.0; 16], [0.0; 16]);
        cover.store_slice(&mut covers[..S::N]);
        reflected.store_slice(&mut shares[..S::N]);
        for (i, pixel) in pixels.iter_mut().enumerate() {
            if seen >> i & 1 == 1 {
                for k in 0..3 {
                    pixel[k] = covers[i] * (light[i][k] + shares[i] * (self.inside[k] - light[i][k]));
                }
                pixel[3] = covers[i];
            }
        }
    }
}
