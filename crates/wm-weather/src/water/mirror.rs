//! The scene from the eye that a water plane mirrors.

use super::map::WaterMap;
use super::surface::WaterSurface;
use super::tile::{bilinear, fineness};
use crate::lanes::{LaneArray, LaneIndices, SetLanes};
use crate::linear_picture::LinearPicture;
use fearless_simd::{Select, SimdBase, SimdFloat, f32x4};
use rayon::prelude::*;
use wm_render::simd::{Lanes, SimdPath, log2};
use wm_render::{CutPlane, Frame, dispatch};
use wm_scene::Camera;

/// Picture beyond the sides of the view that waves look into, as a share of its height.
const MARGIN_HEIGHT_SHARE: f64 = 0.06;
/// Splats whose centre is no higher above the water than this are not mirrored: those of a
/// waterline are on both sides.
const WATERLINE_HEIGHT_M: f64 = 0.01;
/// Width of a box over that of a pixel of a halved picture with the same variance: binomial weights
/// reach farther.
const BOX_WIDTH_RATIO: f32 = 0.58;
/// Distance from a whole level up to which a level counts as that.
const SNAP_DISTANCE_LEVELS: f32 = 0.25;
/// Pieces of a mirrored picture are at most so many times as tall as wide, as a power of 2.
const MAX_ASPECT_LOG2: usize = 4;

/// A camera at the mirrored eye.
///
/// A mirrored picture is no picture of any camera: left and right change places. So a proper camera
/// draws it the wrong way round, and look-ups count its columns from the right. Points of the world
/// are projected with it as with any other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorView {
    /// The camera, at half size; at a quarter where only films mirror.
    pub camera: Camera,
    /// The water plane: nothing below it is mirrored.
    pub cut: CutPlane,
}

impl MirrorView {
    /// The mirrored view of the water in a camera's picture.
    #[must_use]
    pub fn new(map: &WaterMap, surface: &WaterSurface, camera: &Camera) -> Self {
        let up = glam::DVec3::from_array(map.axes[2]);
        let height = surface.level / map.metres_per_unit;
        // p -> p - 2 (up . p - height) up, then x -> -x in the view, so that it is a rotation
        // again.
        let turned = |v: glam::DVec3| v - 2.0 * up.dot(v) * up;
        let rotation = camera.rotation();
        let [x, y, z] = [0, 1, 2].map(|k| turned(rotation.row(k)));
        let rotation = glam::DMat3::from_cols(-x, y, z).transpose();
        let eye = camera.center();
        let eye = eye - 2.0 * (up.dot(eye) - height) * up;
        let margin = (MARGIN_HEIGHT_SHARE * f64::from(camera.height)).ceil();
        let (first, last) = (f64::from(surface.rows.start) - margin, f64::from(surface.rows.end) + margin);
        let (width, rows) = (f64::from(camera.width) + 2.0 * margin, last - first);
        let whole = Camera {
            width: width as u32,
            height: rows as u32,
            cx: f64::from(camera.width) - camera.cx + margin,
            cy: camera.cy - first,
            viewmat: Camera::posed((1, 1), 50.0, eye, rotation).viewmat,
            ..*camera
        };
        let finer = if surface.is_film() { 4 } else { 2 };
        let small = whole.resized(whole.width.div_ceil(finer), whole.height.div_ceil(finer));
        let cut = CutPlane { normal: map.axes[2], height: height + WATERLINE_HEIGHT_M / map.metres_per_unit };
        Self { camera: small, cut }
    }
}

/// A mirrored picture in linear light at every fineness, with the reciprocal of its depth.
///
/// Rough water smears what it mirrors along the view far more than across, so that there are levels
/// for each fineness across and for each along. Each row ends with its last pixel once more, and
/// each level with its last row, so that look-ups need no edges.
#[derive(Clone, Debug, Default)]
pub(crate) struct MirroredPicture {
    /// Width and height of the finest level, px.
    size: [f32; 2],
    /// Number of times that both sides are halved, and once more.
    levels: usize,
    /// First pixel and length of a row of each level: by the halvings of both sides, and for each
    /// by those of the height beyond them.
    places: Vec<[u32; 2]>,
    /// Red, green, blue, and the reciprocal of the view z.
    pixels: Vec<[f32; 4]>,
    /// The last of these of the finest level.
    inverse: Vec<f32>,
}

impl MirroredPicture {
    /// Makes all levels of a drawn picture with depth. What is brighter than `white`, linear,
    /// counts as that.
    pub(crate) fn new(path: SimdPath, frame: &Frame, white: f32) -> Self {
        let whole = LinearPicture::new(path, frame);
        let levels = Level::all(whole.width, whole.height);
        let mut pixels = vec![[0.0; 4]; levels[levels.len() - 1][MAX_ASPECT_LOG2].end()];
        let finest = levels[0][0];
        finest.fill(&mut pixels, |y, line, _| {
            let own = y * whole.width..(y + 1) * whole.width;
            let depths = frame.depth[own.clone()].iter().zip(&frame.alpha[own.clone()]);
            for ((pixel, light), (depth, alpha)) in line.iter_mut().zip(&whole.pixels[own]).zip(depths) {
                (0..3).for_each(|k| pixel[k] = light[k].min(white));
                // Sky shines through where splats are thin: it is as far as what is seen of it.
                pixel[3] = if *depth > 0.0 { alpha / depth } else { 0.0 };
            }
        });
        let inverse = pixels[..finest.end()].iter().map(|pixel| pixel[3]).collect();
        for (k, of) in levels.iter().enumerate() {
            for (from, to) in of.iter().zip(&of[1..]) {
                to.fill(&mut pixels, |y, line, before| {
                    let rows = std::array::from_fn(|k| from.row(before, near(y, k, from.height)));
                    dispatch!(path, s => half_as_tall(s, rows, line));
                });
            }
            if let Some(next) = levels.get(k + 1) {
                next[0].fill(&mut pixels, |y, line, before| {
                    dispatch!(path, s => half_as_wide(s, of[1].row(before, y), line));
                });
            }
        }
        let place = |level: &Level| [level.first as u32, level.stride() as u32];
        let places = levels.as_flattened().iter().map(place).collect();
        let size = [whole.width as f32, whole.height as f32];
        Self { size, levels: levels.len(), places, pixels, inverse }
    }

    /// The fineness for pieces of the picture, px: the levels about it, and the share of each.
    #[inline(always)]
    pub(super) fn fineness<S: Lanes>(&self, simd: S, Extent { wide, tall }: Extent<S>) -> Fineness<S> {
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let last = simd.set((self.levels - 1) as f32);
        let [across, along] =
            log2(simd, [(wide * BOX_WIDTH_RATIO).max(one), (tall * BOX_WIDTH_RATIO).max(one)]);
        let across = across.max(zero).min(last);
        let along = along.max(across).min(across + MAX_ASPECT_LOG2 as f32);
        let whole = [across.floor(), along.floor()];
        // Nearly whole levels are taken for whole ones: most pieces are found in two levels then.
        let mut part = [across, along];
        for k in 0..2 {
            part[k] = ((part[k] - whole[k] - SNAP_DISTANCE_LEVELS)
                * (1.0 / (1.0 - 2.0 * SNAP_DISTANCE_LEVELS)))
                .max(zero)
                .min(one);
        }
        // Between the corners of a triangle: the fine one, the coarse one, and the one that is
        // coarser on the side that needs it more.
        let is_tall = part[1].simd_ge(part[0]);
        let next = [(whole[0] + one).min(last), whole[1] + one];
        let corners = [whole, [is_tall.select(whole[0], next[0]), is_tall.select(next[1], whole[1])], next];
        let (less, more) = (part[0].min(part[1]), part[0].max(part[1]));
        let shares = [one - more, more - less, less];
        let (mut scales, mut first, mut stride) = ([[zero; 2]; 3], [[0; 16]; 3], [[0; 16]; 3]);
        for (k, corner) in corners.iter().enumerate() {
            scales[k] = [fineness(simd, corner[0]), fineness(simd, corner[1])];
            let taller = (corner[1] - corner[0]).max(zero).min(simd.set(MAX_ASPECT_LOG2 as f32));
            let place =
                LaneIndices::new(simd, corner[0].mul_add(simd.set((MAX_ASPECT_LOG2 + 1) as f32), taller));
            for i in 0..S::N {
                [first[k][i], stride[k][i]] = self.places[place.0[i] as usize];
            }
        }
        let [a, b, c] = shares;
        Fineness {
            scales,
            first,
            stride,
            shares: [LaneArray::new(simd, a), LaneArray::new(simd, b), LaneArray::new(simd, c)],
        }
    }

    /// Adds the colours at points of the picture, px, times weights, to `sums`, for the lanes that
    /// have a bit in `wanted`.
    #[inline(always)]
    pub(super) fn add<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        fineness: &Fineness<S>,
        weights: S::F,
        wanted: u32,
        sums: &mut [[f32; 4]; 16],
    ) {
        let mut within = points;
        for k in 0..2 {
            within[k] = points[k].max(simd.set(0.0)).min(simd.set(self.size[k]));
        }
        let Fineness { scales, first, stride, shares } = fineness;
        let fine = Spots::new(simd, within, scales[0], &first[0], &stride[0]);
        let middle = Spots::new(simd, within, scales[1], &first[1], &stride[1]);
        let coarse = Spots::new(simd, within, scales[2], &first[2], &stride[2]);
        let weights = LaneArray::new(simd, weights);
        for i in SetLanes(wanted) {
            let mut own = fine.look(simd, i, stride[0][i], &self.pixels) * shares[0].0[i];
            if shares[1].0[i] > 0.0 {
                own = middle.look(simd, i, stride[1][i], &self.pixels) * shares[1].0[i] + own;
            }
            if shares[2].0[i] > 0.0 {
                own = coarse.look(simd, i, stride[2][i], &self.pixels) * shares[2].0[i] + own;
            }
            (own * weights.0[i] + f32x4::from_slice(simd, &sums[i])).store_slice(&mut sums[i]);
        }
    }

    /// Adds the colours of several looks of one fineness, each at its points and with its weights;
    /// the first look is by the mean slope.
    ///
    /// Water mirrors nothing that is nearer than itself, but blurred pieces of the picture contain
    /// some of it. A look whose mean is nearer counts less, and the single pixel at the first look
    /// takes its place.
    ///
    /// All looks of a pixel are made one after the other: they read the same levels, so that the
    /// processor predicts the branches.
    #[inline(always)]
    pub(super) fn add_all<S: Lanes>(
        &self,
        simd: S,
        looks: &[([S::F; 2], S::F)],
        fineness: &Fineness<S>,
        seen: ReflectionLanes<S>,
        sums: &mut [[f32; 4]; 16],
    ) {
        // One copy for each number of looks: loops of known length are faster.
        match looks.len() {
            1 => self.add_looks::<S, 1>(simd, looks, fineness, seen, sums),
            3 => self.add_looks::<S, 3>(simd, looks, fineness, seen, sums),
            5 => self.add_looks::<S, 5>(simd, looks, fineness, seen, sums),
            other => unreachable!("{other} looks"),
        }
    }

    #[inline(always)]
    fn add_looks<S: Lanes, const LOOKS: usize>(
        &self,
        simd: S,
        looks: &[([S::F; 2], S::F)],
        fineness: &Fineness<S>,
        seen: ReflectionLanes<S>,
        sums: &mut [[f32; 4]; 16],
    ) {
        let nearest = LaneArray::new(simd, seen.nearest);
        let Fineness { scales, first, stride, shares } = fineness;
        let mut spots = [const { [Spots::NONE; 3] }; LOOKS];
        let mut weights = [const { LaneArray([0.0; 16]) }; LOOKS];
        for (k, (points, weight)) in looks.iter().enumerate() {
            let mut within = *points;
            for k in 0..2 {
                within[k] = points[k].max(simd.set(0.0)).min(simd.set(self.size[k]));
            }
            for level in 0..3 {
                spots[k][level] = Spots::new(simd, within, scales[level], &first[level], &stride[level]);
            }
            weights[k] = LaneArray::new(simd, *weight);
        }
        let mut at_finest = looks[0].0;
        for k in 0..2 {
            at_finest[k] = at_finest[k].max(simd.set(0.0)).min(simd.set(self.size[k])).floor();
        }
        let at_finest = [LaneIndices::new(simd, at_finest[0]), LaneIndices::new(simd, at_finest[1])];
        for i in SetLanes(seen.wanted) {
            let (mut share, mut rows) = ([0.0; 3], [0; 3]);
            for level in 0..3 {
                (share[level], rows[level]) = (shares[level].0[i], stride[level][i]);
            }
            let mut sum = f32x4::from_slice(simd, &sums[i]);
            let mut hidden = 0.0;
            for (spots, weight) in spots.iter().zip(&weights) {
                if weight.0[i] > 0.0 {
                    let mut own = spots[0].look(simd, i, rows[0], &self.pixels) * share[0];
                    for level in 1..3 {
                        if share[level] > 0.0 {
                            own = spots[level].look(simd, i, rows[level], &self.pixels) * share[level] + own;
                        }
                    }
                    let mut weight = weight.0[i];
                    let mut parts = [0.0; 4];
                    own.store_slice(&mut parts);
                    if parts[3] > nearest.0[i] {
                        let behind = nearest.0[i] / parts[3];
                        hidden += weight * (1.0 - behind);
                        weight *= behind;
                    }
                    sum = own * weight + sum;
                }
            }
            if hidden > 0.0 {
                let at =
                    at_finest[0].0[i] as usize + at_finest[1].0[i] as usize * (self.size[0] as usize + 1);
                sum = f32x4::from_slice(simd, &self.pixels[at]) * hidden + sum;
            }
            sum.store_slice(&mut sums[i]);
        }
    }

    /// The mean reciprocals of the view z in pieces of the picture about points, px, for the lanes
    /// that have a bit in `wanted`; 0 for others.
    #[inline(always)]
    pub(super) fn mean_inverse_depth<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        fineness: &Fineness<S>,
        wanted: u32,
    ) -> S::F {
        let (mut sums, mut found) = ([[0.0; 4]; 16], [0.0; 16]);
        self.add(simd, points, fineness, simd.set(1.0), wanted, &mut sums);
        for (found, sum) in found.iter_mut().zip(&sums) {
            *found = sum[3];
        }
        simd.load(&found)
    }

    /// The reciprocals of the view z at points of the picture, px: those of the pixels that hold
    /// them; 0 for lanes without a bit in `wanted`.
    #[inline(always)]
    pub(super) fn inverse_depth<S: Lanes>(&self, simd: S, points: [S::F; 2], wanted: u32) -> S::F {
        let mut within = points;
        for k in 0..2 {
            within[k] = points[k].max(simd.set(0.0)).min(simd.set(self.size[k])).floor();
        }
        let (column, row) = (LaneIndices::new(simd, within[0]), LaneIndices::new(simd, within[1]));
        let stride = self.size[0] as usize + 1;
        let mut found = [0.0; 16];
        for i in SetLanes(wanted) {
            found[i] = self.inverse[row.0[i] as usize * stride + column.0[i] as usize];
        }
        simd.load(&found)
    }
}

/// The place of a level among the pixels of all.
#[derive(Clone, Copy, Debug, Default)]
struct Level {
    first: usize,
    /// Width and height, px, without what is repeated.
    width: usize,
    height: usize,
}

impl Level {
    /// Pixels of a level from which several threads fill it.
    const MIN_SHARED_PX: usize = 1 << 13;

    /// The levels of a picture, one after the other; the smallest are two pixels wide or high.
    fn all(width: usize, height: usize) -> Vec<[Self; MAX_ASPECT_LOG2 + 1]> {
        let (mut levels, mut next) = (Vec::new(), Self { first: 0, width, height });
        loop {
            let mut of = [next; MAX_ASPECT_LOG2 + 1];
            for k in 1..=MAX_ASPECT_LOG2 {
                of[k] = Self { first: of[k - 1].end(), height: of[k - 1].height.div_ceil(2), ..next };
            }
            levels.push(of);
            if next.width.min(next.height) <= 2 {
                return levels;
            }
            next = Self {
                first: of[MAX_ASPECT_LOG2].end(),
                width: next.width.div_ceil(2),
                height: of[1].height,
            };
        }
    }

    /// Length of a row.
    fn stride(&self) -> usize {
        self.width + 1
    }

    /// The first pixel behind it.
    fn end(&self) -> usize {
        self.first + self.stride() * (self.height + 1)
    }

    /// One of its rows, without the last pixel once more.
    fn row<'a>(&self, pixels: &'a [[f32; 4]], y: usize) -> &'a [[f32; 4]] {
        &pixels[self.first + y * self.stride()..][..self.width]
    }

    /// Fills its rows, each by its number and the levels before this one.
    fn fill(&self, pixels: &mut [[f32; 4]], row: impl Fn(usize, &mut [[f32; 4]], &[[f32; 4]]) + Sync) {
        let (before, own) = pixels.split_at_mut(self.first);
        let stride = self.stride();
        let lines = own.par_chunks_mut(stride).take(self.height).enumerate();
        lines.with_min_len(Self::MIN_SHARED_PX / stride + 1).for_each(|(y, line)| {
            row(y, &mut line[..self.width], before);
            line[self.width] = line[self.width - 1];
        });
        own.copy_within((self.height - 1) * stride..self.height * stride, self.height * stride);
    }
}

/// Lanes that sample a mirrored picture.
#[derive(Clone, Copy)]
pub(super) struct ReflectionLanes<S: Lanes> {
    /// Bit mask of these lanes.
    pub(crate) wanted: u32,
    /// Largest reciprocal of the view z of what it may mirror, 1 / scene unit.
    pub(crate) nearest: S::F,
}

/// The extent of pieces of a mirrored picture, px.
pub(super) struct Extent<S: Lanes> {
    pub(crate) wide: S::F,
    pub(crate) tall: S::F,
}

/// A fineness of a mirrored picture for each lane: three levels.
pub(crate) struct Fineness<S: Lanes> {
    /// Pixels of the level in one of the finest, across and down.
    scales: [[S::F; 2]; 3],
    first: [[u32; 16]; 3],
    stride: [[u32; 16]; 3],
    /// Shares of the levels, which sum up to 1.
    shares: [LaneArray; 3],
}

/// The pixels about points.
struct Spots {
    at: [u32; 16],
    right: LaneArray,
    down: LaneArray,
}

impl Spots {
    const NONE: Self = Self { at: [0; 16], right: LaneArray([0.0; 16]), down: LaneArray([0.0; 16]) };

    /// About points of the finest level, px.
    #[inline(always)]
    fn new<S: Lanes>(
        simd: S,
        points: [S::F; 2],
        scales: [S::F; 2],
        first: &[u32; 16],
        stride: &[u32; 16],
    ) -> Self {
        let (mut whole, mut part) = (points, points);
        for k in 0..2 {
            let at = points[k].mul_add(scales[k], simd.set(-0.5)).max(simd.set(0.0));
            whole[k] = at.floor();
            part[k] = at - whole[k];
        }
        let [column, row] = [LaneIndices::new(simd, whole[0]), LaneIndices::new(simd, whole[1])];
        let mut at = [0; 16];
        for i in 0..16 {
            at[i] = first[i].wrapping_add(row.0[i].wrapping_mul(stride[i])).wrapping_add(column.0[i]);
        }
        Self { at, right: LaneArray::new(simd, part[0]), down: LaneArray::new(simd, part[1]) }
    }

    /// Mixes the pixels about point `i`, of a picture with rows of `stride` pixels.
    #[inline(always)]
    fn look<S: Lanes>(&self, simd: S, i: usize, stride: u32, pixels: &[[f32; 4]]) -> f32x4<S> {
        bilinear(simd, pixels, self.at[i] as usize, stride as usize, self.right.0[i], self.down.0[i])
    }
}

/// Binomial weights of the four pixels about one of a picture half as fine: the lamps of a night
/// are so bright that the corners of a box would show.
const BINOMIAL_WEIGHTS: [f32; 4] = [0.125, 0.375, 0.375, 0.125];

/// A row of a picture with half of the rows, from the four about it.
#[inline(always)]
fn half_as_tall<S: Lanes>(simd: S, rows: [&[[f32; 4]]; 4], line: &mut [[f32; 4]]) {
    for (x, pixel) in line.iter_mut().enumerate() {
        let mut sum = f32x4::splat(simd, 0.0);
        for (row, weight) in rows.iter().zip(BINOMIAL_WEIGHTS) {
            sum = f32x4::from_slice(simd, &row[x]) * weight + sum;
        }
        sum.store_slice(pixel);
    }
}

/// A row of a picture with half of the columns.
#[inline(always)]
fn half_as_wide<S: Lanes>(simd: S, row: &[[f32; 4]], line: &mut [[f32; 4]]) {
    for (x, pixel) in line.iter_mut().enumerate() {
        let mut sum = f32x4::splat(simd, 0.0);
        for (k, weight) in BINOMIAL_WEIGHTS.into_iter().enumerate() {
            sum = f32x4::from_slice(simd, &row[near(x, k, row.len())]) * weight + sum;
        }
        sum.store_slice(pixel);
    }
}

/// Pixel `k` of the four about pixel `i` of a picture half as fine, along a side of so many.
#[inline(always)]
fn near(i: usize, k: usize, size: usize) -> usize {
    (2 * i + k).saturating_sub(1).min(size - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    /// The difference of a light and a dark stripe, seen in pieces of this extent, px.
    #[inline(always)]
    fn contrast<S: Lanes>(simd: S, picture: &MirroredPicture, footprint: [f32; 2]) -> f32 {
        let [wide, tall] = footprint;
        let fineness = picture.fineness(simd, Extent { wide: simd.set(wide), tall: simd.set(tall) });
        let mut sums = [[0.0; 4]; 16];
        picture.add(simd, [simd.set(20.0), simd.set(32.0)], &fineness, simd.set(1.0), 1, &mut sums);
        let light = sums[0][0];
        picture.add(simd, [simd.set(28.0), simd.set(32.0)], &fineness, simd.set(1.0), 1, &mut sums);
        light - (sums[0][0] - light)
    }

    #[test]
    fn tall_pieces_keep_what_stands_upright() {
        let light = |i: usize| f32::from(u8::from((i % 64 / 8).is_multiple_of(2)));
        let rgb = (0..64 * 64).flat_map(|i| [light(i); 3]).collect();
        let frame = testing::frame([64, 64], rgb, 1.0);
        for path in SimdPath::available() {
            let picture = MirroredPicture::new(path, &frame, 1.0);
            let of = |extent| dispatch!(path, s => contrast(s, &picture, extent));
            assert!(of([1.0, 1.0]) > 0.99 && of([1.0, 14.0]) > 0.97, "{}", of([1.0, 14.0]));
            assert!(of([16.0, 16.0]) < 0.5, "{}", of([16.0, 16.0]));
        }
    }

    #[test]
    fn a_sky_that_a_training_left_too_bright_is_mirrored_white() {
        let frame = testing::frame([4, 4], [1.0, 1.3, 1.2].repeat(16), 0.0);
        let path = SimdPath::available()[0];
        let [white, bright] = [1.0, f32::INFINITY].map(|white| MirroredPicture::new(path, &frame, white));
        assert!(white.pixels.iter().all(|pixel| pixel[..3].iter().all(|v| (v - 1.0).abs() < 1e-5)));
        assert!(bright.pixels.iter().all(|pixel| pixel[1] > 1.5));
    }
}
