//! The drops on the glass at an instant.

use super::flux::GlassRain;
use super::glass::Glass;
use rayon::prelude::*;
use std::f64::consts::TAU;
use wm_base::random::{RandomSequence, bits};

/// Sides of the cells in which sitting and running drops land, m. A slot of their clocks is as long
/// as one lands in a cell.
pub(super) const SITTING_CELL_M: f64 = 0.01;
pub(super) const RUNNING_CELL_M: f64 = 0.04;
/// Share of the glass that all drops would cover which have landed in the time that is looked back.
/// Older ones have become part of others.
const COVERED_SHARE: f64 = 0.35;
/// Most running drops that are looked back for, a m^2.
const MOST_RUNS: f64 = 4000.0;
/// Share of its life over which a drop fades that merges into others.
const FADING_SHARE: f64 = 0.03;
/// Largest distance that a drop runs, m.
const MAX_RUN_M: f64 = 0.25;
/// Mean way that a drop of the least running radius runs, m, and its mean speed, m/s.
const MEAN_RUN_M: f64 = 0.08;
const MEAN_RUN_SPEED: f64 = 0.05;
/// Longest time that a drop sits before it runs, s.
const MAX_REST_S: f64 = 0.8;
/// Share of the points of its path at which a running drop leaves a small one.
const TRAIL_SHARE: f64 = 0.45;
/// Least radius of a drop that is not round, m.
const ROUND_RADIUS_M: f64 = 0.7e-3;

/// A drop on the glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GlassDrop {
    /// Centre, m to the right and down along the glass from the point on the view's axis.
    pub(crate) at: [f64; 2],
    /// Radius of its foot, m, across.
    pub(crate) radius: f64,
    /// Length down the glass over width.
    pub(crate) aspect: f64,
}

/// A drop that runs, or will.
#[derive(Clone, Copy, Debug)]
struct RunningDrop {
    start: [f64; 2],
    radius: f64,
    /// When it landed and when it starts, s.
    landed: f64,
    starts: f64,
    /// Length of its path, m.
    way: f64,
    speed: f64,
    /// Amplitude, m, wavenumber, 1/m, and phase of its meander.
    waves: [[f64; 3]; 2],
    /// Wavenumber, 1/m, and phase of its speed.
    slip: [f64; 2],
    key: u64,
    /// Share of its full age.
    life: f64,
}

impl RunningDrop {
    fn new(glass: &Glass, start: [f64; 2], landed: f64, radius: f64, random: &mut RandomSequence) -> Self {
        let size = (radius / glass.runs_from).powi(2).min(4.0);
        let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
        let down = glass.tilt.cos().max(0.2);
        let starts = landed + between(0.0, MAX_REST_S);
        let way = (0.012 - MEAN_RUN_M * size * (1.0 - between(0.0, 0.999)).ln()).min(MAX_RUN_M);
        let mut wave = |lengths: [f64; 2], heights: [f64; 2]| {
            [between(heights[0], heights[1]), TAU / between(lengths[0], lengths[1]), between(0.0, TAU)]
        };
        let waves = [wave([0.016, 0.035], [0.0003, 0.0012]), wave([0.05, 0.14], [0.001, 0.004])];
        let speed = MEAN_RUN_SPEED * down * size * between(0.5, 1.6);
        let slip = [TAU / between(0.008, 0.03), between(0.0, TAU)];
        let life = between(0.5, 1.0);
        Self { start, radius, landed, starts, way, speed, waves, slip, key: random.bits(), life }
    }

    /// The point after a way down the glass.
    fn at(&self, way: f64) -> [f64; 2] {
        let aside = |[high, k, phase]: [f64; 3]| high * ((k * way + phase).sin() - phase.sin());
        [self.start[0] + self.waves.map(aside).iter().sum::<f64>(), self.start[1] + way]
    }

    /// The instant at which it is there, s: it sticks and slips.
    fn passes(&self, way: f64) -> f64 {
        let [k, phase] = self.slip;
        self.starts + (way + 0.8 / k * ((k * way + phase).sin() - phase.sin())) / self.speed
    }

    /// Appends the points of its path that it has passed until an instant, every `step` metres from
    /// its start.
    fn follow(&self, step: f64, now: f64, path: &mut Vec<PathPoint>) {
        if now < self.starts {
            return;
        }
        let waves = [[self.waves[0][1], self.waves[0][2]], [self.waves[1][1], self.waves[1][2]], self.slip];
        let mut sines = waves.map(|[k, phase]| Sine::new(phase, k * step));
        let starts = waves.map(|[_, phase]| phase.sin());
        let lag = 0.8 / self.slip[0];
        let mut way = 0.0;
        while way < self.way {
            let [x0, x1, late] = [0, 1, 2].map(|i| sines[i].next() - starts[i]);
            let time = self.starts + (way + lag * late) / self.speed;
            if time > now {
                return;
            }
            let x = self.start[0] + self.waves[0][0] * x0 + self.waves[1][0] * x1;
            path.push(PathPoint { way, at: [x, self.start[1] + way], time });
            way += step;
        }
    }

    /// Radius after running a distance, since it leaves some water behind.
    fn radius(&self, way: f64) -> f64 {
        self.radius * (1.0 - 0.3 * way / self.way.max(1e-6))
    }
}

/// A point of a path, and when a drop passes it.
#[derive(Clone, Copy, Debug)]
struct PathPoint {
    way: f64,
    at: [f64; 2],
    time: f64,
}

/// A sine at even steps, by turning a pair of numbers.
struct Sine {
    now: [f64; 2],
    turn: [f64; 2],
}

impl Sine {
    fn new(phase: f64, step: f64) -> Self {
        let ((sin, cos), (by_sin, by_cos)) = (phase.sin_cos(), step.sin_cos());
        Self { now: [sin, cos], turn: [by_sin, by_cos] }
    }

    fn next(&mut self) -> f64 {
        let ([sin, cos], [by_sin, by_cos]) = (self.now, self.turn);
        self.now = [sin * by_cos + cos * by_sin, cos * by_cos - sin * by_sin];
        sin
    }
}

/// Times at which running drops last passed each cell of the glass, s.
struct WipeTimes {
    from: [f64; 2],
    cell: f64,
    size: [usize; 2],
    last: Vec<f32>,
    now: f64,
}

impl WipeTimes {
    fn new(bounds: [[f64; 2]; 2], cell: f64, now: f64) -> Self {
        let size = [0, 1].map(|k| ((bounds[1][k] - bounds[0][k]) / cell).ceil() as usize + 1);
        Self { from: bounds[0], cell, size, last: vec![f32::NEG_INFINITY; size[0] * size[1]], now }
    }

    fn row(&self, y: f64) -> Option<usize> {
        let row = ((y - self.from[1]) / self.cell).floor();
        (row >= 0.0 && row < self.size[1] as f64).then_some(row as usize)
    }

    /// Wipes a piece of a row.
    fn pass(&mut self, point: [f64; 2], radius: f64, time: f64) {
        let [x, y] = point;
        let Some(row) = self.row(y) else { return };
        let column = |x: f64| ((x - self.from[0]) / self.cell).clamp(0.0, (self.size[0] - 1) as f64) as usize;
        let time = (time - self.now) as f32;
        let (first, last) = (column(x - radius), column(x + radius));
        let row = &mut self.last[row * self.size[0]..][..self.size[0]];
        row[first..=last].iter_mut().for_each(|last| *last = last.max(time));
    }

    /// Returns true if what landed there then was wiped away since.
    fn wipes_drop(&self, point: [f64; 2], landed: f64) -> bool {
        let [x, y] = point;
        let Some(row) = self.row(y) else { return false };
        let column = ((x - self.from[0]) / self.cell).clamp(0.0, (self.size[0] - 1) as f64) as usize;
        self.last[row * self.size[0] + column] > (landed - self.now) as f32
    }
}

/// Landings of cells of one size: calls `take` with the place, the count of the clock and the
/// random numbers of each that is between two counts, in the part `rows` of the cells' rows.
pub(super) fn landings(
    seed: u64,
    cell: f64,
    columns: [i64; 2],
    row: i64,
    counts: [f64; 2],
    mut take: impl FnMut([f64; 2], f64, RandomSequence),
) {
    let slot = 1.0 / (cell * cell);
    let [first, last] = counts.map(|count| (count / slot).floor().max(0.0) as u64);
    for column in columns[0]..=columns[1] {
        let own = bits(seed, (row as u64) << 32 ^ (column as u64 & 0xffff_ffff));
        for index in first..=last {
            let mut random = RandomSequence::new(own ^ bits(index, 0x6c65_6e73));
            for _ in 0..poisson(random.uniform()) {
                let mut each = RandomSequence::new(random.bits());
                let count = (index as f64 + each.uniform()) * slot;
                if (counts[0]..counts[1]).contains(&count) {
                    let at = [column as f64 + each.uniform(), row as f64 + each.uniform()];
                    take(at.map(|v| v * cell), count, each);
                }
            }
        }
    }
}

/// A Poisson number of mean 1 by its share.
fn poisson(share: f64) -> u32 {
    let (mut number, mut part) = (0, 1.0 / std::f64::consts::E);
    let mut sum = part;
    while share >= sum && number < 12 {
        number += 1;
        part /= f64::from(number);
        sum += part;
    }
    number
}

/// Rows or columns of cells between two bounds, m.
pub(super) fn cells(from: f64, to: f64, cell: f64) -> [i64; 2] {
    [from, to].map(|v| (v / cell).floor() as i64)
}

/// Runs `make` for each row on all threads; results from the first row to the last.
fn in_rows<T: Send>(ends: [i64; 2], make: impl Fn(i64, &mut Vec<T>) + Sync + Send) -> Vec<Vec<T>> {
    let row = |row| {
        let mut found = Vec::new();
        make(row, &mut found);
        found
    };
    (ends[0]..=ends[1]).into_par_iter().map(row).collect()
}

/// Number of the latest small drops, a m^2, that are looked back for: older ones have become part
/// of others.
fn small_span(rain: &GlassRain) -> f64 {
    if rain.area() > 0.0 { COVERED_SHARE / rain.area() } else { f64::INFINITY }
}

/// Number of drops, a m^2, that are looked back for at the glass's instant.
pub(super) fn looked_for(glass: &Glass) -> f64 {
    let landed = glass.rain.landed(glass.time);
    landed.small.min(small_span(&glass.rain)) + landed.running.min(MOST_RUNS)
}

/// The drops on a part of the glass, m, at its instant, in an order that does not depend on the
/// part.
pub(crate) fn drops(glass: &Glass, bounds: [[f64; 2]; 2]) -> Vec<GlassDrop> {
    let (rain, now) = (&glass.rain, glass.time);
    if rain.is_dry(now) {
        return Vec::new();
    }
    let landed = rain.landed(now);
    let span = small_span(rain);
    let margin = 3.0 * glass.runs_from;
    let bounds = [bounds[0].map(|v| v - margin), bounds[1].map(|v| v + margin)];
    let on_glass = |at: [f64; 2]| (0..2).all(|k| (bounds[0][k]..bounds[1][k]).contains(&at[k]));
    let small_from = (landed.small - span).max(0.0);
    // A drop shrinks by the time without rain since it landed, and when its age is full.
    let age = |time: f64| landed.small - rain.landed(time).small;
    let left = |radius: f64, landed_at: f64, age: f64, life: f64| {
        let ending = 1.0 - age / (span * life);
        if ending <= 0.0 {
            return 0.0;
        }
        let dry = landed.dry - rain.landed(landed_at).dry;
        let kept = (radius * radius - 1e-6 * dry / glass.drying).max(0.0).sqrt();
        kept * (ending / FADING_SHARE).min(1.0).sqrt()
    };

    let reach = (bounds[1][1] - bounds[0][1]).clamp(0.01, MAX_RUN_M);
    let runs_from = rain.landed(rain.time_of_small(small_from)).running.max(landed.running - MOST_RUNS);
    let [first, last] = cells(bounds[0][1] - reach, bounds[1][1], RUNNING_CELL_M);
    let columns = cells(bounds[0][0] - 0.01, bounds[1][0] + 0.01, RUNNING_CELL_M);
    let runs: Vec<Vec<RunningDrop>> = in_rows([first, last], |row, runs| {
        let key = bits(glass.seed, 0x7275_6e73);
        landings(key, RUNNING_CELL_M, columns, row, [runs_from, landed.running], |at, count, mut random| {
            let time = rain.time_of_running(count);
            let radius = rain.radius(time, random.uniform(), true);
            runs.push(RunningDrop::new(glass, at, time, radius, &mut random));
        });
    });

    let longest = (bounds[1][0] - bounds[0][0]).max(bounds[1][1] - bounds[0][1]);
    let mut wiped = WipeTimes::new(bounds, glass.runs_from.max(longest / 256.0), now);
    let step = wiped.cell;
    let mut found = Vec::new();
    // Points of all paths that are passed already, and those of each.
    let mut paths: Vec<PathPoint> = Vec::new();
    let mut parts = Vec::new();
    for run in runs.iter().flatten() {
        let from = paths.len();
        run.follow(step, now, &mut paths);
        parts.push(from..paths.len());
        for point in &paths[from..] {
            wiped.pass(point.at, 0.9 * run.radius(point.way), point.time);
        }
    }
    for (run, part) in runs.iter().flatten().zip(parts) {
        let path = &paths[part];
        // What it leaves behind.
        for (index, pair) in path.windows(3).enumerate() {
            let random = |k: u64| bits(run.key, 4 * index as u64 + k) as f64 / 2f64.powi(64);
            if random(0) < TRAIL_SHARE {
                let [x, y] = pair[0].at;
                let at = [x + 0.4 * run.radius * (random(1) - 0.5), y + step * (random(2) - 0.5)];
                // When its tail has passed.
                let laid = pair[2].time;
                if on_glass(at) && !wiped.wipes_drop(at, laid) {
                    let share = random(3);
                    let radius =
                        left(run.radius * (0.09 + 0.2 * share * share), laid, age(laid), 0.3 * run.life);
                    found.extend((radius > 0.0).then_some(GlassDrop { at, radius, aspect: 1.2 }));
                }
            }
        }
        let end = run.passes(run.way);
        if now < run.starts || end <= now {
            let (at, radius, since) = match now < run.starts {
                true => (run.start, run.radius, run.landed),
                false => (run.at(run.way), run.radius(run.way), end),
            };
            // It does not wipe itself away.
            if on_glass(at) && !wiped.wipes_drop(at, since + 1e-3) {
                let radius = left(radius, run.landed, age(run.landed), run.life);
                found.extend((radius > 0.0).then_some(GlassDrop { at, radius, aspect: 1.25 }));
            }
            continue;
        }
        let last = path.last().map_or(0.0, |point| point.way);
        let [before, after] = [last, last + step].map(|way| run.passes(way));
        let way = (last + step * (now - before) / (after - before)).min(run.way);
        let radius = run.radius(way);
        for (behind, share) in [(0.0, 1.0), (0.95, 0.8), (1.8, 0.58), (2.6, 0.4)] {
            let at = run.at((way - behind * radius).max(0.0));
            if way >= 0.5 * behind * radius && on_glass(at) {
                found.push(GlassDrop { at, radius: share * radius, aspect: 1.15 });
            }
        }
    }

    let [first, last] = cells(bounds[0][1], bounds[1][1], SITTING_CELL_M);
    let columns = cells(bounds[0][0], bounds[1][0], SITTING_CELL_M);
    let sitting: Vec<Vec<GlassDrop>> = in_rows([first, last], |row, sitting| {
        let key = bits(glass.seed, 0x6472_6f70);
        landings(key, SITTING_CELL_M, columns, row, [small_from, landed.small], |at, count, mut random| {
            let life = 0.5 + 0.5 * random.uniform();
            let age = landed.small - count;
            if age > span * life || !on_glass(at) {
                return;
            }
            let time = rain.time_of_small(count);
            if wiped.wipes_drop(at, time) {
                return;
            }
            let radius = left(rain.radius(time, random.uniform(), false), time, age, life);
            if radius <= 0.0 {
                return;
            }
            let aspect = 0.92 + 0.2 * random.uniform();
            sitting.push(GlassDrop { at, radius, aspect });
            if radius > ROUND_RADIUS_M && random.uniform() < 0.6 {
                let (sin, cos) = (TAU * random.uniform()).sin_cos();
                let (far, share) = (0.6 * radius, 0.45 + 0.3 * random.uniform());
                let at = [at[0] + far * cos, at[1] + far * sin];
                sitting.push(GlassDrop { at, radius: share * radius, aspect });
            }
        });
    });
    found.extend(sitting.into_iter().flatten());
    found
}
