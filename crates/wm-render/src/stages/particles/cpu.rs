//! Particles on the CPU: gathered and laid out over threads, added up patch by patch.

use super::{DILATION, LEAST, PEAK, SHORTEST, STEPS, WIDEST};
use crate::dispatch;
use crate::frame::MIN_ALPHA;
use crate::hooks::{PATCH, PATCH_PIXELS, Particle, ParticleView, Particles};
use crate::simd::{Lanes, SimdPath, exp2, srgb_decode, srgb_encode};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use rayon::prelude::*;
use std::f32::consts::{LN_2, LOG2_E, TAU};
use std::ops::Range;
use std::time::Instant;

/// A particle in the picture: `log2 tau = peak - (a dx)^2 - (b dy + c dx)^2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drop {
    /// Centre, px.
    pub mean2d: [f32; 2],
    /// Half the size of its bounding box, px.
    pub extent: [f32; 2],
    a: f32,
    b: f32,
    c: f32,
    /// log2 of the optical depth at its centre.
    peak: f32,
    /// View z, scene units.
    pub depth: f32,
    /// Linear RGB.
    pub rgb: [f32; 3],
}

impl Drop {
    /// The particle in the picture; `None` where it is not in it.
    #[inline]
    #[must_use]
    pub fn project(particle: &Particle, view: &ParticleView) -> Option<Self> {
        let dot = |a: &[f32; 3], b: &[f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let [x, y, z] = [0, 1, 2].map(|k| dot(&view.rotation[k], &particle.offset));
        if z <= view.near {
            return None;
        }
        let (tan_x, tan_y) = (x / z, y / z);
        let row = |k: usize, tan: f32| {
            let scale = view.focal[k] / z;
            [0, 1, 2].map(|i| scale * (view.rotation[k][i] - tan * view.rotation[2][i]))
        };
        let (jx, jy) = (row(0, tan_x), row(1, tan_y));
        let variance = particle.sigma * particle.sigma;
        let mut xx = variance * dot(&jx, &jx);
        let mut xy = variance * dot(&jx, &jy);
        let mut yy = variance * dot(&jy, &jy);
        // The determinant without cancellation: needles have next to none. `wedge` adds the squares of the
        // areas that pairs of directions span.
        let reach = particle.reach.map(|reach| [dot(&jx, &reach), dot(&jy, &reach)]);
        let mut det = xx * yy - xy * xy;
        for [rx, ry] in reach {
            det += xx * ry * ry - 2.0 * xy * rx * ry + yy * rx * rx;
        }
        let wedge = reach[0][0] * reach[1][1] - reach[0][1] * reach[1][0];
        for [rx, ry] in reach {
            xx += rx * rx;
            xy += rx * ry;
            yy += ry * ry;
        }
        det = (det + wedge * wedge).max(0.0) + DILATION * (xx + yy) + DILATION * DILATION;
        xx += DILATION;
        yy += DILATION;
        let pixels = view.focal[0] * view.focal[1] / (z * z) * (1.0 + tan_x * tan_x + tan_y * tan_y).sqrt();
        let whole = (particle.area * pixels / (TAU * det.sqrt())).min(WIDEST);
        let [a, b, c, d] = PEAK;
        // ln(p / w), and log2 p.
        let steeper = whole * (a + whole * (b + whole * (c + whole * d)));
        let peak = whole.log2() + steeper * LOG2_E;
        let radius2 = (2.0 * LN_2 * (peak - LEAST_LOG2)).max(SHORTEST);
        // What lies beyond falls off as the Gaussian does: to the least, or to that of the shortest radius.
        let beyond = if radius2 > SHORTEST { LEAST / whole } else { (1.0 + steeper) * BEYOND_SHORTEST };
        let peak = (peak - (1.0 - beyond).log2()).min(MOST_LOG2);
        let extent = [(radius2 * xx).sqrt(), (radius2 * yy).sqrt()];
        let mean2d = [view.focal[0] * tan_x + view.principal[0], view.focal[1] * tan_y + view.principal[1]];
        let is_in = |k: usize| mean2d[k] + extent[k] > 0.0 && mean2d[k] - extent[k] < view.size[k];
        // Written so that NaN is not in it.
        if !(is_in(0) && is_in(1) && peak > -40.0 && det.is_finite()) {
            return None;
        }
        let half = (0.5 * LOG2_E).sqrt();
        let b = half * (xx / det).sqrt();
        Some(Self {
            mean2d,
            extent,
            a: half / xx.sqrt(),
            b,
            c: -b * xy / xx,
            peak,
            depth: z,
            rgb: particle.rgb.map(|v| v.clamp(0.0, BRIGHTEST)),
        })
    }

    /// The patches that its bounding box touches, columns and rows of a grid.
    fn patches(&self, (columns, rows): (usize, usize)) -> (Range<usize>, Range<usize>) {
        let range = |k: usize, count: usize| {
            let low = ((self.mean2d[k] - self.extent[k]) / PATCH as f32).max(0.0) as usize;
            let high = ((self.mean2d[k] + self.extent[k]) / PATCH as f32).max(0.0) as usize + 1;
            low.min(count)..high.min(count)
        };
        (range(0, columns), range(1, rows))
    }

    /// Calls `hit` with each patch of a grid that its ellipse touches.
    fn each_patch(&self, grid: (usize, usize), mut hit: impl FnMut(usize)) {
        let (columns, rows) = self.patches(grid);
        let slope = -self.c / self.b;
        for row in rows {
            if columns.len() == 1 {
                hit(row * grid.0 + columns.start);
                continue;
            }
            let top = (row * PATCH) as f32 - self.mean2d[1];
            let (low, high) = self.span(top, top + PATCH as f32, slope);
            for column in columns.clone() {
                let left = (column * PATCH) as f32 - self.mean2d[0];
                if left < high && left + PATCH as f32 > low {
                    hit(row * grid.0 + column);
                }
            }
        }
    }

    /// Least and greatest x of the ellipse between two heights, px from its centre.
    fn span(&self, top: f32, bottom: f32, slope: f32) -> (f32, f32) {
        let [rx, ry] = self.extent;
        // At its rightmost point y is `slope rx`: the regression of y on x.
        let outer = slope * rx;
        let right = if (top..=bottom).contains(&outer) {
            rx
        } else {
            self.chord(nearest(outer, top, bottom), ry, slope).1
        };
        let left = if (top..=bottom).contains(&-outer) {
            -rx
        } else {
            self.chord(nearest(-outer, top, bottom), ry, slope).0
        };
        (left, right)
    }

    /// Left and right end at a height, px from its centre.
    fn chord(&self, y: f32, ry: f32, slope: f32) -> (f32, f32) {
        let rx = self.extent[0];
        // The regression of x on y, and what is left of its spread.
        let back = slope * (rx / ry) * (rx / ry);
        let inside = (1.0 - (y / ry) * (y / ry)).max(0.0);
        let rest = (rx * rx - back * back * ry * ry).max(0.0);
        let half = (inside * rest).sqrt();
        (back * y - half, back * y + half)
    }
}

fn nearest(y: f32, top: f32, bottom: f32) -> f32 {
    if y < top { top } else { bottom }
}

/// The particles of a frame, patch by patch. Kept from frame to frame for its memory.
#[derive(Debug, Default)]
pub struct Falling {
    drops: Vec<Drop>,
    /// Where the list of each patch begins, and the end of the last.
    bounds: Vec<u32>,
    lists: Vec<u32>,
    grid: (usize, usize),
}

impl Falling {
    /// Whether nothing falls.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.drops.is_empty()
    }

    /// Number of particles in the picture.
    #[must_use]
    pub fn len(&self) -> usize {
        self.drops.len()
    }

    /// Gathers what `sources` let fall and finds the patches; returns the time of all threads, s.
    pub fn fill(&mut self, sources: &[&dyn Particles], view: &ParticleView) -> f64 {
        self.drops.clear();
        if sources.is_empty() {
            return 0.0;
        }
        self.grid = ((view.size[0] as usize).div_ceil(PATCH), (view.size[1] as usize).div_ceil(PATCH));
        let patches = self.grid.0 * self.grid.1;
        let work: Vec<(usize, [i32; 4])> = sources
            .iter()
            .enumerate()
            .flat_map(|(source, particles)| particles.parts(view).into_iter().map(move |part| (source, part)))
            .collect();
        let grid = self.grid;
        let parts: Vec<(Vec<Drop>, Vec<[u32; 2]>, f64)> = work
            .par_iter()
            .map_init(Vec::new, |particles: &mut Vec<Particle>, (source, part)| {
                let begun = Instant::now();
                particles.clear();
                sources[*source].gather(view, *part, particles);
                let drops: Vec<Drop> = particles.iter().filter_map(|p| Drop::project(p, view)).collect();
                let mut pairs = Vec::with_capacity(2 * drops.len());
                for (index, drop) in drops.iter().enumerate() {
                    drop.each_patch(grid, |patch| pairs.push([patch as u32, index as u32]));
                }
                (drops, pairs, begun.elapsed().as_secs_f64())
            })
            .collect();
        let laying = Instant::now();
        // A counting sort by one thread: atomics of several cost many times as much.
        self.bounds.clear();
        self.bounds.resize(patches + 2, 0);
        for [patch, _] in parts.iter().flat_map(|(_, pairs, _)| pairs) {
            self.bounds[*patch as usize + 2] += 1;
        }
        for patch in 2..patches + 2 {
            self.bounds[patch] += self.bounds[patch - 1];
        }
        self.lists.clear();
        self.lists.resize(self.bounds[patches + 1] as usize, 0);
        for (drops, pairs, _) in &parts {
            let first = self.drops.len() as u32;
            self.drops.extend_from_slice(drops);
            for [patch, index] in pairs {
                // The place of the next entry, and in the end where the next list begins.
                let place = &mut self.bounds[*patch as usize + 1];
                self.lists[*place as usize] = first + index;
                *place += 1;
            }
        }
        parts.iter().map(|(_, _, seconds)| seconds).sum::<f64>() + laying.elapsed().as_secs_f64()
    }

    /// Draws what falls in patch `(column, row)` over its pixels: display-referred colour, and behind it coverage and sum
    /// of weight times view z, row by row. `apart`, if given, holds zeros, and takes the linear light of what falls and
    /// its coverage.
    pub fn draw(
        &self,
        path: SimdPath,
        (column, row): (usize, usize),
        rgb: &mut [[f32; PATCH_PIXELS]; 3],
        behind: (&[f32; PATCH_PIXELS], &[f32; PATCH_PIXELS]),
        apart: Option<&mut [[f32; PATCH_PIXELS]; 4]>,
    ) {
        if self.is_empty() || column >= self.grid.0 || row >= self.grid.1 {
            return;
        }
        let patch = row * self.grid.0 + column;
        let list = &self.lists[self.bounds[patch] as usize..self.bounds[patch + 1] as usize];
        if list.is_empty() {
            return;
        }
        let corner = [(column * PATCH) as f32, (row * PATCH) as f32];
        dispatch!(path, s => draw(s, &self.drops, list, corner, rgb, behind, apart));
    }
}

/// What falls in one patch, in whole numbers of an optical depth, block by block: a vector is four columns of some rows, as in
/// [`crate::stages::rasterize`], since streaks are thin.
#[repr(C, align(64))]
struct Sums {
    tau: [u32; PATCH_PIXELS],
    rgb: [[u32; PATCH_PIXELS]; 3],
    /// View z of the scene, infinite where there is none.
    depth: [f32; PATCH_PIXELS],
    /// What the scene leaves open.
    open: [f32; PATCH_PIXELS],
}

#[inline(always)]
fn draw<S: Lanes>(
    simd: S,
    drops: &[Drop],
    list: &[u32],
    corner: [f32; 2],
    rgb: &mut [[f32; PATCH_PIXELS]; 3],
    (alpha, depth_sum): (&[f32; PATCH_PIXELS], &[f32; PATCH_PIXELS]),
    mut apart: Option<&mut [[f32; PATCH_PIXELS]; 4]>,
) {
    let zero = [0; PATCH_PIXELS];
    let mut sums =
        Sums { tau: zero, rgb: [zero; 3], depth: [f32::INFINITY; PATCH_PIXELS], open: [1.0; PATCH_PIXELS] };
    for i in 0..PATCH_PIXELS {
        let to = in_blocks::<S>(i);
        if alpha[i] >= MIN_ALPHA {
            sums.depth[to] = depth_sum[i] / alpha[i];
        }
        sums.open[to] = 1.0 - alpha[i];
    }
    for entry in list {
        add(simd, &drops[*entry as usize], corner, &mut sums);
    }
    for block in 0..PATCH_PIXELS / S::N {
        let at = block * S::N;
        let steps = whole(simd, &sums.tau[at..]);
        if !steps.simd_gt(simd.set(0.0)).any_true() {
            continue;
        }
        // The block's pixels lie four by four in the rows of the patch.
        let (height, mut four) = (S::N / 4, [0.0; 16]);
        let corner = block / 4 * height * PATCH + block % 4 * 4;
        let mut gather = |from: &[f32; PATCH_PIXELS]| {
            for row in 0..height {
                four[4 * row..4 * row + 4].copy_from_slice(&from[corner + row * PATCH..][..4]);
            }
            simd.load(&four)
        };
        let scatter = |value: S::F, to: &mut [f32; PATCH_PIXELS]| {
            for (row, four) in value.as_slice().chunks_exact(4).enumerate() {
                to[corner + row * PATCH..][..4].copy_from_slice(four);
            }
        };
        let kept = exp2(simd, [(steps * (-LOG2_E / STEPS)).max(simd.set(-126.0))])[0];
        let share = (simd.set(1.0) - kept) / steps.max(simd.set(1.0));
        let mut color = [simd.set(0.0); 3];
        for k in 0..3 {
            color[k] = gather(&rgb[k]);
        }
        let mut seen = srgb_decode(simd, color);
        for k in 0..3 {
            let light = whole(simd, &sums.rgb[k][at..]) * share;
            seen[k] = seen[k].mul_add(kept, light);
            if let Some(apart) = &mut apart {
                scatter(light, &mut apart[k]);
            }
        }
        if let Some(apart) = &mut apart {
            scatter(simd.set(1.0) - kept, &mut apart[3]);
        }
        let shown = srgb_encode(simd, seen);
        for k in 0..3 {
            scatter(shown[k], &mut rgb[k]);
        }
    }
}

/// The first N of `values` as floats: by halves, each as the mantissa of 2^23.
#[inline(always)]
fn whole<S: Lanes>(simd: S, values: &[u32]) -> S::F {
    let bits = S::U::from_slice(simd, &values[..S::N]);
    let float = |half: S::U| S::F::from_bits(half | S::U::splat(simd, 0x4b00_0000)) - 8_388_608.0;
    float(bits >> 16).mul_add(simd.set(65536.0), float(bits & S::U::splat(simd, 0xffff)))
}

/// log2 of [`LEAST`] and [`super::MOST`].
const LEAST_LOG2: f32 = -10.0;
const MOST_LOG2: f32 = 4.0;
/// `exp(-SHORTEST / 2)`.
const BEYOND_SHORTEST: f32 = 0.049_787_07;
/// Brightest that a particle may be: what whole numbers hold.
const BRIGHTEST: f32 = 3.0;
/// Adding it to a number below 2^22 leaves the rounded whole number in the low bits.
const ROUND: f32 = 12_582_912.0;

#[inline(always)]
fn add<S: Lanes>(simd: S, drop: &Drop, corner: [f32; 2], sums: &mut Sums) {
    let [dx, dy] = [0, 1].map(|k| corner[k] + 0.5 - drop.mean2d[k]);
    let first = (-dy - drop.extent[1]).ceil().max(0.0) as usize;
    let last = ((-dy + drop.extent[1]).floor() + 1.0).clamp(0.0, PATCH as f32) as usize;
    let left = (-dx - drop.extent[0]).max(0.0);
    let right = (-dx + drop.extent[0]).min((PATCH - 1) as f32);
    if right < 0.0 || left > (PATCH - 1) as f32 {
        return;
    }
    let round = simd.set(ROUND);
    let bits = |value: S::F| value.to_bits();
    let depth = simd.set(drop.depth);
    // Below this it ends: its radius, as a power of two.
    let (rx, a) = (drop.extent[0], drop.a);
    let end = simd.set(drop.peak - (a * rx) * (a * rx));
    let height = S::N / 4;
    let (columns, rows) = (simd.load(&COLUMNS), simd.load(&ROWS));
    for band in first / height..last.div_ceil(height) {
        let y = rows + (dy + (band * height) as f32);
        for block in left as usize / 4..right as usize / 4 + 1 {
            let x = columns + (dx + (4 * block) as f32);
            let u = x * drop.a;
            let v = x.mul_add(simd.set(drop.c), y * drop.b);
            let exponent = simd.set(drop.peak) - u.mul_add(u, v * v);
            let inside = exponent.simd_ge(end);
            if !inside.any_true() {
                continue;
            }
            let at = (4 * band + block) * S::N;
            let z = simd.load(&sums.depth[at..]);
            let open = depth.simd_lt(z).select(simd.set(STEPS), simd.load(&sums.open[at..]) * STEPS);
            let tau = exp2(simd, [exponent.max(simd.set(-126.0))])[0] * open;
            let tau = inside.select(tau, simd.set(0.0)).max(simd.set(0.0));
            let put = |value: S::F, to: &mut [u32; PATCH_PIXELS]| {
                let to = &mut to[at..at + S::N];
                let sum = S::U::from_slice(simd, to) + (bits(value + round) - bits(round));
                sum.store_slice(to);
            };
            put(tau, &mut sums.tau);
            for k in 0..3 {
                put(tau * drop.rgb[k], &mut sums.rgb[k]);
            }
        }
    }
}

/// Where pixel `index` of a patch, counted row by row, lies among its blocks.
#[inline(always)]
fn in_blocks<S: Lanes>(index: usize) -> usize {
    let (column, row, height) = (index % PATCH, index / PATCH, S::N / 4);
    (row / height * 4 + column / 4) * S::N + row % height * 4 + column % 4
}

/// Columns and rows of the lanes of a block.
const COLUMNS: [f32; 16] = [0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0];
const ROWS: [f32; 16] = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0];
