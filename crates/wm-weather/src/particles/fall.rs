//! Precipitation at one instant in front of one camera.
//!
//! Photometry: a drop is a lens over 165 degrees, so that it shows the mean of what is around it,
//! almost whatever lies behind (Garg and Nayar 2007); a flake scatters it. That radiance belongs to
//! the site and the time, never to the frame. A drop hides a pixel for a part of the exposure: its
//! Gaussian is as long as its way in it (`V T`, as a standard deviation over sqrt 12), and covers
//! its area in all.

use super::field::{Cells, Points, ViewFrustum};
use super::precipitation::{MIN_DROP_WIDTH_PX, Precipitation};
use super::random::{RandomSequence, uniform};
use super::residual::{FADE_DISTANCE_SHARES, MIN_DISTANCE_M};
use super::spectrum::ParticleShape;
use super::sway::{self, Sway};
use crate::level::{from_level, level_axes, to_level};
use crate::light::LampsOn;
use crate::optics::{AirView, Atmosphere, Site};
use crate::shelter::Shelter;
use fearless_simd::{SimdBase, SimdFloat, SimdMask};
use glam::Vec3;
use std::f64::consts::{PI, TAU};
use std::ops::Range;
use std::sync::Arc;
use wm_render::dispatch;
use wm_render::hooks::{GROUP, Particle, ParticleGroup, ParticleView, Particles};
use wm_render::simd::{Lanes, SimdPath};

/// Asymmetry of the light that drops and flakes scatter.
pub(crate) const DROP_ASYMMETRY: f32 = 0.8;
const FLAKE_ASYMMETRY: f32 = 0.2;
/// Width below which flakes are drawn fewer and larger.
const MERGING_WIDTH_PX: f64 = 1.25;
/// Width from which a flake shows its three arms.
const MIN_ARMED_WIDTH_PX: f64 = 4.0;
/// Width of thresholds over which drops fade, as a share.
const THRESHOLD_WIDTH_SHARE: f64 = 0.1;
/// Standard deviation of a disc and of a line of length 1.
pub(crate) const DISC_SIGMA_RATIO: f64 = 0.25;
pub(crate) const LINE_SIGMA_RATIO: f64 = 0.288_675_134_594_812_9;
/// Thickness of a flake's arm, as a share of its length.
const ARM_THICKNESS_RATIO: f64 = 0.1;
/// Work is cut in parts of about so many slices.
const PART_SLICE_COUNT: i64 = 6;

/// Precipitation in front of a camera.
pub(crate) struct FallingParticles<'a> {
    precipitation: &'a Precipitation,
    around: Surroundings<'a>,
    /// Level axes: two level, and up.
    axes: [[f64; 3]; 3],
    metres_per_unit: f64,
    /// The camera's velocity, m/s along the level axes and up.
    camera: [f64; 3],
    radiance: [f32; 3],
    /// Distance up to which each class is handed over, m; `None` to go by the view's pixels.
    ranges: Option<Vec<f64>>,
}

/// The wind at an instant: how far the air has come since time 0, and how fast it goes, m and m/s
/// along level axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct WindSample {
    /// m.
    pub(crate) drift: [f64; 2],
    /// m/s.
    pub(crate) wind: [f64; 2],
    /// m/s, without gusts.
    pub(crate) mean: [f64; 2],
}

/// The air in which particles move, and the eye that sees them.
#[derive(Clone)]
pub(crate) struct Surroundings<'a> {
    pub(crate) site: &'a Site,
    pub(crate) air: Arc<Atmosphere>,
    pub(crate) shelter: Option<&'a Shelter>,
    pub(crate) lamps: Option<&'a LampsOn<'a>>,
    pub(crate) wind: WindSample,
    /// Velocity of the camera, m/s, world axes.
    pub(crate) velocity: [f64; 3],
    /// The instant, s.
    pub(crate) time: f64,
}

impl<'a> FallingParticles<'a> {
    pub(crate) fn new(precipitation: &'a Precipitation, around: Surroundings<'a>) -> Self {
        let axes = level_axes(around.site.up);
        Self {
            precipitation,
            metres_per_unit: around.site.metres_per_unit,
            camera: to_level(&axes, around.velocity),
            around,
            axes,
            radiance: precipitation.radiance(),
            ranges: None,
        }
    }

    /// Draws for a sensor that takes no picture: all particles of each class within `ranges` (m)
    /// are handed over, and none stands for several, whatever the view's pixels.
    pub(crate) fn within(mut self, ranges: &[f64]) -> Self {
        self.ranges = Some(ranges.iter().map(|range| range / FADE_DISTANCE_SHARES[0]).collect());
        self
    }

    /// The cells of a tier of a class.
    fn cells_of(&self, class: usize, tier: usize) -> Cells {
        let own = (class as u64) << 40 ^ (tier as u64) << 52;
        let mut draws = RandomSequence::new(self.precipitation.look.seed ^ self.precipitation.kind.key ^ own);
        Cells::new(
            draws.bits() as u32,
            self.precipitation.reference[class],
            self.precipitation.kind.tier(tier),
        )
    }

    /// Returns the density of a class over distance.
    fn density(&self, class: usize, view: &ParticleView) -> Density {
        let this = self.precipitation;
        let share = this.numbers[class] / this.reference[class];
        if let Some(ranges) = &self.ranges {
            return Density { share, range: ranges[class], merge: f64::INFINITY };
        }
        let range = this.range(&this.classes[class], f64::from(view.pixels()));
        let merge = match this.kind.shape {
            ParticleShape::Ball => f64::INFINITY,
            ParticleShape::Flake => range * MIN_DROP_WIDTH_PX / MERGING_WIDTH_PX,
        };
        Density { share, range, merge }
    }

    /// Returns the region in which particles of a class may be visible up to a range, m.
    fn cone(&self, class: usize, view: &ParticleView, range: f64) -> ViewFrustum {
        let kind = &self.precipitation.classes[class];
        let level = to_level(&self.axes, view.center.map(|v| v * self.metres_per_unit));
        let [x, y] = self.around.wind.drift;
        let come = [x, y, -kind.fall_speed * self.around.time];
        let speed = self.relative(kind.fall_speed).iter().map(|v| v * v).sum::<f64>().sqrt();
        let sway = match self.precipitation.kind.shape {
            ParticleShape::Ball => 0.0,
            ParticleShape::Flake => sway::farthest(),
        };
        // As far as its Gaussian reaches: three standard deviations of a streak are less than its
        // length.
        let margin =
            speed * self.precipitation.look.exposure + 3.0 * kind.width * self.precipitation.look.size + sway;
        ViewFrustum {
            planes: ViewFrustum::planes(view, &self.axes),
            center: std::array::from_fn(|k| level[k] - come[k]),
            range,
            margin,
        }
    }

    /// Velocity of what falls at `speed` as the camera sees it, level axes, m/s.
    fn relative(&self, speed: f64) -> [f64; 3] {
        let [x, y] = self.around.wind.wind;
        [x - self.camera[0], y - self.camera[1], -speed - self.camera[2]]
    }
}

impl Particles for FallingParticles<'_> {
    fn parts(&self, view: &ParticleView) -> Vec<[i32; 4]> {
        let mut parts = Vec::new();
        self.each_tier(view, |class, tier, cone, edge| {
            // From the first slice, so that numbers stay small far from the origin.
            let slices = cone.slices(edge);
            let count = slices.end - slices.start;
            let mut first = 0;
            while first < count {
                let last = (first + PART_SLICE_COUNT).min(count);
                parts.push([class as i32, tier as i32, first as i32, last as i32]);
                first += PART_SLICE_COUNT;
            }
        });
        parts
    }

    fn cells(&self, view: &ParticleView) -> f64 {
        let mut cells = 0.0;
        self.each_tier(view, |_, _, cone, edge| cells += cone.cells(edge));
        cells
    }

    fn gather(
        &self,
        path: SimdPath,
        view: &ParticleView,
        part: [i32; 4],
        take: &mut dyn FnMut(&ParticleGroup),
    ) {
        dispatch!(path, s => self.gather_in(s, view, part, take));
    }
}

impl FallingParticles<'_> {
    /// Calls `visit` with each class and tier of which particles may be visible, with their region
    /// and the edge of its cells, m.
    fn each_tier(&self, view: &ParticleView, mut visit: impl FnMut(usize, usize, &ViewFrustum, f64)) {
        for class in 0..self.precipitation.classes.len() {
            if self.precipitation.numbers[class] <= 0.0 {
                continue;
            }
            let density = self.density(class, view);
            for tier in 0.. {
                let cells = self.cells_of(class, tier);
                let Some(range) = density.reach(cells.thresholds[0]) else { break };
                visit(class, tier, &self.cone(class, view, range), cells.edge);
            }
        }
    }

    #[inline(always)]
    fn gather_in<S: Lanes>(
        &self,
        simd: S,
        view: &ParticleView,
        part: [i32; 4],
        take: &mut dyn FnMut(&ParticleGroup),
    ) {
        let [class, tier, first, last] = part;
        let (class, tier) = (class as usize, tier as usize);
        let (cells, density) = (self.cells_of(class, tier), self.density(class, view));
        let Some(range) = density.reach(cells.thresholds[0]) else { return };
        let cone = self.cone(class, view, range);
        let mut brush = Brush::new(self, view, class, density, &cone, take);
        let begin = cone.slices(cells.edge).start;
        let half = 0.5 * cells.edge;
        let mut visited = Vec::new();
        for slice in begin + i64::from(first)..begin + i64::from(last) {
            visited.clear();
            cone.each_cell(cells.edge, slice, |cell, corner| visited.push((cell, corner)));
            for (cell, corner) in &visited {
                let middle = corner.map(|v| v + half);
                let off = middle.iter().map(|v| v * v).sum::<f64>().sqrt() - half * 3f64.sqrt();
                let most =
                    brush.density.max_threshold((off - cone.margin).max(0.0)).min(cells.thresholds[1] as f32);
                let mut points = cells.begin();
                // Where it stands still, so that it goes by nothing but itself.
                let still = std::array::from_fn(|k| corner[k] + cone.center[k]);
                let phases = brush.sway.as_ref().map(|sway| sway.phases(&still));
                while points.last < most {
                    cells.next(simd, *cell, &mut points);
                    brush.add(simd, &cells, *cell, *corner, phases.as_ref(), &points);
                }
            }
        }
        brush.finish(simd);
    }
}

/// The density of drawn particles of a class over distance, as thresholds.
struct Density {
    /// Threshold up to which particles are drawn nearby.
    share: f64,
    /// Farthest distance, m.
    range: f64,
    /// Distance from which fewer particles stand for all, m.
    merge: f64,
}

impl Density {
    /// Returns the farthest distance, m, at which particles above a threshold are drawn; `None` if
    /// none are.
    fn reach(&self, threshold: f64) -> Option<f64> {
        let most = self.share * (1.0 + 0.5 * THRESHOLD_WIDTH_SHARE);
        let range = FADE_DISTANCE_SHARES[1] * self.range;
        if threshold <= 0.0 {
            return Some(range);
        }
        (most > threshold).then(|| range.min(self.merge * (most / threshold).sqrt()))
    }

    /// The greatest threshold of those farther than `metres`.
    fn max_threshold(&self, metres: f64) -> f32 {
        let keep = (self.merge / metres.max(1e-9)).powi(2).min(1.0);
        let fade = ((FADE_DISTANCE_SHARES[1] - metres / self.range)
            / (FADE_DISTANCE_SHARES[1] - FADE_DISTANCE_SHARES[0]))
            .clamp(0.0, 1.0);
        (self.share * keep * fade * (1.0 + 0.5 * THRESHOLD_WIDTH_SHARE)) as f32
    }

    /// Share of those like one at `metres` that are drawn, and how much of one of that threshold is
    /// there.
    #[inline(always)]
    fn at<S: Lanes>(&self, simd: S, metres: S::F, threshold: S::F) -> [S::F; 2] {
        let ratio = simd.set(self.merge as f32) / metres;
        let keep = (ratio * ratio).min(simd.set(1.0));
        let slope = 1.0 / (FADE_DISTANCE_SHARES[1] - FADE_DISTANCE_SHARES[0]);
        let fade = metres.mul_add(
            simd.set((-slope / self.range) as f32),
            simd.set((slope * FADE_DISTANCE_SHARES[1]) as f32),
        );
        let wanted = keep * fade.max(simd.set(0.0)).min(simd.set(1.0)) * self.share as f32;
        // Of the last ones below `wanted` a part, that grows with it.
        let there = wanted.mul_add(simd.set(1.0 + 0.5 * THRESHOLD_WIDTH_SHARE as f32), -threshold)
            / (wanted * THRESHOLD_WIDTH_SHARE as f32);
        [keep, there.min(simd.set(1.0))]
    }
}

/// Drops on their way into the picture: sixteen of them, m along the level axes from the camera.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Batch {
    at: [[f32; GROUP]; 3],
    /// Velocity that the camera sees, m/s.
    velocity: [[f32; GROUP]; 3],
    /// Widths of the drops, m.
    width: [f32; GROUP],
    /// m.
    distance: [f32; GROUP],
    /// Fade-in, 0-1.
    there: [f32; GROUP],
    /// Reciprocal of the number of drops that it stands for.
    keep: [f32; GROUP],
    /// A number of its own.
    own: [u32; GROUP],
}

/// Least distance of points from planes through the origin, and what is added to it.
#[inline(always)]
fn inside_by<S: Lanes>(simd: S, planes: &[[f32; 3]; 5], at: &[S::F; 3], margin: S::F) -> S::F {
    let mut least = simd.set(f32::INFINITY);
    for [x, y, z] in planes {
        let along = at[2].mul_add(simd.set(*z), margin);
        let along = at[0].mul_add(simd.set(*x), at[1].mul_add(simd.set(*y), along));
        least = least.min(along);
    }
    least
}

#[inline(always)]
fn squared<S: Lanes>(v: &[S::F; 3]) -> S::F {
    v[0].mul_add(v[0], v[1].mul_add(v[1], v[2] * v[2]))
}

/// The product of `row` and the vectors from lane `first` on.
#[inline(always)]
fn turned<S: Lanes>(simd: S, row: [f32; 3], vectors: &[[f32; GROUP]; 3], first: usize) -> S::F {
    let mut sum = simd.load(&vectors[0][first..]) * row[0];
    for k in 1..3 {
        sum = simd.load(&vectors[k][first..]).mul_add(simd.set(row[k]), sum);
    }
    sum
}

/// Draws the drops of one class.
struct Brush<'a> {
    fall: &'a FallingParticles<'a>,
    view: &'a ParticleView,
    air: AirView<'a>,
    class: usize,
    density: Density,
    /// Planes of the cone, and how far outside of them points may lie before they sway, m.
    planes: [[f32; 3]; 5],
    margin: f32,
    sway: Option<Sway>,
    /// Velocity of all of them as the camera sees it, level axes, m/s.
    relative: [f32; 3],
    /// World axes, scene units, of level ones, m.
    units: [[f32; 3]; 3],
    batch: Batch,
    count: usize,
    arms: Vec<Particle>,
    take: &'a mut dyn FnMut(&ParticleGroup),
}

impl<'a> Brush<'a> {
    fn new(
        fall: &'a FallingParticles<'a>,
        view: &'a ParticleView,
        class: usize,
        density: Density,
        cone: &ViewFrustum,
        take: &'a mut dyn FnMut(&ParticleGroup),
    ) -> Self {
        let this = fall.precipitation;
        let zero = [0.0; GROUP];
        let batch = Batch {
            at: [zero; 3],
            velocity: [zero; 3],
            width: zero,
            distance: [1.0; GROUP],
            there: zero,
            keep: [1.0; GROUP],
            own: [0; GROUP],
        };
        Self {
            density,
            planes: cone.planes.map(|plane| plane.map(|v| v as f32)),
            margin: cone.margin as f32,
            air: fall.around.air.seen_from(view.center.map(|v| v as f32)),
            sway: (this.kind.shape == ParticleShape::Flake).then(|| Sway::new(fall.around.time)),
            relative: fall.relative(this.classes[class].fall_speed).map(|v| v as f32),
            units: fall.axes.map(|axis| axis.map(|v| (v / fall.metres_per_unit) as f32)),
            fall,
            view,
            class,
            batch,
            count: 0,
            arms: Vec::new(),
            take,
        }
    }

    /// Adds those of sixteen points of a cube that are there and may be in the picture.
    #[inline(always)]
    fn add<S: Lanes>(
        &mut self,
        simd: S,
        cells: &Cells,
        cell: [i64; 3],
        corner: [f64; 3],
        phases: Option<&sway::SwayPhases>,
        points: &Points,
    ) {
        let edge = cells.edge as f32;
        let look = &self.fall.precipitation.look;
        for first in (0..GROUP).step_by(S::N) {
            let threshold = simd.load(&points.threshold[first..]);
            let (mut at, mut within) = ([simd.set(0.0); 3], [simd.set(0.0); 3]);
            for k in 0..3 {
                within[k] = simd.load(&points.place[k][first..]) * edge;
                at[k] = within[k] + corner[k] as f32;
            }
            let zero = simd.set(0.0);
            let near = inside_by(simd, &self.planes, &at, simd.set(self.margin)).simd_gt(zero)
                & threshold.simd_lt(simd.set(cells.thresholds[1] as f32));
            if !near.any_true() {
                continue;
            }
            let own = cells.own(simd, cell, points, first, 1);
            let width = self.fall.precipitation.classes[self.class].seen_by(simd, uniform(simd, own[0]));
            let mut velocity = self.relative.map(|v| simd.set(v));
            if let (Some(sway), Some(phases)) = (&self.sway, phases) {
                sway.apply(simd, phases, &within, [own[1], own[2]], &mut at, &mut velocity);
            }
            let distance = squared::<S>(&at).sqrt();
            let [keep, there] = self.density.at(simd, distance, threshold);
            // As far as its Gaussian reaches: three standard deviations of a streak are less than
            // its length.
            let spread = width * look.size as f32 / keep.sqrt();
            let margin = squared::<S>(&velocity).sqrt().mul_add(simd.set(look.exposure as f32), spread);
            let seen = near
                & there.simd_gt(zero)
                & distance.simd_gt(simd.set(MIN_DISTANCE_M as f32))
                & inside_by(simd, &self.planes, &at, margin).simd_gt(zero);
            let mut bits = seen.to_bitmask();
            while bits != 0 {
                let lane = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let (batch, to) = (&mut self.batch, self.count);
                for k in 0..3 {
                    batch.at[k][to] = at[k][lane];
                    batch.velocity[k][to] = velocity[k][lane];
                }
                batch.width[to] = width[lane];
                batch.distance[to] = distance[lane];
                batch.there[to] = there[lane];
                batch.keep[to] = keep[lane];
                batch.own[to] = own[3][lane];
                self.count += 1;
                if self.count == GROUP {
                    self.flush(simd);
                }
            }
        }
    }

    /// Hands over what the batch holds.
    #[inline(always)]
    fn flush<S: Lanes>(&mut self, simd: S) {
        let (this, view) = (self.fall.precipitation, self.view);
        let look = &this.look;
        let per_metre = 1.0 / self.fall.metres_per_unit;
        let mut group = ParticleGroup::default();
        for first in (0..self.count).step_by(S::N) {
            let lanes = first..first + S::N;
            let columns = [0, 1, 2].map(|k| self.units.map(|axis| axis[k]));
            let distance = simd.load(&self.batch.distance[first..]);
            let mut direction = [simd.set(0.0); 3];
            for k in 0..3 {
                let offset = turned(simd, columns[k], &self.batch.at, first);
                offset.store_slice(&mut group.offset[k][lanes.clone()]);
                let streak = turned(simd, columns[k], &self.batch.velocity, first)
                    * (look.exposure * LINE_SIGMA_RATIO) as f32;
                streak.store_slice(&mut group.reach[0][k][lanes.clone()]);
                direction[k] = offset / (distance * per_metre as f32);
            }
            let keep = simd.load(&self.batch.keep[first..]);
            let width = simd.load(&self.batch.width[first..]) * (look.size * per_metre) as f32;
            // Those that stand for several are as wide as all of them together.
            let sigma = width * DISC_SIGMA_RATIO as f32 / keep.sqrt();
            sigma.store_slice(&mut group.sigma[lanes.clone()]);
            let there = simd.load(&self.batch.there[first..]);
            let area = width * width * there / keep * (PI / 4.0 * look.opacity) as f32;
            area.store_slice(&mut group.area[lanes.clone()]);
            let mut radiance = self.fall.radiance.map(|v| simd.set(v));
            if let Some(lamps) = self.fall.around.lamps {
                let [x, y, z] = self.lit_by(lamps, &group, lanes.clone());
                for (k, light) in [x, y, z].iter().enumerate() {
                    radiance[k] += simd.load(&light[first..]);
                }
            }
            let seen = self.air.through(simd, distance, &direction, radiance);
            for k in 0..3 {
                seen[k].store_slice(&mut group.rgb[k][lanes.clone()]);
            }
        }
        group.area[self.count..].fill(0.0);
        if let Some(shelter) = self.fall.around.shelter {
            for lane in 0..self.count {
                let at = group.offset.map(|axis| axis[lane]);
                if !shelter.is_exposed(std::array::from_fn(|k| view.center[k] as f32 + at[k])) {
                    group.area[lane] = 0.0;
                }
            }
        }
        if this.kind.shape == ParticleShape::Flake {
            for lane in 0..self.count {
                let width = f64::from(self.batch.width[lane]) * look.size;
                if width * f64::from(view.pixels())
                    >= MIN_ARMED_WIDTH_PX * f64::from(self.batch.distance[lane])
                {
                    self.add_arms(&mut group, lane, width * per_metre);
                }
            }
        }
        (self.take)(&group);
        self.count = 0;
    }

    /// Radiance of particles by lamps, linear RGB, one array per channel.
    fn lit_by(&self, lamps: &LampsOn<'_>, group: &ParticleGroup, lanes: Range<usize>) -> [[f32; GROUP]; 3] {
        let this = self.fall.precipitation;
        let (asymmetry, reflectance) = match this.kind.shape {
            ParticleShape::Ball => (DROP_ASYMMETRY, 1.0),
            ParticleShape::Flake => (FLAKE_ASYMMETRY, this.kind.reflectance as f32),
        };
        let strength = reflectance * (this.look.brightness as f32);
        let center = Vec3::from_array(self.view.center.map(|v| v as f32));
        let mut light = [[0.0; GROUP]; 3];
        for lane in lanes {
            let offset = Vec3::from_array(group.offset.map(|axis| axis[lane]));
            let seen =
                strength * lamps.scattered(center, offset, asymmetry, self.fall.metres_per_unit as f32);
            (0..3).for_each(|k| light[k][lane] = seen[k]);
        }
        light
    }

    /// Makes three arms, in a plane that tumbles, of a flake of a group that is `width` scene units
    /// wide.
    fn add_arms(&mut self, group: &mut ParticleGroup, lane: usize, width: f64) {
        if group.area[lane] <= 0.0 {
            return;
        }
        let one = Particle {
            offset: group.offset.map(|axis| axis[lane]),
            sigma: (DISC_SIGMA_RATIO * ARM_THICKNESS_RATIO * 2.0 * width) as f32,
            reach: group.reach.map(|direction| direction.map(|axis| axis[lane])),
            area: group.area[lane] / 3.0,
            rgb: group.rgb.map(|channel| channel[lane]),
        };
        group.area[lane] = 0.0;
        let (time, mut draws) = (self.fall.around.time, RandomSequence::new(u64::from(self.batch.own[lane])));
        let (tilt, turn) = (draws.uniform(), TAU * (draws.uniform() + (draws.uniform() - 0.5) * time));
        let (z, spin) = (2.0 * tilt - 1.0, TAU * (draws.uniform() + (draws.uniform() - 0.5) * time));
        let r = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = turn.sin_cos();
        let (a, b) = ([-sin, cos, 0.0], [-z * cos, -z * sin, r]);
        for arm in 0..3 {
            let (sin, cos) = (spin + PI / 3.0 * f64::from(arm)).sin_cos();
            let along = std::array::from_fn(|k| (a[k] * cos + b[k] * sin) * width * LINE_SIGMA_RATIO);
            let along = from_level(&self.fall.axes, along).map(|v| v as f32);
            self.arms.push(Particle { reach: [one.reach[0], along], ..one });
        }
    }

    #[inline(always)]
    fn finish<S: Lanes>(mut self, simd: S) {
        if self.count > 0 {
            self.flush(simd);
        }
        for arms in self.arms.chunks(GROUP) {
            (self.take)(&ParticleGroup::of(arms));
        }
    }
}

#[cfg(test)]
mod tests;
