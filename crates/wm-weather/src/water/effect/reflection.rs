//! Reflections of water: samples of the lobe of a rough surface, and the distance to what they
//! show.

use super::scene::{Pixels, Scene, Water, dot};
use crate::lanes::{LaneArray, SetLanes};
use crate::water::fresnel::fresnel_of;
use crate::water::mirror::{Extent, ReflectionLanes};
use crate::water::rills::Slope;
use crate::water::surface::{FILM_SLOPE_RMS, NODE_SPACING_PX};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use wm_render::hooks::GROUP;
use wm_render::simd::{Lanes, exp2, log2};

/// Samples of the lobe of a rough surface: offsets of the slope in standard deviations and weights,
/// of a normal distribution; and the width of each sample over the standard deviation of the lobe's
/// height.
struct LobeSamples(&'static [(f32, f32)], f32);

impl LobeSamples {
    /// Sample `k`; its weight is 0 past the last one.
    #[inline(always)]
    fn look(&self, k: usize) -> (f32, f32) {
        if k < self.0.len() { self.0[k] } else { (0.0, 0.0) }
    }
}

const ONE_SAMPLE: LobeSamples = LobeSamples(&[(0.0, 1.0)], 0.0);
const THREE_SAMPLES: LobeSamples = LobeSamples(&[(0.0, 0.62), (-1.62, 0.19), (1.62, 0.19)], 1.4);
const FIVE_SAMPLES: LobeSamples =
    LobeSamples(&[(0.0, 0.399), (-1.0, 0.242), (1.0, 0.242), (-2.0, 0.058), (2.0, 0.058)], 0.9);

/// Sampling of a film, which is looked into at few pixels: close enough that lamps are streaks and
/// no blots.
const FILM_SAMPLES: LobeSamples = LobeSamples(
    &[
        (0.0, 0.233),
        (-0.58, 0.197),
        (0.58, 0.197),
        (-1.16, 0.119),
        (1.16, 0.119),
        (-1.74, 0.051),
        (1.74, 0.051),
        (-2.32, 0.0165),
        (2.32, 0.0165),
    ],
    0.5,
);

/// Height of a lobe, standard deviations in px of the mirrored picture, below which one look is
/// enough.
const SHARP_LOBE_PX: f32 = 0.35;

/// Height of a lobe, in the same unit, above which a few samples are too far apart.
const TALL_LOBE_PX: f32 = 5.0;

/// Slope away from the eye, over the tangent of the view's elevation, above which crests hide what
/// is behind them.
const HIDING_SLOPE: f32 = 0.7;

/// Least width of a sample, px, over the standard deviation of the lobe across the view: a
/// footprint in a mirrored picture is a box, interpolated between pixels.
const FOOTPRINT_SIGMAS: f32 = 2.45;

/// Width over which the depth of what a lobe shows is averaged, of the lobe's height: far less than
/// the lobe, whose lower end shows what stands before the water.
const DEPTH_BLUR: f32 = 1.0;

/// Least distance to what a rough surface mirrors, of that to the surface: nearer things are mixed
/// with what is beside them.
const MIN_REFLECTION_DISTANCE: f32 = 0.03;

/// Ratio of a reciprocal view z to that of the water above which things are nearer than the water
/// and not mirrored in it.
const NEARER_RECIPROCAL: f32 = 1.1;

/// Scale of the share of water that is free of its ground: above 1 / 4 it counts as entirely free.
const FREE_WATER_SCALE: f32 = 4.0;

/// Largest distance of a mirrored point from the water, m: beyond it there is no parallax.
const MAX_REFLECTION_DISTANCE_M: f32 = 1e5;

impl Scene<'_> {
    /// Finds the distance of what pixels mirror.
    #[inline(always)]
    pub(super) fn find_reach<S: Lanes>(&self, simd: S, start: usize, pixels: &mut Pixels) {
        let z = simd.load(&pixels.z[start..]);
        let is_wet = z.simd_eq(z);
        if is_wet.any_true() {
            let point = Point::new(self, simd, simd.load(&pixels.x[start..]), pixels.y, z);
            let still = simd.load(&pixels.still[start..]);
            let slopes =
                self.slopes(simd, &point, still, NODE_SPACING_PX.ilog2() as f32, is_wet.to_bitmask() as u32);
            let facet = Facet::new(self, simd, point, slopes, still);
            let far = self.reach(simd, &facet, point.distance, is_wet);
            (simd.set(1.0) / far).store_slice(&mut pixels.reach[start..start + S::N]);
        }
    }

    /// Slopes of the surface and their variance, with those of the streams on slopes, at the wanted
    /// lanes of points from the eye, m.
    #[inline(always)]
    fn with_rills<S: Lanes>(
        &self,
        simd: S,
        hit: &[S::F; 3],
        log_width: S::F,
        wanted: u32,
        slopes: &[S::F; 3],
    ) -> [S::F; 3] {
        let (x, y) = (LaneArray::new(simd, hit[0]), LaneArray::new(simd, hit[1]));
        let width = LaneArray::new(simd, exp2(simd, [log_width])[0]);
        let (mut east, mut north) = (LaneArray::new(simd, slopes[0]), LaneArray::new(simd, slopes[1]));
        let mut variance = LaneArray::new(simd, slopes[2]);
        for i in SetLanes(wanted) {
            let place = [self.eye[0] + f64::from(x.0[i]), self.eye[1] + f64::from(y.0[i])];
            let mut slope = Slope { mean: [east.0[i], north.0[i]], variance: variance.0[i] };
            self.of.motion.add_rills(place, width.0[i], &mut slope);
            (east.0[i], north.0[i], variance.0[i]) = (slope.mean[0], slope.mean[1], slope.variance);
        }
        [simd.load(&east.0), simd.load(&north.0), simd.load(&variance.0)]
    }

    /// The slopes of the water at points that have a bit in `wanted`, along the two level axes, and
    /// their variance along one axis in a piece of the picture of such a side, px, logarithm to
    /// base 2. `still` are slopes that do not move.
    #[inline(always)]
    fn slopes<S: Lanes>(
        &self,
        simd: S,
        point: &Point<S>,
        still: S::F,
        log_side: f32,
        wanted: u32,
    ) -> [S::F; 3] {
        // A film between the grains of the ground has no waves.
        let free = (simd.set(1.0) - still * (1.0 / FILM_SLOPE_RMS)).max(simd.set(0.0));
        let waves = wanted & free.simd_gt(simd.set(0.0)).to_bitmask() as u32;
        if waves == 0 {
            return [simd.set(0.0); 3];
        }
        // What a pixel sees of the surface is longer than wide; between both is what waves must be
        // wider than.
        let [far, flat] = log2(simd, [point.distance, point.sine]);
        let width = flat.mul_add(simd.set(-0.75), far + (self.pixel + log_side));
        let [x, y, _] = point.hit;
        let mut slopes = self.of.motion.at(simd, [x, y], &self.phases, width, waves);
        if self.of.motion.running.is_some() {
            slopes = self.with_rills(simd, &point.hit, width, waves, &slopes);
        }
        [slopes[0] * free, slopes[1] * free, slopes[2] * free * free]
    }

    /// Looks into the water at those of sixteen pixels that have any, as many of them as there are
    /// lanes from `start` on.
    #[inline(always)]
    pub(super) fn look<S: Lanes>(&self, simd: S, start: usize, pixels: &Pixels, water: &mut Water) {
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let z = simd.load(&pixels.z[start..]);
        let is_wet = z.simd_eq(z);
        let wanted = is_wet.to_bitmask() as u32;
        if wanted == 0 {
            return;
        }
        let still = simd.load(&pixels.still[start..]);
        let point = Point::new(self, simd, simd.load(&pixels.x[start..]), pixels.y, z);
        let slopes = self.slopes(simd, &point, still, 0.0, wanted);
        if let Some(foam) = &mut water.foam {
            let square = slopes[0].mul_add(slopes[0], slopes[1] * slopes[1]);
            square.store_slice(&mut foam.slopes[0][start..start + S::N]);
            slopes[2].store_slice(&mut foam.slopes[1][start..start + S::N]);
        }
        let facet = Facet::new(self, simd, point, slopes, still);
        let free = (one - still * (1.0 / FILM_SLOPE_RMS)).max(zero);
        let known = simd.load(&pixels.reach[start..]);
        let is_known = known.simd_eq(known);
        let mut far = one / known;
        if !(is_known | !is_wet).all_true() {
            far = is_known.select(far, self.reach(simd, &facet, point.distance, is_wet & !is_known));
        }
        let Facet { from, tilt, first, rough } = facet;
        // A lobe as it is seen in the mirrored picture: two slopes tall, and as much narrower as a
        // facet is met at less of an angle. Of what stands at the water it is a point.
        let tall = self.lobe::<S>(rough, far, point.distance);
        let wide = tall * FOOTPRINT_SIGMAS;
        let (is_sharp, is_low) =
            (tall.simd_lt(simd.set(SHARP_LOBE_PX)), tall.simd_lt(simd.set(TALL_LOBE_PX)));
        let kinds = SampleChoice::<S> { is_sharp, is_low, free: (free * FREE_WATER_SCALE).min(one) };
        let is_near_film = kinds.free.simd_lt(one);
        let apart = kinds.pick(simd, ONE_SAMPLE.1, THREE_SAMPLES.1, FILM_SAMPLES.1, FIVE_SAMPLES.1);
        let tallest = is_wet.select(tall, zero);
        let count = match () {
            () if tallest.simd_lt(simd.set(SHARP_LOBE_PX)).all_true() => ONE_SAMPLE.0.len(),
            () if tallest.simd_lt(simd.set(TALL_LOBE_PX)).all_true() => THREE_SAMPLES.0.len(),
            () if (is_wet & is_near_film).any_true() => FILM_SAMPLES.0.len(),
            () => FIVE_SAMPLES.0.len(),
        };
        let mut middle = from;
        for k in 0..3 {
            middle[k] = far.mul_add(first.0[k], from[k]);
        }
        let (middle, _) = self.project(simd, &middle);
        let slant = self.slant(simd, middle);
        let extent = |cosine: S::F| {
            let along = is_sharp.select(one, apart * tall);
            Extent { wide: is_sharp.select(one, (wide * cosine.max(zero)).max(along * slant)), tall: along }
        };
        let mut fineness = self.mirrored.fineness(simd, extent(first.1));
        let (mut sum, mut seen) = (zero, zero);
        let mut light = [[0.0; 4]; GROUP];
        let is_close = count == FILM_SAMPLES.0.len();
        let mut looks = [(middle, zero); FIVE_SAMPLES.0.len()];
        for k in 0..count {
            let look =
                [ONE_SAMPLE.look(k), THREE_SAMPLES.look(k), FILM_SAMPLES.look(k), FIVE_SAMPLES.look(k)];
            let sigma = kinds.pick(simd, look[0].0, look[1].0, look[2].0, look[3].0);
            let weight = kinds.pick(simd, look[0].1, look[1].1, look[2].1, look[3].1);
            let (way, cosine) = if k == 0 { first } else { tilt.reflect(simd, sigma * rough) };
            // Slopes that look away from the eye are not seen.
            let weight = weight * cosine.max(point.sine * 0.02);
            let part = weight * fresnel_of(simd, cosine.max(zero));
            let mut at = middle;
            if k > 0 {
                let mut mirrored = from;
                for k in 0..3 {
                    mirrored[k] = far.mul_add(way[k], from[k]);
                }
                (at, _) = self.project(simd, &mirrored);
            }
            sum += weight;
            seen += part;
            if is_close {
                // Facets that are met at less of an angle throw light farther aside: of films,
                // whose looks are close, that is wider than they are apart.
                if k > 0 {
                    fineness = self.mirrored.fineness(simd, extent(cosine));
                }
                let wanted = (is_wet & part.simd_gt(zero)).to_bitmask() as u32;
                self.mirrored.add(simd, at, &fineness, part, wanted, &mut light);
            } else {
                looks[k] = (at, part);
            }
        }
        if !is_close {
            let lanes = ReflectionLanes { wanted, nearest: simd.set(NEARER_RECIPROCAL) / z };
            self.mirrored.add_all(simd, &looks[..count], &fineness, lanes, &mut light);
        }
        let scale = one / sum;
        // Others may be films that are known already.
        let reflected = is_wet.select(seen * scale, simd.load(&water.reflected[start..]));
        reflected.store_slice(&mut water.reflected[start..start + S::N]);
        let scale = LaneArray::new(simd, scale);
        for i in SetLanes(wanted) {
            for k in 0..3 {
                water.mirrored[k][start + i] = light[i][k] * scale.0[i];
            }
        }
    }

    /// Height of the lobe of a rough surface in the mirrored picture, standard deviation in px, of
    /// what is so far from water at a distance, m.
    #[inline(always)]
    fn lobe<S: Lanes>(&self, rough: S::F, far: S::F, distance: S::F) -> S::F {
        rough * (2.0 * self.focal[1]) * far / (far + distance)
    }

    /// Distances along reflected rays from points of the water to what is mirrored, m, found in the
    /// depth of the mirrored picture in two steps. On a rough surface it is the mean, in the
    /// reciprocal, over the middle of the lobe: the depth of one point would jump at the
    /// silhouettes of what is mirrored, and with it the size of the lobe.
    #[inline(always)]
    fn reach<S: Lanes>(&self, simd: S, facet: &Facet<S>, distance: S::F, is_wet: S::M) -> S::F {
        let Facet { from, first: (way, cosine), rough, .. } = facet;
        let (cosine, rough) = (*cosine, *rough);
        let farthest = simd.set(MAX_REFLECTION_DISTANCE_M);
        let mut far = farthest;
        let mut going = is_wet;
        for step in 0..2 {
            if step > 0 {
                // What was lost stays so.
                going &= far.simd_lt(farthest);
            }
            let wanted = going.to_bitmask() as u32;
            if wanted == 0 {
                break;
            }
            let mut point = *from;
            for k in 0..3 {
                point[k] = far.mul_add(way[k], from[k]);
            }
            let (at, z) = self.project(simd, &point);
            let tall = self.lobe::<S>(rough, far, distance);
            let is_sharp = tall.simd_lt(simd.set(SHARP_LOBE_PX));
            let sharp = wanted & is_sharp.to_bitmask() as u32;
            let mut inverse = self.mirrored.inverse_depth(simd, at, sharp);
            if sharp != wanted {
                let tall = tall * DEPTH_BLUR;
                let narrow = cosine.max(self.slant(simd, at)).min(simd.set(1.0));
                let fineness = self.mirrored.fineness(simd, Extent { wide: tall * narrow, tall });
                inverse += self.mirrored.mean_inverse_depth(simd, at, &fineness, wanted & !sharp);
            }
            let inverse = inverse * (1.0 / self.metres);
            let is_met =
                z.simd_gt(simd.set(0.0)) & inverse.simd_ge(simd.set(1.0 / MAX_REFLECTION_DISTANCE_M));
            // The same ray through the eye, up to that depth.
            let scale = simd.set(1.0) / (inverse.max(simd.set(0.1 / MAX_REFLECTION_DISTANCE_M)) * z);
            let mut there = point;
            for k in 0..3 {
                there[k] = point[k].mul_add(scale, -from[k]);
            }
            let nearest =
                is_sharp.select(simd.set(0.01), (distance * MIN_REFLECTION_DISTANCE).max(simd.set(0.01)));
            let met = dot::<S>(&there, way).max(nearest).min(farthest);
            far = going.select(is_met.select(met, farthest), far);
        }
        far
    }

    /// Returns the share of its length, 0-1, by which an upright line leans to the side at points
    /// of the mirrored picture. Lobes lie along upright lines.
    #[inline(always)]
    fn slant<S: Lanes>(&self, simd: S, at: [S::F; 2]) -> S::F {
        let mut lean = at;
        for k in 0..2 {
            // The change of a picture point when its point rises, times its view z.
            let from_middle = at[k] - simd.set(self.principal[k]);
            lean[k] =
                from_middle.mul_add(simd.set(-self.view[2][2]), simd.set(self.focal[k] * self.view[k][2]));
        }
        let length = lean[0].mul_add(lean[0], lean[1] * lean[1]).sqrt().max(simd.set(1e-3));
        lean[0].max(-lean[0]) / length
    }

    /// Picture points of the mirrored view and view z in metres, of points from the mirrored eye.
    #[inline(always)]
    fn project<S: Lanes>(&self, simd: S, point: &[S::F; 3]) -> ([S::F; 2], S::F) {
        let mut view = *point;
        for (own, row) in view.iter_mut().zip(&self.view) {
            *own = point[0] * row[0];
            for k in 1..3 {
                *own = point[k].mul_add(simd.set(row[k]), *own);
            }
        }
        let [x, y, z] = view;
        let inverse = simd.set(1.0) / z.max(simd.set(1e-6));
        let at = [
            (x * inverse).mul_add(simd.set(self.focal[0]), simd.set(self.principal[0])),
            (y * inverse).mul_add(simd.set(self.focal[1]), simd.set(self.principal[1])),
        ];
        (at, z)
    }
}

/// Points of the water that are seen.
#[derive(Clone, Copy)]
struct Point<S: Lanes> {
    /// Directions to them, level axes, of length 1.
    toward: [S::F; 3],
    /// Places of the points from the eye, level axes, m.
    hit: [S::F; 3],
    /// Distances of the points, m.
    distance: S::F,
    /// Sines of the angles between the views and the level.
    sine: S::F,
}

impl<S: Lanes> Point<S> {
    /// The points through picture points of a row, at view z `z`, scene units; harmless numbers
    /// where that is NaN.
    #[inline(always)]
    fn new(scene: &Scene<'_>, simd: S, x: S::F, y: f32, z: S::F) -> Self {
        let z = z.simd_eq(z).select(z, simd.set(1.0));
        let (toward, long) = scene.toward(simd, x, y);
        let distance = z * long;
        let mut hit = toward;
        for k in 0..3 {
            hit[k] = toward[k] * distance;
        }
        Self { toward, hit, distance, sine: (-toward[2]).max(simd.set(1e-4)) }
    }
}

/// Pieces of the surface that pixels see.
struct Facet<S: Lanes> {
    /// Places of the pieces from the mirrored eye, level axes, m.
    from: [S::F; 3],
    tilt: Tilt<S>,
    /// The directions that their mean slopes reflect, and the cosines between them and the normals.
    first: ([S::F; 3], S::F),
    /// Standard deviations of their slopes along one axis.
    rough: S::F,
}

impl<S: Lanes> Facet<S> {
    /// Pieces about points with mean slopes along the two level axes, their variance, and slopes
    /// that do not move.
    #[inline(always)]
    fn new(scene: &Scene<'_>, simd: S, point: Point<S>, slopes: [S::F; 3], still: S::F) -> Self {
        let [east, north, variance] = slopes;
        let Point { toward, hit, sine, .. } = point;
        let level = toward[0].mul_add(toward[0], toward[1] * toward[1]).sqrt().max(simd.set(1e-6));
        let along = [toward[0] / level, toward[1] / level];
        // Along the view and across it; what looks too far away is behind a crest.
        let ahead = east.mul_add(along[0], north * along[1]);
        let beside = north.mul_add(along[0], -(east * along[1]));
        let tilt = Tilt { toward, along, ahead, beside, least: sine / level * -HIDING_SLOPE };
        // The mirrored eye is that much below the plane, and the hit about in it.
        let from = [hit[0], hit[1], hit[2] + 2.0 * scene.height];
        let first = tilt.reflect(simd, simd.set(0.0));
        Self { from, tilt, first, rough: still.mul_add(still, variance).sqrt() }
    }
}

/// Views of water, and its mean slope.
struct Tilt<S: Lanes> {
    toward: [S::F; 3],
    /// The level direction of the view.
    along: [S::F; 2],
    /// The slope along it and across it.
    ahead: S::F,
    beside: S::F,
    /// The least slope along it that is seen.
    least: S::F,
}

impl<S: Lanes> Tilt<S> {
    /// Directions reflected by slopes that are so much more along the view, above the horizon, and
    /// the cosines between them and the normal.
    #[inline(always)]
    fn reflect(&self, simd: S, more: S::F) -> ([S::F; 3], S::F) {
        let Self { toward, along, beside, .. } = self;
        let ahead = (self.ahead + more).max(self.least);
        let slope =
            [ahead.mul_add(along[0], -(*beside * along[1])), ahead.mul_add(along[1], *beside * along[0])];
        let one = simd.set(1.0);
        let scale = one / slope[0].mul_add(slope[0], slope[1].mul_add(slope[1], one)).sqrt();
        let normal = [-slope[0] * scale, -slope[1] * scale, scale];
        let cosine = -dot::<S>(toward, &normal);
        let mut way = *toward;
        for k in 0..3 {
            way[k] = (cosine * 2.0).mul_add(normal[k], toward[k]);
        }
        // A second reflection sends up what the first sends down.
        way[2] = way[2].max(-way[2]).max(simd.set(1e-4));
        (way, cosine)
    }
}

/// Choice of samples by lane: the first mask that is set counts. Where none is, [`FILM_SAMPLES`] of
/// films blend into [`FIVE_SAMPLES`] of free water, so that films end without an edge.
struct SampleChoice<S: Lanes> {
    is_sharp: S::M,
    is_low: S::M,
    free: S::F,
}

impl<S: Lanes> SampleChoice<S> {
    /// A number of [`ONE_SAMPLE`], [`THREE_SAMPLES`], [`FILM_SAMPLES`] or [`FIVE_SAMPLES`].
    #[inline(always)]
    fn pick(&self, simd: S, one: f32, few: f32, close: f32, many: f32) -> S::F {
        let many = self.free.mul_add(simd.set(many - close), simd.set(close));
        self.is_sharp.select(simd.set(one), self.is_low.select(simd.set(few), many))
    }
}
