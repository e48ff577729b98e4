//! Measures precipitation from the drawn drops or from the field that they are drawn from.

use super::*;
use crate::effects::EFFECTS;
use crate::particles::near::each_particle;
use crate::particles::{ParticleAppearance, PrecipitationKind, RAIN, SNOW};
use crate::shelter::Occluders;
use crate::testing;
use glam::DVec3;
use wm_scene::Camera;

const SITE: Site = Site { metres_per_unit: 0.5, ..testing::SITE };

fn precipitation(kind: &'static PrecipitationKind, rate: f64, seed: u64) -> Precipitation {
    Precipitation::new(kind, rate, [0.8; 3], ParticleAppearance { seed, ..ParticleAppearance::default() })
}

/// Clear air: drops keep their own light.
fn air() -> Atmosphere {
    Atmosphere::new(Vec::new(), SITE)
}

/// Clear air without wind, roofs and lamps, at time 0.
fn around<'a>() -> Surroundings<'a> {
    let (air, wind) = (Arc::new(air()), WindSample::default());
    Surroundings { site: &SITE, air, shelter: None, lamps: None, wind, velocity: [0.0; 3], time: 0.0 }
}

fn still<'a>(precipitation: &'a Precipitation, air: &Atmosphere) -> FallingParticles<'a> {
    FallingParticles::new(precipitation, Surroundings { air: Arc::new(air.clone()), ..around() })
}

fn camera(size: (u32, u32)) -> Camera {
    // Metres 3, 4 and 2.
    let eye = DVec3::new(6.0, 8.0, 4.0);
    Camera::looking(size, 50.0, eye, eye + DVec3::new(1.0, 0.3, 0.05), DVec3::Z).unwrap()
}

/// The points of a cube below a threshold: where in it, 0-1, and the number that their size goes
/// by.
#[inline(always)]
fn points<S: Lanes>(simd: S, cells: &Cells, cell: [i64; 3], most: f32) -> Vec<([f64; 3], f64)> {
    let (mut points, mut found) = (cells.begin(), Vec::new());
    let most = most.min(cells.thresholds[1] as f32);
    while points.last < most {
        cells.next(simd, cell, &mut points);
        for first in (0..GROUP).step_by(S::N) {
            let numbers = uniform(simd, cells.own(simd, cell, &points, first, 1)[0]);
            for lane in (0..S::N).filter(|lane| points.threshold[first + lane] < most) {
                found
                    .push((points.place.map(|axis| f64::from(axis[first + lane])), f64::from(numbers[lane])));
            }
        }
    }
    found
}

/// All drops of one class that are there and whose field coordinates lie in a box, m: diameters.
fn drops(fall: &FallingParticles<'_>, class: usize, low: [f64; 3], high: [f64; 3]) -> Vec<f64> {
    let this = fall.precipitation;
    let share = this.numbers[class] / this.reference[class];
    let tiers = (0..).map(|tier| fall.cells_of(class, tier));
    let tiers = tiers.take_while(|cells| cells.thresholds[0] < share);
    tiers.flat_map(|cells| drops_of(fall, class, share, &cells, low, high)).collect()
}

/// Drops of one tier up to a threshold.
fn drops_of(
    fall: &FallingParticles<'_>,
    class: usize,
    share: f64,
    cells: &Cells,
    low: [f64; 3],
    high: [f64; 3],
) -> Vec<f64> {
    let index = |v: f64| (v / cells.edge).floor() as i64;
    let (path, mut found) = (SimdPath::available()[0], Vec::new());
    for x in index(low[0])..=index(high[0]) {
        for y in index(low[1])..=index(high[1]) {
            for z in index(low[2])..=index(high[2]) {
                let corner = [x, y, z].map(|v| v as f64 * cells.edge);
                for (place, number) in dispatch!(path, s => points(s, cells, [x, y, z], share as f32)) {
                    let is_in =
                        (0..3).all(|k| (low[k]..high[k]).contains(&(corner[k] + cells.edge * place[k])));
                    if is_in {
                        found.push(fall.precipitation.classes[class].diameter(number));
                    }
                }
            }
        }
    }
    found
}

/// Every kind brings its rate into a gauge of 6 m by 6 m or more in 10 s: the drops that come past
/// its height in that time.
#[test]
fn a_gauge_catches_what_is_asked() {
    let usual = [(&RAIN, vec![1.0, 10.0, 50.0]), (&SNOW, vec![0.5, 2.0, 5.0])];
    let kinds = EFFECTS.iter().filter_map(|effect| effect.precipitation);
    let every = kinds.map(|kind| (kind, vec![kind.reference_rate, 2.0 * kind.reference_rate]));
    for (kind, rates) in usual.into_iter().chain(every) {
        for rate in rates {
            let (precipitation, air) = (precipitation(kind, rate, 4), air());
            let fall = still(&precipitation, &air);
            // Few large ones need a larger gauge.
            let side = if precipitation.numbers.iter().sum::<f64>() < 50.0 { 24.0 } else { 6.0 };
            let mut water = 0.0;
            for (index, class) in precipitation.classes.iter().enumerate() {
                // In the field they stand still and the gauge rises past them.
                let high = [side, side, 10.0 * class.fall_speed];
                let caught = drops(&fall, index, [0.0; 3], high);
                water += caught.iter().map(|d| PI / 6.0 * d.powi(3)).sum::<f64>();
            }
            // mm^3 on that area in 10 s.
            let found = water * 1e-6 / (side * side) * 360.0;
            assert!((found / rate - 1.0).abs() < 0.05, "{} {rate}: {found}", kind.name);
        }
    }
}

/// Kolmogorov and Smirnov's distance of 100,000 diameters from Marshall and Palmer's own law
/// between its ends.
#[test]
fn sizes_follow_the_law() {
    let mut worst: f64 = 0.0;
    for seed in 0..5 {
        let (precipitation, air) = (precipitation(&RAIN, 10.0, seed), air());
        let fall = still(&precipitation, &air);
        let mut sizes: Vec<f64> =
            (0..RAIN.classes).flat_map(|class| drops(&fall, class, [0.0; 3], [5.2, 5.2, 5.2])).collect();
        assert!((90_000..130_000).contains(&sizes.len()), "{}", sizes.len());
        sizes.sort_by(f64::total_cmp);
        let slope = 4.1 * 10f64.powf(-0.21);
        let [least, most] = RAIN.diameters;
        let below = |d: f64| {
            ((-slope * least).exp() - (-slope * d).exp()) / ((-slope * least).exp() - (-slope * most).exp())
        };
        let count = sizes.len() as f64;
        let off = sizes.iter().enumerate().map(|(i, d)| (below(*d) - (i as f64 + 0.5) / count).abs());
        worst = worst.max(off.fold(0.0, f64::max));
    }
    assert!(worst < 0.01, "{worst}");
}

/// Returns the drops of a view.
fn gathered(fall: &FallingParticles<'_>, view: &ParticleView) -> Vec<Particle> {
    let mut out = Vec::new();
    each_particle(fall, SimdPath::available()[0], view, |particle| out.push(particle));
    out
}

/// The drops of a frame.
fn frame(precipitation: &Precipitation, camera: &Camera, time: f64, wind: WindSample) -> Vec<Particle> {
    let fall = FallingParticles::new(precipitation, Surroundings { wind, time, ..around() });
    gathered(&fall, &ParticleView::new(camera))
}

/// A place in the world, m.
fn place(particle: &Particle, camera: &Camera) -> DVec3 {
    (camera.center() + DVec3::from_array(particle.offset.map(f64::from))) * SITE.metres_per_unit
}

/// Counts the drops of `first` that have one in `second` where they should be `step` s later, of
/// those that still should be in view and are more than a faint rest; and how many there are of
/// these.
fn followed(
    first: &[Particle],
    second: &[Particle],
    cameras: [&Camera; 2],
    step: f64,
    off: f64,
) -> (usize, usize) {
    let mut grid: std::collections::HashMap<[i64; 3], Vec<DVec3>> = std::collections::HashMap::new();
    let cell = |p: DVec3| p.to_array().map(|v| (v / 0.1).floor() as i64);
    for particle in second {
        let at = place(particle, cameras[1]);
        grid.entry(cell(at)).or_default().push(at);
    }
    let (mut found, mut all) = (0, 0);
    for particle in first {
        // The streak is the way in the exposure.
        let velocity = DVec3::from_array(particle.reach[0].map(f64::from)) * SITE.metres_per_unit
            / (LINE_SIGMA_RATIO / 60.0);
        let at = place(particle, cameras[0]) + velocity * step;
        let inside = |camera: &Camera| {
            let seen = camera.project(at / SITE.metres_per_unit);
            let far = (at / SITE.metres_per_unit - camera.center()).length() * SITE.metres_per_unit;
            // Those whose cover shows that they are whole: of a disc it is pi / 4 of the square of
            // its width.
            let width = f64::from(particle.sigma) / DISC_SIGMA_RATIO;
            let whole = f64::from(particle.area) > 0.99 * PI / 4.0 * width * width;
            let size = width / (far / SITE.metres_per_unit) * camera.fx;
            let border = 10.0;
            seen.is_some_and(|(x, y, _)| {
                x > border
                    && y > border
                    && x < f64::from(camera.width) - border
                    && y < f64::from(camera.height) - border
            }) && whole
                && size > 1.3 * MIN_DROP_WIDTH_PX
                && far > 0.3
        };
        if !inside(cameras[1]) {
            continue;
        }
        all += 1;
        let [x, y, z] = cell(at);
        let near =
            (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| [x + a, y + b, z + c])));
        found += usize::from(near.filter_map(|key| grid.get(&key)).flatten().any(|p| p.distance(at) < off));
    }
    (found, all)
}

#[test]
fn two_cameras_see_the_same_drops_and_they_go_on_falling() {
    let rain = precipitation(&RAIN, 10.0, 2);
    let wind_now = WindSample { drift: [7.0, 3.0], wind: [3.0, -1.0], mean: [3.0, -1.0] };
    let (small, large) = (camera((300, 200)), camera((900, 600)));
    let first = frame(&rain, &small, 5.0, wind_now);
    // A larger picture sees the same drops and more, farther away.
    let more = frame(&rain, &large, 5.0, wind_now);
    let (found, all) = followed(&first, &more, [&small, &large], 0.0, 1e-4);
    assert!(found == all && all > 50 && more.len() > 5 * first.len(), "{found} of {all}, {}", more.len());
    // From elsewhere, and 0.02 s later.
    let mut beside = large;
    beside.viewmat = glam::DMat4::from_translation(DVec3::new(0.4, 0.1, 0.0)) * beside.viewmat;
    let later = WindSample { drift: [7.0 + 0.06, 3.0 - 0.02], ..wind_now };
    let second = frame(&rain, &beside, 5.02, later);
    let (found, all) = followed(&more, &second, [&large, &beside], 0.02, 2e-3);
    assert!(found == all && all > 1000, "{found} of {all}");
}

#[test]
fn ramps_move_nothing() {
    let (wide, step) = (camera((900, 600)), 1.0 / 30.0);
    for (kind, rates) in [(&RAIN, [8.0, 12.0]), (&RAIN, [12.0, 8.0]), (&SNOW, [0.5, 0.7])] {
        let falls = rates.map(|rate| precipitation(kind, rate, 1));
        let first = frame(&falls[0], &wide, 3.0, WindSample::default());
        let second = frame(&falls[1], &wide, 3.0 + step, WindSample::default());
        let (found, all) = followed(&first, &second, [&wide, &wide], step, 4e-3);
        let share = found as f64 / all as f64;
        // As many stay as the rates say, and those that stay are where their speed takes them.
        let least = if rates[1] > rates[0] { 0.99 } else { 0.6 };
        assert!(share > least && all > 100, "{} {rates:?}: {found} of {all}", kind.name);
    }
}

#[test]
fn roofs_keep_dry_what_is_below() {
    use wm_scene::synthetic::Builder;
    let mut place_of = Builder::new(1);
    // A roof at 6 units over all that the camera sees, but for a side.
    place_of.surface(DVec3::new(-20.0, -20.0, 6.0), DVec3::X * 80.0, DVec3::Y * 30.0, 0.1, |_, _| [0.5; 3]);
    place_of.surface(DVec3::new(-20.0, -20.0, 0.0), DVec3::X * 80.0, DVec3::Y * 60.0, 0.4, |_, _| [0.5; 3]);
    let splats = place_of.build();
    let shelter = Occluders::of(&splats, &SITE, &Default::default()).shelter([0.0, 0.0, -1.0]);
    let (rain, camera) = (precipitation(&RAIN, 20.0, 0), camera((900, 600)));
    let view = ParticleView::new(&camera);
    let [open, dry] = [None, Some(&shelter)].map(|shelter| {
        gathered(&FallingParticles::new(&rain, Surroundings { shelter, time: 1.0, ..around() }), &view)
    });
    let under = |list: &[Particle]| {
        let is_under = |p: &&Particle| {
            let at = place(p, &camera) / SITE.metres_per_unit;
            at.y < 9.5 && at.z < 5.5
        };
        list.iter().filter(is_under).count()
    };
    assert!(under(&open) > 1000 && under(&dry) == 0, "{} {}", under(&open), under(&dry));
    assert!(dry.len() > 100, "{}", dry.len());
}

/// The air leaves out exactly the part of the law that is drawn up to a distance.
#[test]
fn drops_and_air_together_are_the_law() {
    for (kind, rate, size) in [(&RAIN, 25.0, (900, 600)), (&SNOW, 2.5, (900, 600))] {
        let (camera, falling) = (camera(size), precipitation(kind, rate, 3));
        let view = ParticleView::new(&camera);
        let residual = falling.residual(f64::from(view.pixels()));
        let mut off = Vec::new();
        let times = 48;
        let frames: Vec<_> = (0..times)
            .map(|time| frame(&falling, &camera, f64::from(time) * 1.7, WindSample::default()))
            .collect();
        for metres in [1.0, 3.0, 8.0, 20.0] {
            // Cover of the drops up to there as solid angle, over that of the picture, averaged
            // over times.
            let mut cover = 0.0;
            for particle in frames.iter().flatten() {
                let offset = DVec3::from_array(particle.offset.map(f64::from));
                let local = camera.rotation() * offset;
                let (x, y) =
                    (camera.fx * local.x / local.z + camera.cx, camera.fy * local.y / local.z + camera.cy);
                let inside = local.z > 0.0
                    && (0.0..f64::from(size.0)).contains(&x)
                    && (0.0..f64::from(size.1)).contains(&y);
                if inside && offset.length() * SITE.metres_per_unit < metres {
                    cover += f64::from(particle.area) / offset.length_squared();
                }
            }
            let step = 8;
            let mut angle = 0.0;
            for (x, y) in
                (0..size.1).step_by(step).flat_map(|y| (0..size.0).step_by(step).map(move |x| (x, y)))
            {
                let ray = camera.rotation() * camera.ray(f64::from(x) + 4.0, f64::from(y) + 4.0);
                angle += ray.z.powi(3) * (step * step) as f64 / (camera.fx * camera.fy);
            }
            let drawn = cover / (f64::from(times) * angle);
            let wanted = residual.depth(metres);
            let law = falling.layer().sigma_t[1] * metres;
            println!("{} {metres} m: {drawn:.5} drawn, {wanted:.5} left out of {law:.5}", kind.name);
            if (drawn - wanted).abs() > 0.02 * law {
                off.push(metres);
            }
        }
        assert!(off.is_empty(), "{}: {off:?}", kind.name);
    }
}
