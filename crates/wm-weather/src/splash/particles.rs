//! Splashes in front of a camera.

use super::drips::{self, Drip, Fall};
use super::fallen::{FallenDrop, FallenDrops};
use super::flight::Flight;
use super::ground::{Floor, SplashGround, SplashPlace};
use super::impact::{self, Impact};
use crate::level::{level_axes, to_level};
use crate::particles::Precipitation;
use crate::particles::fall::{DISC_SIGMA_RATIO, DROP_ASYMMETRY, LINE_SIGMA_RATIO, Surroundings};
use crate::particles::field::ViewFrustum;
use crate::water::ripples::SIZE;
use fearless_simd::{SimdBase, SimdFloat};
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use wm_base::random::{RandomSequence, mix};
use wm_render::dispatch;
use wm_render::hooks::{GROUP, Particle, ParticleGroup, ParticleView, Particles};
use wm_render::simd::{Lanes, SimdPath};

/// Farthest and nearest distance at which splashes are drawn, m.
const MAX_DISTANCE_M: f64 = 45.0;
const MIN_DISTANCE_M: f64 = 0.15;
/// Longest flight of a droplet, and longest life of a crown or a jet, s.
const MAX_FLIGHT_S: f64 = 0.4;
const MAX_CROWN_LIFE_S: f64 = impact::JET_START_S + impact::JET_LIFE_S;
/// Width of a usual crown, m, and the width, px, below which fewer and wider ones are drawn.
const USUAL_CROWN_WIDTH_M: f64 = 0.006;
const MERGING_WIDTH_PX: f64 = 1.25;
/// Width, px, below which droplets are drawn fewer and wider: less than that of crowns, else a
/// cloud of droplets becomes a few grains. And the droplets of a drop of which one is to be drawn
/// before fewer drops are requested theirs.
const DROPLET_MERGING_WIDTH_PX: f64 = 0.55;
const MIN_DRAWN_DROPLETS: f64 = 150.0;
/// Largest number of droplets drawn for one drop.
const MAX_DRAWN_DROPLETS: f64 = 400.0;
/// Farthest that a splash is from its drop.
const MAX_SPLASH_REACH_M: f64 = 0.6;
/// Speed of droplets over that of their drop, least and greatest: the slow ones are more frequent.
const SPEED_RATIOS: [f64; 2] = [0.08, 0.45];
/// Angles over level ground at which droplets start.
const START_ANGLES_RAD: [f64; 2] = [0.85, 1.4];
/// Times at which droplets leave the crown, shares of its life.
const DROPLET_START_TIMES: [f64; 2] = [0.25, 0.75];
/// Wind near the ground over that at 10 m, and the part of a drop's way along the ground that its
/// droplets keep.
const NEAR_GROUND: f64 = 0.3;
const KEPT_VELOCITY: f64 = 0.2;
/// Most fingers of a crown, and the slope of its wall: outwards for a length of 1 upwards.
const MAX_FINGER_COUNT: f64 = 14.0;
const CROWN_WALL_SLOPE: f64 = 0.45;
/// Width of a finger over the distance of fingers, as a standard deviation.
const FINGER_SIGMA_RATIO: f64 = 0.2;

/// Last number of a part that marks it as one of eaves, and the eaves in one part.
const EAVE_PART_KIND: i32 = 1;
const PART_EAVE_COUNT: usize = 64;
/// Height and depth of air over an eave's ground in which what falls from it is looked for.
const EAVE_SEARCH_HEIGHT_M: f64 = 0.5;

/// Splashes in front of a camera at an instant.
pub(crate) struct SplashParticles<'a> {
    rain: &'a Precipitation,
    around: Surroundings<'a>,
    floor: Floor<'a>,
    axes: [[f64; 3]; 3],
    metres_per_unit: f64,
    /// The camera's velocity, m/s along the level axes and up.
    camera: DVec3,
    amount: f64,
    radiance: Vec3,
    /// The drops whose droplets may fly, and those whose crown or jet may stand.
    flying: FallenDrops,
    standing: FallenDrops,
}

impl<'a> SplashParticles<'a> {
    /// The splashes of `rain` on a ground and on water at the height `plane` (m along up from the
    /// world's origin). `seed` is that of the water.
    pub(crate) fn new(
        amount: f64,
        rain: &'a Precipitation,
        seed: u64,
        around: Surroundings<'a>,
        ground: Option<&'a SplashGround<'a>>,
        plane: Option<f64>,
    ) -> Self {
        let Surroundings { site, shelter, time, .. } = around;
        let axes = level_axes(site.up);
        let half = 0.5 * rain.look.exposure;
        let flying = FallenDrops::new(rain, time, [MAX_FLIGHT_S + half, half], seed);
        Self {
            rain,
            floor: Floor {
                ground,
                plane,
                shelter,
                units: axes.map(|axis| axis.map(|v| v / site.metres_per_unit)),
            },
            metres_per_unit: site.metres_per_unit,
            camera: DVec3::from_array(to_level(&axes, around.velocity)),
            amount,
            radiance: Vec3::from_array(rain.radiance()),
            standing: flying.younger(MAX_CROWN_LIFE_S + half),
            flying,
            axes,
            around,
        }
    }

    /// The camera's centre, m along the level axes.
    fn center(&self, view: &ParticleView) -> DVec3 {
        DVec3::from_array(to_level(&self.axes, view.center)) * self.metres_per_unit
    }
}

impl Particles for SplashParticles<'_> {
    fn parts(&self, view: &ParticleView) -> Vec<[i32; 4]> {
        let center = self.center(view);
        let planes = ViewFrustum::planes(view, &self.axes).map(DVec3::from_array);
        let [x, y] = [center.x, center.y].map(|v| (v / SIZE).floor().clamp(-1e15, 1e15) as i64);
        let reach = (MAX_DISTANCE_M / SIZE).ceil() as i64;
        let is_seen = |tile: [i64; 2]| {
            let Some([low, high]) = self.floor.heights(tile) else { return false };
            let corner = DVec3::new(tile[0] as f64 * SIZE, tile[1] as f64 * SIZE, low) - center;
            let half = 0.5 * DVec3::new(SIZE, SIZE, high - low);
            let radius = half.length() + MAX_SPLASH_REACH_M;
            let middle = corner + half;
            middle.length() < MAX_DISTANCE_M + radius
                && planes.iter().all(|plane| plane.dot(middle) > -radius)
        };
        let mut parts = Vec::new();
        for row in -reach..=reach {
            let mut begin = None;
            for column in -reach..=reach + 1 {
                let seen = column <= reach && is_seen([x + column, y + row]);
                match (seen, begin) {
                    (true, None) => begin = Some(column),
                    (false, Some(from)) => {
                        parts.push([row as i32, from as i32, column as i32, 0]);
                        begin = None;
                    }
                    _ => {}
                }
            }
        }
        // Eaves, a number of them a part.
        let eaves = self.floor.ground.map_or(0, |ground| ground.eaves().count()) as i32;
        parts.extend(
            (0..eaves)
                .step_by(PART_EAVE_COUNT)
                .map(|first| [first, (first + PART_EAVE_COUNT as i32).min(eaves), 0, EAVE_PART_KIND]),
        );
        parts
    }

    fn gather(
        &self,
        path: SimdPath,
        view: &ParticleView,
        part: [i32; 4],
        take: &mut dyn FnMut(&ParticleGroup),
    ) {
        let [row, from, to, kind] = part;
        if kind == EAVE_PART_KIND {
            let [first, end, ..] = part.map(|v| v as usize);
            let mut brush = Brush::new(self, path, view, take);
            brush.eaves(first..end);
            brush.flush();
            return;
        }
        let center = self.center(view);
        let [x, y] = [center.x, center.y].map(|v| (v / SIZE).floor() as i64);
        let mut brush = Brush::new(self, path, view, take);
        for column in from..to {
            brush.tile([x + i64::from(column), y + i64::from(row)]);
        }
        brush.flush();
    }
}

/// A drop that has hit something in view.
struct Hit {
    /// Position, m from the camera along the level axes.
    at: DVec3,
    distance: f64,
    age: f64,
    impact: Impact,
    draws: RandomSequence,
    /// Reciprocal of the number of drops that it stands for.
    keep: f64,
}

/// Makes the particles of one part.
struct Brush<'a> {
    of: &'a SplashParticles<'a>,
    path: SimdPath,
    view: &'a ParticleView,
    take: &'a mut dyn FnMut(&ParticleGroup),
    center: DVec3,
    planes: [DVec3; 5],
    /// Width of a pixel a metre of distance.
    pixel: f64,
    exposure: f64,
    made: Vec<Particle>,
}

impl<'a> Brush<'a> {
    fn new(
        of: &'a SplashParticles<'a>,
        path: SimdPath,
        view: &'a ParticleView,
        take: &'a mut dyn FnMut(&ParticleGroup),
    ) -> Self {
        Self {
            of,
            path,
            view,
            take,
            center: of.center(view),
            planes: ViewFrustum::planes(view, &of.axes).map(DVec3::from_array),
            pixel: 1.0 / f64::from(view.pixels()),
            exposure: of.rain.look.exposure,
            made: Vec::with_capacity(GROUP),
        }
    }

    /// Share of the crowns that are drawn at a distance, m.
    fn crowns(&self, distance: f64) -> f64 {
        (USUAL_CROWN_WIDTH_M * self.of.rain.look.size / (MERGING_WIDTH_PX * self.pixel * distance))
            .powi(2)
            .min(1.0)
    }

    /// Width of droplets that are drawn at a distance, m; smaller ones are drawn fewer and so wide.
    fn droplet_width(&self, distance: f64) -> f64 {
        // More that hide less, where they would hide more than they are wide.
        DROPLET_MERGING_WIDTH_PX / self.of.rain.look.opacity.max(1.0).sqrt() * self.pixel * distance
    }

    /// Share of the drops whose droplets are drawn at a distance, m.
    fn throwing_share(&self, distance: f64) -> f64 {
        let usual = 0.5 * (impact::DROPLET_DIAMETERS_M[0] + impact::DROPLET_DIAMETERS_M[1]);
        (MIN_DRAWN_DROPLETS * (usual / self.droplet_width(distance)).powi(2)).min(1.0)
    }

    /// Makes the splashes of a tile.
    fn tile(&mut self, tile: [i64; 2]) {
        let of = self.of;
        let Some([low, high]) = of.floor.heights(tile) else { return };
        let corner = DVec2::new(tile[0] as f64, tile[1] as f64) * SIZE;
        let from = DVec3::new(corner.x, corner.y, low) - self.center;
        let to = from + DVec3::new(SIZE, SIZE, high - low);
        let nearest = DVec3::ZERO.clamp(from, to).length().max(MIN_DISTANCE_M);
        let number = mix((tile[0] as u64).rotate_left(32) ^ tile[1] as u64);
        let turn = (number >> 11) as f64 * 2f64.powi(-53);
        of.standing.each(self.crowns(nearest), turn, |drop, rank| {
            if let Some(hit) = self.hit(drop, number, corner, 0.1, |brush, distance| {
                Some(brush.crowns(distance)).filter(|share| rank < *share)
            }) {
                self.crown(hit);
            }
        });
        of.flying.each(self.throwing_share(nearest), turn, |drop, rank| {
            if let Some(hit) = self.hit(drop, number, corner, MAX_SPLASH_REACH_M, |brush, distance| {
                Some(brush.throwing_share(distance)).filter(|share| rank < *share)
            }) {
                self.droplets(hit);
            }
        });
    }

    /// Makes the drops that fall from eaves, and their splashes.
    fn eaves(&mut self, numbers: std::ops::Range<usize>) {
        let of = self.of;
        let Some(ground) = of.floor.ground else { return };
        let half = 0.5 * self.exposure;
        for (number, eave, flux) in ground.eaves().skip(numbers.start).take(numbers.len()) {
            let (place, cell) = ground.under(eave);
            let foot = DVec3::from_array(place) - self.center;
            let drop = f64::from(eave.drop);
            let (middle, radius) = (foot + DVec3::Z * (0.5 * drop), 0.5 * drop + EAVE_SEARCH_HEIGHT_M);
            if middle.length() - radius > MAX_DISTANCE_M
                || self.planes.iter().any(|plane| plane.dot(middle) < -radius)
            {
                continue;
            }
            let film = of.floor.at(place[0], place[1]).map_or(0.0, |place| place.film);
            let usual = Fall { terminal: of.rain.kind.fall_speed(5.0) };
            let times = [of.around.time - usual.time(drop) - MAX_FLIGHT_S - half, of.around.time + half];
            drips::each(number as u64, flux, times, of.around.time, |drip| {
                self.drip(drip, foot, drop, cell, film);
            });
        }
    }

    /// Makes a drop that falls from an eave, or its splash.
    fn drip(&mut self, drip: Drip, foot: DVec3, drop: f64, cell: f64, film: f64) {
        let of = self.of;
        let fall = Fall { terminal: of.rain.kind.fall_speed(1e3 * drip.diameter) };
        let lands = fall.time(drop);
        let foot = foot + DVec3::new(drip.place[0], drip.place[1], 0.0) * cell;
        if let Some([from, to]) = self.seen(drip.age, [0.0, lands]) {
            let [first, last] = [from, to].map(|age| DVec3::Z * (drop - fall.depth(age)));
            let way = last - first - of.camera * (to - from);
            let at = foot + 0.5 * (first + last);
            let own = drip.diameter * of.rain.look.size;
            let area = PI / 4.0 * own * own * (to - from) / self.exposure;
            let distance = at.length();
            if (MIN_DISTANCE_M..MAX_DISTANCE_M).contains(&distance) {
                self.add(
                    at,
                    own.max(self.droplet_width(distance)) * DISC_SIGMA_RATIO,
                    [way * LINE_SIGMA_RATIO, DVec3::ZERO],
                    area,
                );
            }
        }
        let (age, distance) = (drip.age - lands, foot.length());
        if age + 0.5 * self.exposure > 0.0 && (MIN_DISTANCE_M..MAX_DISTANCE_M).contains(&distance) {
            let impact = Impact { diameter: drip.diameter, speed: fall.speed(lands), film };
            let mut draws = drip.draws;
            let rank = draws.uniform();
            let hit = |keep| Hit { at: foot, distance, age, impact, draws, keep };
            let (crowns, throwers) = (self.crowns(distance), self.throwing_share(distance));
            if rank < crowns {
                self.crown(hit(crowns));
            }
            if rank < throwers {
                self.droplets(hit(throwers));
            }
        }
    }

    /// Finds what a drop hits; `None` if it is not wanted there, nothing is hit, or it is `margin`
    /// m out of the picture. `keep` says by the distance what share of the drops is wanted.
    fn hit(
        &self,
        drop: &FallenDrop,
        tile: u64,
        corner: DVec2,
        margin: f64,
        keep: impl Fn(&Self, f64) -> Option<f64>,
    ) -> Option<Hit> {
        let place = corner + DVec2::new(f64::from(drop.place[0]), f64::from(drop.place[1]));
        let SplashPlace { height, film, share } = self.of.floor.at(place.x, place.y)?;
        let at = place.extend(height) - self.center;
        let distance = at.length();
        if !(MIN_DISTANCE_M..MAX_DISTANCE_M).contains(&distance) {
            return None;
        }
        let keep = keep(self, distance)?;
        if self.planes.iter().any(|plane| plane.dot(at) < -margin) {
            return None;
        }
        let mut draws = RandomSequence::new(mix(drop.key ^ tile));
        if draws.uniform() >= f64::from(share) {
            return None;
        }
        let diameter = 1e-3 * f64::from(drop.diameter);
        let speed = self.of.rain.kind.fall_speed(f64::from(drop.diameter));
        let impact = Impact { diameter, speed, film };
        Some(Hit { at, distance, age: f64::from(drop.age), impact, draws, keep })
    }

    /// The part of the exposure in which something is there that begins and ends at these ages of
    /// its drop: its beginning and end.
    fn seen(&self, age: f64, lifetime: [f64; 2]) -> Option<[f64; 2]> {
        let [begins, ends] = lifetime;
        let half = 0.5 * self.exposure;
        let seen = [begins.max(age - half), ends.min(age + half)];
        (seen[0] < seen[1]).then_some(seen)
    }

    /// Makes the crown of a drop, or its jet.
    fn crown(&mut self, mut hit: Hit) {
        let look = &self.of.rain.look;
        let wide = look.size / hit.keep.sqrt();
        let jet = self.seen(hit.age, [impact::JET_START_S, impact::JET_START_S + impact::JET_LIFE_S]);
        if let Some([from, to]) = jet
            && let Some([height, width]) = hit.impact.jet(0.5 * (from + to))
        {
            let area = self.of.amount * height * width * wide * wide * (to - from) / self.exposure;
            let middle = hit.at + DVec3::Z * (0.5 * height * wide);
            let along = DVec3::Z * (height * wide * LINE_SIGMA_RATIO);
            self.add(middle, width * wide * DISC_SIGMA_RATIO, [DVec3::ZERO, along], area);
        }
        if !hit.impact.splashes() {
            return;
        }
        let Some([from, to]) = self.seen(hit.age, [0.0, hit.impact.life()]) else { return };
        let crown = hit.impact.crown(0.5 * (from + to));
        let (radius, height) = (crown.radius * wide, crown.height * wide);
        // Near its threshold a drop throws little.
        let strength = (4.0 * (1.0 - 1.0 / hit.impact.excess())).min(1.0);
        let area = strength * self.of.amount * crown.area * wide * wide * (to - from) / self.exposure;
        let pixels = 2.0 * radius / (self.pixel * hit.distance);
        if pixels < 3.0 {
            let across = DVec3::Z.cross(hit.at).normalize_or_zero() * (radius * 2.0 * LINE_SIGMA_RATIO);
            let middle = hit.at + DVec3::Z * (0.5 * height);
            self.add(
                middle,
                0.5 * height * DISC_SIGMA_RATIO,
                [across, DVec3::Z * (height * LINE_SIGMA_RATIO)],
                area,
            );
            return;
        }
        let count = (1.5 * pixels).clamp(5.0, MAX_FINGER_COUNT).round();
        let apart = TAU * radius / count;
        let first = hit.draws.uniform() * TAU;
        for finger in 0..count as usize {
            let angle = first + TAU * (finger as f64 + 0.6 * hit.draws.uniform()) / count;
            let (sin, cos) = angle.sin_cos();
            let outwards = DVec3::new(cos, sin, 0.0);
            // Fingers differ, and their mean is the crown.
            let share = 0.4 + 1.2 * hit.draws.uniform();
            let way = (DVec3::Z + outwards * CROWN_WALL_SLOPE) * (height * share);
            let middle = hit.at + outwards * radius + way * 0.5;
            self.add(
                middle,
                apart * FINGER_SIGMA_RATIO,
                [DVec3::ZERO, way * LINE_SIGMA_RATIO],
                share * area / count,
            );
        }
    }

    /// Makes the droplets of a drop.
    fn droplets(&mut self, mut hit: Hit) {
        let impact = hit.impact;
        if !impact.splashes() {
            return;
        }
        let (look, amount) = (&self.of.rain.look, self.of.amount);
        let dot = self.droplet_width(hit.distance);
        let thrown = amount * impact.droplets() / hit.keep;
        // Wider ones each stand for more, so that their mean area is right.
        let usual = 0.5 * (impact::DROPLET_DIAMETERS_M[0] + impact::DROPLET_DIAMETERS_M[1]) * look.size;
        let wanted = (thrown * (usual / dot.max(usual)).powi(2)).min(MAX_DRAWN_DROPLETS);
        let count = (wanted + hit.draws.uniform()).floor() as usize;
        let each = thrown / wanted;
        let wind = DVec2::from_array(self.of.around.wind.wind);
        let (carried, air) = (wind * KEPT_VELOCITY, (wind * NEAR_GROUND).to_array());
        for _ in 0..count {
            let mut draw = |[least, greatest]: [f64; 2]| least + (greatest - least) * hit.draws.uniform();
            let leaves = draw(DROPLET_START_TIMES) * impact.life();
            let slow = draw([0.0, 1.0]);
            let speed = impact.speed * (SPEED_RATIOS[0] + (SPEED_RATIOS[1] - SPEED_RATIOS[0]) * slow * slow);
            let (rise, turn) = (draw(START_ANGLES_RAD).sin_cos(), draw([0.0, TAU]).sin_cos());
            let diameter = impact::droplet(draw([0.0, 1.0]));
            // Not before it leaves, and no longer than any flight.
            let half = 0.5 * self.exposure;
            if hit.age + half < leaves {
                continue;
            }
            let velocity =
                [speed * rise.1 * turn.1 + carried.x, speed * rise.1 * turn.0 + carried.y, speed * rise.0];
            let flight = Flight::new(diameter, velocity, air);
            let Some([from, to]) = self.seen(hit.age, [leaves, leaves + flight.lands().min(MAX_FLIGHT_S)])
            else {
                continue;
            };
            let crown = impact.crown(leaves);
            let rim = DVec3::new(turn.1, turn.0, 0.0) * crown.radius;
            let [first, last] = [from, to].map(|age| DVec3::from_array(flight.at(age - leaves)));
            let way = last - first - self.of.camera * (to - from);
            let own = diameter * look.size;
            let area = each * PI / 4.0 * own * own * (to - from) / self.exposure;
            self.add(
                hit.at + rim + 0.5 * (first + last),
                own.max(dot) * DISC_SIGMA_RATIO,
                [way * LINE_SIGMA_RATIO, DVec3::ZERO],
                area,
            );
        }
    }

    /// Adds a particle: m from the camera along the level axes, standard deviations, m, and the
    /// area that it hides, m^2.
    fn add(&mut self, at: DVec3, sigma: f64, reach: [DVec3; 2], area: f64) {
        let units = &self.of.floor.units;
        let world = |v: DVec3| -> [f32; 3] {
            std::array::from_fn(|k| (v.x * units[0][k] + v.y * units[1][k] + v.z * units[2][k]) as f32)
        };
        let per_metre = 1.0 / self.of.metres_per_unit;
        self.made.push(Particle {
            offset: world(at),
            sigma: (sigma * per_metre) as f32,
            reach: reach.map(world),
            area: (area * self.of.rain.look.opacity * per_metre * per_metre) as f32,
            rgb: [0.0; 3],
        });
        if self.made.len() == GROUP {
            self.flush();
        }
    }

    /// Lights what was made, and hands it over.
    fn flush(&mut self) {
        if self.made.is_empty() {
            return;
        }
        let mut group = ParticleGroup::of(&self.made);
        self.made.clear();
        let (of, center) = (self.of, Vec3::from_array(self.view.center.map(|v| v as f32)));
        let mut light = [[0.0f32; GROUP]; 3];
        for lane in 0..GROUP {
            let mut radiance = of.radiance;
            if let Some(lamps) = of.around.lamps.filter(|_| group.area[lane] > 0.0) {
                let offset = Vec3::from_array(group.offset.map(|axis| axis[lane]));
                let strength = of.rain.look.brightness as f32;
                radiance +=
                    strength * lamps.scattered(center, offset, DROP_ASYMMETRY, of.metres_per_unit as f32);
            }
            (0..3).for_each(|k| light[k][lane] = radiance[k]);
        }
        let air = of.around.air.seen_from(center.to_array());
        dispatch!(self.path, s => through_air(s, &air, of.metres_per_unit as f32, &light, &mut group));
        (self.take)(&group);
    }
}

/// Colours of a group as seen through the air.
#[inline(always)]
fn through_air<S: Lanes>(
    simd: S,
    air: &crate::optics::AirView<'_>,
    metres_per_unit: f32,
    light: &[[f32; GROUP]; 3],
    group: &mut ParticleGroup,
) {
    for first in (0..GROUP).step_by(S::N) {
        let offset = [0, 1, 2].map(|k| simd.load(&group.offset[k][first..]));
        let length = offset[0]
            .mul_add(offset[0], offset[1].mul_add(offset[1], offset[2] * offset[2]))
            .sqrt()
            .max(simd.set(1e-12));
        let direction = offset.map(|axis| axis / length);
        let own = [0, 1, 2].map(|k| simd.load(&light[k][first..]));
        let seen = air.through(simd, length * metres_per_unit, &direction, own);
        for k in 0..3 {
            seen[k].store_slice(&mut group.rgb[k][first..first + S::N]);
        }
    }
}
