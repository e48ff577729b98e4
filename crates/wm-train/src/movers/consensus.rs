//! Judges each pixel of a photo: other photos that see the same surface show its colour, or
//! another.

use super::view::{MoverView, SCALE_COUNT};
use crate::photo_warp::PhotoWarp;
use rayon::prelude::*;
use wm_scene::Camera;

/// Most other photos that each is compared with.
const MAX_COMPARED_PHOTOS: usize = 12;
/// Fewest other photos that must see the surface.
const MIN_SEEING_PHOTOS: usize = 2;
/// Largest ratio of photos that see through the surface to those that see it.
const MAX_THROUGH_RATIO: usize = 2;
/// Largest relative difference of the inverse depths of one surface: filled depth is no better.
const DEPTH_TOLERANCE: f32 = 0.08;
/// Tolerated parallax error of depth, px of the search.
const PARALLAX_TOLERANCE_PX: f32 = 1.0;
/// Largest difference of the scales at which photos are compared, halvings.
const MAX_SCALE_HALVINGS: f32 = 2.3;
/// Side of the cells in which depths of other photos are gathered, px.
const CELL_PX: usize = 2;
/// Relative width of the depths of one surface in a cell.
const CLUSTER_TOLERANCE: f32 = 0.06;
/// Share of the pixels about one that stereo must know for it to stand still.
const MIN_MATCHED_SHARE: f32 = 0.04;
/// The weight of the other photos' spread.
const SPREAD_WEIGHT: f32 = 0.7;
/// Difference of colour beyond texture and spread up to which a pixel agrees.
const MAX_AGREEING_DIFFERENCE: f32 = 0.06;
/// Difference and spread up to which a pixel certainly agrees.
const MAX_STILL_DIFFERENCES: [f32; 2] = [0.01, 0.03];

/// The verdict on a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum PixelVerdict {
    /// Too few others see the surface.
    Unknown,
    /// The others show about what the photo shows, which a mover of the same colour would too.
    Agrees,
    /// The others show what the photo shows.
    Still,
    /// The others show something else: the photo is brighter by this much, or darker if negative.
    Differs(f32),
}

/// Another photo that a photo is compared with.
struct ComparedPhoto {
    index: usize,
    there: PhotoWarp,
    back: PhotoWarp,
    /// Base-2 logarithm of the ratio of the other focal length to the photo's.
    focal: f32,
    /// A change of inverse depth that is a parallax of one pixel.
    pixel: f32,
}

impl ComparedPhoto {
    fn new(index: usize, own: &Camera, theirs: &Camera) -> Self {
        let baseline = own.center().distance(theirs.center()).max(1e-9);
        Self {
            index,
            there: PhotoWarp::new(own, theirs),
            back: PhotoWarp::new(theirs, own),
            focal: (theirs.fx / own.fx).log2() as f32,
            pixel: (1.0 / (own.fx.max(own.fy) * baseline)) as f32,
        }
    }

    /// Returns by how many doublings a surface is larger in the other photo.
    #[inline]
    fn scale(&self, disparity: f32, theirs: f32) -> f32 {
        if disparity > 0.0 { (theirs / disparity).log2() + self.focal } else { self.focal }
    }
}

/// The evidence of other photos about a pixel at one depth.
#[derive(Clone, Copy, Debug, Default)]
struct Opinion {
    /// The number of photos that see the surface, and that see through it.
    seen: usize,
    through: usize,
    /// Median difference beyond texture, and spread of the others.
    off: f32,
    spread: f32,
    /// The sum of the signed differences; negative where the photo is darker.
    signed: f32,
}

/// Judges the pixels of photos.
pub(crate) struct Judge<'a> {
    views: &'a [MoverView],
    others: Vec<Vec<ComparedPhoto>>,
    /// The inverse depths in the cells of each photo; see [`gathered`].
    cells: Vec<Vec<[f32; 2]>>,
}

impl<'a> Judge<'a> {
    /// Chooses the photos with which each is compared.
    pub(crate) fn new(views: &'a [MoverView]) -> Self {
        let others: Vec<Vec<ComparedPhoto>> =
            (0..views.len()).into_par_iter().map(|index| choose(views, index)).collect();
        let cells =
            others.par_iter().zip(views).map(|(others, view)| gathered(views, view, others)).collect();
        Self { views, others, cells }
    }

    /// Returns the verdicts on the pixels of a photo, `[H, W]`. Pixels in `masks` (one per photo,
    /// or empty) are no evidence about other photos.
    pub(crate) fn photo(&self, index: usize, masks: &[Vec<bool>]) -> Vec<PixelVerdict> {
        let view = &self.views[index];
        let (width, height) = view.size();
        let columns = width.div_ceil(CELL_PX);
        let verdict = |pixel: usize| {
            if view.matched[pixel] > MIN_MATCHED_SHARE {
                return PixelVerdict::Still;
            }
            let (x, y) = (pixel % width, pixel / width);
            let [first, second] = self.cells[index][y / CELL_PX * columns + x / CELL_PX];
            self.pixel(index, (x, y), [view.disparity[pixel], first, second], masks)
        };
        (0..width * height).map(verdict).collect()
    }

    /// Returns the verdict on a pixel, at the one of `depths` (inverse, NaN for none) at which
    /// most others see a surface.
    fn pixel(&self, index: usize, at: (usize, usize), depths: [f32; 3], masks: &[Vec<bool>]) -> PixelVerdict {
        let mut best = Opinion::default();
        for disparity in depths.into_iter().filter(|disparity| !disparity.is_nan()) {
            let opinion = self.opinion(index, at.0, at.1, disparity, masks);
            if opinion.seen > best.seen && opinion.through <= MAX_THROUGH_RATIO * opinion.seen {
                best = opinion;
            }
        }
        let Opinion { seen, off, spread, signed, .. } = best;
        match off - SPREAD_WEIGHT * spread {
            _ if seen < MIN_SEEING_PHOTOS => PixelVerdict::Unknown,
            beyond if beyond > MAX_AGREEING_DIFFERENCE => PixelVerdict::Differs(beyond.copysign(signed)),
            _ if off <= MAX_STILL_DIFFERENCES[0] && spread <= MAX_STILL_DIFFERENCES[1] => PixelVerdict::Still,
            _ => PixelVerdict::Agrees,
        }
    }

    /// Collects the evidence of the other photos about a pixel at an inverse depth.
    fn opinion(
        &self,
        index: usize,
        column: usize,
        row: usize,
        disparity: f32,
        masks: &[Vec<bool>],
    ) -> Opinion {
        let view = &self.views[index];
        let (x, y) = (column as f32 + 0.5, row as f32 + 0.5);
        let mut opinion = Opinion::default();
        let mut offs = [0.0f32; MAX_COMPARED_PHOTOS];
        let mut colors = [[0.0f32; 3]; MAX_COMPARED_PHOTOS];
        for other in &self.others[index] {
            let there = &self.views[other.index];
            let Some((u, v, theirs)) = inside(there, other.there.point(x, y, disparity)) else { continue };
            let pixel = v as usize * there.size().0 + u as usize;
            let known = there.disparity[pixel];
            let tolerance = (DEPTH_TOLERANCE * theirs.max(known)).max(PARALLAX_TOLERANCE_PX * other.pixel);
            if known < theirs - tolerance {
                opinion.through += 1;
            }
            let is_seen = (known - theirs).abs() <= tolerance;
            let scale = other.scale(disparity, theirs);
            let says_nothing = masks[other.index].get(pixel) == Some(&true);
            if !is_seen || says_nothing || scale.abs() > MAX_SCALE_HALVINGS {
                continue;
            }
            let halvings = (scale.abs().round() as usize).min(SCALE_COUNT - 1);
            let (mine, other_scale) = if scale < 0.0 { (halvings, 0) } else { (0, halvings) };
            let color = view.scales[mine].mean[view.scales[mine].pixel(x, y, mine)];
            let scale = &there.scales[other_scale];
            let place = scale.pixel(u, v, other_scale);
            let [low, high] = scale.range[place];
            let off = |c: usize| (low[c] - color[c]).max(color[c] - high[c]).max(0.0);
            offs[opinion.seen] = off(0).max(off(1)).max(off(2));
            opinion.signed += (0..3).map(|c| if color[c] > high[c] { off(c) } else { -off(c) }).sum::<f32>();
            colors[opinion.seen] = scale.mean[place];
            opinion.seen += 1;
        }
        let seen = opinion.seen;
        if seen >= MIN_SEEING_PHOTOS {
            opinion.off = median(&mut offs[..seen]);
            opinion.spread = spread(&colors[..seen]);
        }
        opinion
    }
}

/// Returns the point if it is inside a photo.
#[inline]
fn inside(view: &MoverView, point: Option<(f32, f32, f32)>) -> Option<(f32, f32, f32)> {
    let (width, height) = view.size();
    point.filter(|(u, v, _)| *u >= 1.0 && *v >= 1.0 && *u < width as f32 - 1.0 && *v < height as f32 - 1.0)
}

/// Returns two inverse depths for each cell of a photo, those on which most other photos agree;
/// NaN where there are none.
fn gathered(views: &[MoverView], view: &MoverView, others: &[ComparedPhoto]) -> Vec<[f32; 2]> {
    let (width, height) = view.size();
    let columns = width.div_ceil(CELL_PX);
    let mut found: Vec<(u32, f32, u32)> = Vec::new();
    for (number, other) in others.iter().enumerate() {
        let there = &views[other.index];
        let wide = there.size().0;
        for (pixel, disparity) in there.disparity.iter().enumerate().filter(|(_, known)| !known.is_nan()) {
            let (x, y) = ((pixel % wide) as f32 + 0.5, (pixel / wide) as f32 + 0.5);
            let Some((u, v, own)) = other.back.point(x, y, *disparity) else { continue };
            if u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32 {
                let cell = v as usize / CELL_PX * columns + u as usize / CELL_PX;
                found.push((cell as u32, own, number as u32));
            }
        }
    }
    found.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut cells = vec![[f32::NAN; 2]; columns * height.div_ceil(CELL_PX)];
    for cell in found.chunk_by(|a, b| a.0 == b.0) {
        cells[cell[0].0 as usize] = clusters(cell);
    }
    cells
}

/// Returns the two inverse depths on which most of the others agree; entries are sorted by inverse
/// depth.
fn clusters(cell: &[(u32, f32, u32)]) -> [f32; 2] {
    let mut best: [(u32, f32); 2] = [(0, f32::NAN); 2];
    let width = |disparity: f32| CLUSTER_TOLERANCE * disparity + 1e-9;
    let mut last = 0;
    for first in 0..cell.len() {
        while last < cell.len() && cell[last].1 - cell[first].1 <= width(cell[first].1) {
            last += 1;
        }
        let who = cell[first..last].iter().fold(0u32, |who, entry| who | 1 << entry.2).count_ones();
        let middle = cell[first + (last - first) / 2].1;
        let is_first = (best[0].1 - middle).abs() <= width(middle.max(best[0].1));
        if who > best[0].0 {
            if !is_first {
                best[1] = best[0];
            }
            best[0] = (who, middle);
        } else if who > best[1].0 && !is_first {
            best[1] = (who, middle);
        }
    }
    best.map(|(_, disparity)| disparity)
}

fn median(values: &mut [f32]) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    values[values.len() / 2]
}

/// Returns the median absolute deviation of the channel in which it is largest.
fn spread(colors: &[[f32; 3]]) -> f32 {
    let mut values = [0.0f32; MAX_COMPARED_PHOTOS];
    let values = &mut values[..colors.len()];
    let mut of = |c: usize| {
        values.iter_mut().zip(colors).for_each(|(value, color)| *value = color[c]);
        let middle = median(values);
        values.iter_mut().for_each(|value| *value = (*value - middle).abs());
        median(values)
    };
    of(0).max(of(1)).max(of(2))
}

/// Returns the photos that share most of the view of a photo, at a comparable scale.
fn choose(views: &[MoverView], index: usize) -> Vec<ComparedPhoto> {
    const GRID_SIDE: usize = 16;
    let view = &views[index];
    let (width, height) = view.size();
    let middle = |cell: usize, pixels: usize| (2 * cell + 1) * pixels / (2 * GRID_SIDE);
    let mut scored = Vec::new();
    for to in (0..views.len()).filter(|to| *to != index) {
        let other = ComparedPhoto::new(to, &view.camera, &views[to].camera);
        let is_seen = |cell: &usize| {
            let (x, y) = (middle(cell % GRID_SIDE, width), middle(cell / GRID_SIDE, height));
            let disparity = view.disparity[y * width + x];
            let point = other.there.point(x as f32 + 0.5, y as f32 + 0.5, disparity);
            // Comparisons with NaN are false.
            inside(&views[to], point)
                .is_some_and(|(_, _, theirs)| other.scale(disparity, theirs).abs() <= MAX_SCALE_HALVINGS)
        };
        let score = (0..GRID_SIDE * GRID_SIDE).filter(is_seen).count();
        if score > 0 {
            scored.push((score, other));
        }
    }
    let nearest = |other: &ComparedPhoto| other.index.abs_diff(index);
    scored.sort_by(|(a, one), (b, two)| {
        b.cmp(a).then(nearest(one).cmp(&nearest(two))).then(one.index.cmp(&two.index))
    });
    scored.truncate(MAX_COMPARED_PHOTOS);
    scored.into_iter().map(|(_, other)| other).collect()
}
