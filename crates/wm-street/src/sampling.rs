//! The place as Gaussians.
//!
//! Surfaces are cut into patches, and each patch into a staggered grid of cells. A cell becomes a
//! flat Gaussian on the surface with standard deviations of two thirds of a cell: neighbours then
//! close the surface, and the picture stays sharp. Cells are of about equal size as seen from the
//! walk along the street: they grow with the distance, with the slant they are seen at, and on
//! faces turned away. A leaf is one Gaussian; thin stems are rods. The sky is a shell of Gaussians
//! far away.
//!
//! Splat `index` is a function of the place's seed, the detail and `index` alone.

use super::paint::Label;
use super::place::Place;
use super::shape::{Shape, Spot};
use super::views::Audience;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;
use wm_scene::splats::Splat;
use wm_scene::{Scene, Splats};

/// Size of a cell per metre of distance, at detail 1.
const CELL_ANGLE_RAD: f64 = 0.0068;
/// The finest cell at detail 1, m.
const MIN_CELL_SIZE_M: f64 = 0.03;
/// Splats that a thread makes at a time: enough to be worth the hand-over, few enough to stop soon.
const CHUNK_SPLATS: usize = 2048;
/// Splats of the sky at detail 1.
const SKY_SPLATS: f64 = 16_000.0;

/// A rectangle of a primitive's surface, cut into `nu` x `nv` cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// The primitive.
    pub(crate) which: u32,
    pub(crate) kind: Cell,
    /// Lowest surface coordinates.
    pub(crate) low: [f32; 2],
    /// Extent in surface coordinates.
    pub(crate) size: [f32; 2],
    pub(crate) nu: u32,
    pub(crate) nv: u32,
    /// Index of its first cell.
    pub(crate) first: usize,
    /// A Gaussian's distance from the primitive's edges is at least this many standard deviations.
    pub(crate) reserve: f32,
}

/// The form of the Gaussian of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cell {
    /// A disc on the surface.
    Disc,
    /// A whole leaf.
    Leaf,
    /// A piece of a stem too thin for discs.
    Rod,
    /// A whole small ball.
    Ball,
}

/// The splats of a place at one detail.
#[derive(Clone, Debug)]
pub struct SplatSampling<'a> {
    pub(super) place: &'a Place,
    patches: Vec<Patch>,
    surface: usize,
    pub(super) sky: usize,
}

impl Place {
    /// Plans the splats; `detail` 1 is the default, 2 halves the spacing (4 times the splats).
    ///
    /// # Panics
    /// If `detail` is not between 0.05 and 10.
    #[must_use]
    pub fn sampling(&self, detail: f64) -> SplatSampling<'_> {
        assert!((0.05..=10.0).contains(&detail), "detail {detail} is not between 0.05 and 10");
        let mut sampling = SplatSampling { place: self, patches: Vec::new(), surface: 0, sky: 0 };
        for which in 0..self.primitives.len() {
            sampling.cover(which, [0.0; 2], [1.0; 2], detail);
        }
        sampling.sky = (SKY_SPLATS * detail.min(1.5).powi(2)).ceil() as usize;
        sampling
    }
}

impl SplatSampling<'_> {
    /// Number of indices; some of them give no splat.
    #[must_use]
    pub fn len(&self) -> usize {
        self.surface + self.sky
    }

    /// Returns true if there is no index at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Splat `index` of [`Self::len`]; `None` where the cell is hidden for good or outside the
    /// shape.
    #[must_use]
    pub fn splat(&self, index: usize) -> Option<Splat> {
        if index >= self.surface {
            return (index < self.len()).then(|| self.sky_splat(index - self.surface));
        }
        let patch = &self.patches[self.patches.partition_point(|patch| patch.first <= index) - 1];
        self.surface_splat(patch, index - patch.first)
    }

    /// The label of splat `index`: its place in [`Label::ALL`], from 1, and 0 in the sky.
    fn label(&self, index: usize, splat: &Splat) -> u16 {
        if index >= self.surface {
            return 0;
        }
        let patch = &self.patches[self.patches.partition_point(|patch| patch.first <= index) - 1];
        let point = DVec3::from_array(splat.mean.map(f64::from));
        let (_, own) = self.place.matter(patch.which as usize, point);
        Label::ALL.iter().position(|label| *label == own).map_or(0, |at| at as u16 + 1)
    }

    /// The place as a scene, with its metadata and its labels ([`Label`]). The splats are made on
    /// all threads of the current rayon pool, and are the same for any number of them.
    ///
    /// `progress` receives the number of indices that were finished since its last call, and
    /// returns false to stop; then the result is `None`.
    #[must_use]
    pub fn scene(&self, progress: &(dyn Fn(usize) -> bool + Sync)) -> Option<Scene> {
        let chunks = (0..self.len().div_ceil(CHUNK_SPLATS)).into_par_iter();
        let parts: Option<Vec<Vec<(Splat, u16)>>> = chunks
            .map(|chunk| {
                let range = chunk * CHUNK_SPLATS..((chunk + 1) * CHUNK_SPLATS).min(self.len());
                let count = range.len();
                let labelled = |index| self.splat(index).map(|splat| (splat, self.label(index, &splat)));
                let part = range.filter_map(labelled).collect();
                progress(count).then_some(part)
            })
            .collect();
        let parts = parts?;
        let mut splats = Splats::with_capacity(parts.iter().map(Vec::len).sum(), 0);
        parts.iter().flatten().for_each(|(splat, _)| splats.push(splat));
        splats.labels = parts.iter().flatten().map(|(_, label)| *label).collect();
        Some(Scene { splats, metadata: self.place.metadata(), ..Scene::default() })
    }

    /// The splats of `range` (cut off at [`Self::len`]), SH degree 0.
    #[must_use]
    pub fn splats_in(&self, range: Range<usize>) -> Splats {
        let range = range.start..range.end.min(self.len());
        let mut splats = Splats::with_capacity(range.len(), 0);
        for splat in range.filter_map(|index| self.splat(index)) {
            splats.push(&splat);
        }
        splats
    }

    /// Adds patches for the part of a primitive from `low` over `size`, halving what is large.
    fn cover(&mut self, which: usize, low: [f64; 2], size: [f64; 2], detail: f64) {
        let primitive = &self.place.primitives[which];
        let material = self.place.material(which);
        let spot = primitive.shape.spot_anywhere(low[0] + 0.5 * size[0], low[1] + 0.5 * size[1]);
        let mut patch = Patch {
            which: which as u32,
            kind: Cell::Disc,
            low: low.map(|v| v as f32),
            size: size.map(|v| v as f32),
            nu: 1,
            nv: 1,
            first: self.surface,
            reserve: 0.0,
        };
        let is_flat = matches!(primitive.shape, Shape::Flat { .. });
        let gap = SplatSpacing::at(&spot, is_flat, detail, &self.place.sights.audience);
        match primitive.shape {
            Shape::Flat { u, v, .. } if material.is_foliage() && u.length().max(v.length()) < 4.0 => {
                patch.kind = Cell::Leaf;
            }
            Shape::Stump { from, to, radii } if TAU * radii[0].max(radii[1]) < 4.0 * gap.size => {
                // Twigs much finer than a cell are lost among the leaves.
                if material.is_bark() && radii[0] < 0.075 * gap.size {
                    return;
                }
                patch.kind = Cell::Rod;
                patch.nv = (from.distance(to) / (1.3 * gap.size).max(2.0 * radii[0])).ceil().max(1.0) as u32;
            }
            Shape::Ellipsoid { radii, .. } if radii.max_element() < 0.8 * gap.size => patch.kind = Cell::Ball,
            _ => {
                let grain = material.grain();
                let (lu, lv) = (spot.along_a.length() * size[0], spot.along_b.length() * size[1]);
                let (gu, gv) = (gap.along(spot.along_a) * grain, gap.along(spot.along_b) * grain);
                let longest = lu.max(lv);
                if longest > (0.3 * gap.distance).max(1.6) && longest > 4.0 * gu.min(gv) {
                    let half = if lu > lv { [0.5 * size[0], size[1]] } else { [size[0], 0.5 * size[1]] };
                    self.cover(which, low, half, detail);
                    let next = [low[0] + size[0] - half[0], low[1] + size[1] - half[1]];
                    return self.cover(which, next, half, detail);
                }
                // Slivers much finer than a cell: their neighbours cover them.
                if lu.min(lv) < 0.16 * gu.min(gv) && gap.distance > 4.0 {
                    return;
                }
                // Bars look the same all along, and much is never seen from the street.
                let bar = if gap.least < 1.0 && lu.min(lv) < 0.9 * gu.min(gv) { 2.4 } else { 1.0 };
                let unseen = lu * lv > 4.0 * gu * gv && !self.place.is_seen(&patch);
                let far = if unseen { 2.4 } else { bar };
                // Coarse cells behind an edge would show around it; grounds go on in their
                // neighbours.
                patch.reserve = if unseen || gap.away {
                    1.7
                } else if spot.normal.z > 0.9 {
                    0.0
                } else {
                    0.9
                };
                let cells = |length: f64, gap: f64| (length / (gap * far)).round().max(1.0) as u32;
                (patch.nu, patch.nv) = (cells(lu, gu), cells(lv, gv));
            }
        }
        self.surface += patch.nu as usize * patch.nv as usize;
        self.patches.push(patch);
    }
}

impl Place {
    /// Returns true if any part of a patch is seen from the walk.
    fn is_seen(&self, patch: &Patch) -> bool {
        let Audience { x, y, z, .. } = self.sights.audience;
        let shape = &self.primitives[patch.which as usize].shape;
        let (low, size) = (patch.low.map(f64::from), patch.size.map(f64::from));
        for (a, b) in [(0.5, 0.5), (0.15, 0.2), (0.85, 0.15), (0.2, 0.85), (0.8, 0.8)] {
            let Some(spot) = shape.spot(low[0] + a * size[0], low[1] + b * size[1]) else { continue };
            let from = spot.point + spot.normal * 0.01;
            for step in 0..9 {
                let side = if step % 2 == 0 { 0.8 } else { -0.8 };
                let eye = DVec3::new(x + side, y.0 + (y.1 - y.0) * f64::from(step) / 8.0, z);
                let away = eye - from;
                if away.dot(spot.normal) > 0.0 && !self.blocked(from, away.normalize(), away.length()) {
                    return true;
                }
            }
        }
        false
    }
}

/// The largest distances between splats at a spot.
struct SplatSpacing {
    /// Cell size across the view, m.
    size: f64,
    /// The distance of the spot from its viewer, m.
    distance: f64,
    /// From the viewer to the spot, length 1.
    direction: DVec3,
    /// Least foreshortening that is made use of.
    least: f64,
    /// True if the whole walk lies behind the surface.
    away: bool,
}

impl SplatSpacing {
    /// `flat` surfaces are seen under one angle; round ones under all.
    fn at(spot: &Spot, flat: bool, detail: f64, audience: &Audience) -> Self {
        let eye = audience.viewer(spot.point);
        let away = spot.point - eye;
        let distance = away.length().max(2.5);
        let mut size = CELL_ANGLE_RAD * distance;
        let ends = [audience.y.0, audience.y.1].map(|y| DVec3::new(audience.x, y, audience.z));
        let away_from_all = flat && ends.iter().all(|end| spot.normal.dot(*end - spot.point) < 0.0);
        if away_from_all {
            size *= 1.8;
        }
        if audience.lead > 0.0 && spot.point.y < audience.y.0 - 4.0 {
            size *= 1.7;
        }
        let least = if !flat {
            1.0
        } else if distance > 120.0 {
            0.05
        } else {
            0.42
        };
        Self {
            size: size.max(MIN_CELL_SIZE_M) / detail,
            distance,
            direction: away / away.length().max(1e-9),
            least,
            away: away_from_all,
        }
    }

    /// Cell size along a tangent: longer where it is seen slanted.
    fn along(&self, tangent: DVec3) -> f64 {
        let seen = tangent.normalize_or_zero().reject_from(self.direction).length();
        self.size / seen.clamp(self.least, 1.0).powf(0.85)
    }
}
