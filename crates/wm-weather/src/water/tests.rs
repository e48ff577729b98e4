use super::fft::{TILE_SIDE_NODES, transform};
use super::map::{WaterNode, WaterSample, higher};
use super::motion::WaterForces;
use super::ripples::{RING_SPEED, WAVE_NUMBER, large_drops, slope_rms};
use super::waves::{WindWaves, frequency};
use super::*;
use crate::Site;
use crate::wetness::WaterState;
use crate::wetness::state::WaterBudget;
use std::sync::Arc;
use wm_base::random::uniform;
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};
use wm_scene::Camera;

impl WaterMap {
    /// The water at a place, metres along the level axes; `None` where none is known. It may hide
    /// nothing.
    pub(crate) fn at(&self, x: f64, y: f64) -> Option<WaterSample> {
        higher(self.plane(), self.grid().and_then(|grid| grid.at(x, y)))
    }
}

impl WaterGrid {
    fn at(&self, x: f64, y: f64) -> Option<WaterSample> {
        let [u, v] = self.steps(x, y);
        self.between(u as f32, v as f32)
    }
}

impl WaterBody {
    /// The share of a bottom's light that is left after `path` metres in water, under water `depth`
    /// metres deep.
    fn left(&self, path: f32, depth: f32) -> f32 {
        (-(self.beam * path + self.daylight * depth)).exp()
    }
}

const SITE: Site = Site::PLAIN;

fn on_grid(grid: WaterGrid) -> WaterMap {
    WaterMap::new(None, Some(Arc::new(grid)), &SITE)
}

fn camera(eye: [f64; 3], target: [f64; 3]) -> Camera {
    let [eye, target] = [eye, target].map(glam::DVec3::from_array);
    Camera::looking((160, 120), 60.0, eye, target, glam::DVec3::Z).unwrap()
}

/// Elevation in degrees and reflectance, from tables of optics.
#[test]
fn reflectances_are_those_of_tables() {
    let table =
        [(2.0, 0.80), (5.0, 0.58), (10.0, 0.35), (15.0, 0.21), (20.0, 0.13), (30.0, 0.06), (90.0, 0.02)];
    for (elevation, want) in table {
        let got = fresnel(f32::sin(f32::to_radians(elevation)));
        assert!((got - want).abs() < 0.0051, "{elevation}: {got} for {want}");
    }
    assert!((fresnel(0.0) - 1.0).abs() < 1e-6);
}

#[test]
fn the_transform_is_the_sum_of_waves() {
    let mut values = vec![[0.0f32; 2]; TILE_SIDE_NODES * TILE_SIDE_NODES];
    let waves: Vec<(usize, [f64; 2])> = (0..5u64)
        .map(|i| {
            let at = (uniform(3, 3 * i) * (TILE_SIDE_NODES * TILE_SIDE_NODES) as f64) as usize;
            (at, [uniform(3, 3 * i + 1), uniform(3, 3 * i + 2)])
        })
        .collect();
    for (at, value) in &waves {
        values[*at] = value.map(|v| v as f32);
    }
    transform(&mut values);
    for (x, y) in [(0, 0), (1, 0), (0, 1), (17, 200), (255, 255)] {
        let want = waves.iter().fold([0.0; 2], |sum: [f64; 2], (at, [re, im])| {
            let turns = (at % TILE_SIDE_NODES * x + at / TILE_SIDE_NODES * y) as f64 / TILE_SIDE_NODES as f64;
            let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
            [sum[0] + re * cos - im * sin, sum[1] + re * sin + im * cos]
        });
        let got = values[y * TILE_SIDE_NODES + x];
        assert!((0..2).all(|k| (f64::from(got[k]) - want[k]).abs() < 1e-4), "{x}, {y}: {got:?} for {want:?}");
    }
}

/// The values that the design of waves states: 50 m, 7 m/s: 2.5 cm high, 0.30 m long.
#[test]
fn wind_waves_grow_by_fetch() {
    let waves = WindWaves::new([7.0, 0.0], 50.0, 0.0).unwrap();
    // Less by what makes it as steep as Cox and Munk's slopes.
    assert!(waves.height > 0.012 && waves.height < 0.0255, "{}", waves.height);
    assert!(2.0 * waves.slope_variance() < 0.003 + 0.00512 * 7.0 + 1e-9);
    let length = 9.81 * waves.period * waves.period / std::f64::consts::TAU;
    assert!((length - 0.30).abs() < 0.02, "{length}");
    assert!(WindWaves::new([0.0; 2], 50.0, 9.0).is_none());
    // A ring's waves: 31 mm, 8 Hz, 0.25 m/s.
    let w = frequency(WAVE_NUMBER);
    assert!((w / std::f64::consts::TAU - 8.0).abs() < 0.1 && (w / WAVE_NUMBER - RING_SPEED).abs() < 0.005);
}

/// The two mean slopes of a piece of a surface, `width` metres wide about a point, and their
/// variance within.
fn slope(motion: &WaterMotion, x: f64, y: f64, width: f32) -> [f32; 3] {
    #[inline(always)]
    fn first<S: Lanes>(simd: S, motion: &WaterMotion, phases: &[[f32; 2]], width: f32) -> [f32; 3] {
        let here = [simd.set(0.0); 2];
        let found = motion.at(simd, here, phases, simd.set(width.log2()), 1);
        found.map(|vector| crate::lanes::LaneArray::new(simd, vector).0[0])
    }
    let phases = motion.phases([x, y]);
    dispatch!(SimdPath::widest(), s => first(s, motion, &phases, width))
}

/// Foam covers the shares of its laws, however many waves a pixel shows.
#[test]
fn foam_covers_its_share_of_the_water() {
    #[inline(always)]
    fn share<S: Lanes>(simd: S, foam: &foam::Foam, depth: f32, slope: [f32; 3]) -> f32 {
        let square = simd.set(slope[0] * slope[0] + slope[1] * slope[1]);
        crate::lanes::LaneArray::new(simd, foam.share(simd, simd.set(depth), square, simd.set(slope[2]))).0[0]
    }
    let mean = |wind: f64, depth: f32, width: f32| {
        let forces = WaterForces { wind: [wind, 0.0], fetch: 300.0, ..WaterForces::default() };
        let motion = WaterMotion::new(&forces, None);
        let foam = motion.foam.as_ref().unwrap();
        let at = |k: u32| slope(&motion, 0.37 * f64::from(k % 60), 0.41 * f64::from(k / 60), width);
        let sum: f32 =
            (0..3600).map(|k| dispatch!(SimdPath::widest(), s => share(s, foam, depth, at(k)))).sum();
        f64::from(sum / 3600.0)
    };
    // Monahan and O'Muircheartaigh: 4 % of the open sea at 15 m/s.
    let far = mean(15.0, 9.0, 1e3);
    assert!((0.02..0.041).contains(&far), "{far}");
    for width in [0.01, 0.1] {
        let near = mean(15.0, 9.0, width);
        assert!((near / far - 1.0).abs() < 0.3, "{width}: {near} for {far}");
    }
    // Half of the edge, and the deeper the less.
    let depths = [0.0, 0.02, 0.05, 1.0].map(|depth| mean(12.0, depth, 0.05));
    assert!((depths[0] - 0.5).abs() < 0.07 && depths.is_sorted_by(|a, b| a > b), "{depths:?}");
    let calm = WaterForces { wind: [3.0, 0.0], fetch: 300.0, ..WaterForces::default() };
    assert!(WaterMotion::new(&calm, None).foam.is_none());
}

/// The variance of slopes on tiles, and within what is too wide to see them, is that of the law.
#[test]
fn slopes_have_the_variance_of_their_spectrum() {
    let (mut wind, mut rain) = (0.0, 0.0);
    let times = [0.0, 1.7, 33.0];
    for time in times {
        let of = |forces| f64::from(slope(&WaterMotion::new(&forces, None), 0.3, 0.7, 1e4)[2]);
        let still = of(WaterForces::default());
        wind += of(WaterForces { wind: [5.0, 2.0], fetch: 50.0, time, ..WaterForces::default() }) - still;
        rain += of(WaterForces { rain: 10.0, depth: 1.0, time, ..WaterForces::default() }) - still;
    }
    let (wind, rain) = (wind / times.len() as f64, rain / times.len() as f64);
    let want = WindWaves::new([5.0, 2.0], 50.0, 0.0).unwrap().slope_variance();
    assert!((wind / want - 1.0).abs() < 0.1, "wind: {wind} for {want}");
    let want = 0.5 * slope_rms(10.0, 1.0).powi(2);
    assert!((rain / want - 1.0).abs() < 0.15, "rain: {rain} for {want}");
    // The design of waves states these for Gunn and Kinzer's speeds.
    for (rate, rms) in [(5.0, 0.0655), (10.0, 0.1002), (20.0, 0.1518), (50.0, 0.2603)] {
        assert!((slope_rms(rate, 1.0) / rms - 1.0).abs() < 0.015, "{rate} mm/h: {}", slope_rms(rate, 1.0));
    }
    assert!((slope_rms(10.0, 0.005) - 0.049).abs() < 1e-3);
    assert_eq!([slope_rms(0.0, 1.0), large_drops(0.0)], [0.0; 2]);
    for (rate, number) in [(1.0, 3.364), (10.0, 126.0), (50.0, 819.0)] {
        assert!((large_drops(rate) / number - 1.0).abs() < 0.01, "{rate} mm/h: {}", large_drops(rate));
    }
}

/// Motion is a function of place and time: the same from anywhere, and at any order of frames.
#[test]
fn motion_is_fixed_to_the_world() {
    let forces = |time| WaterForces {
        wind: [4.0, 0.0],
        fetch: 50.0,
        rain: 8.0,
        time,
        seed: 1,
        ..WaterForces::default()
    };
    let [now, again, later] = [2.0, 2.0, 2.1].map(|time| WaterMotion::new(&forces(time), None));
    let at = |motion: &WaterMotion| slope(motion, 12.3, -4.5, 0.01);
    assert_eq!(at(&now), at(&again));
    assert_ne!(at(&now), at(&later));
}

#[test]
fn a_ray_meets_the_water_where_it_stands() {
    let map = WaterMap::new(Some(0.5), None, &SITE);
    let camera = camera([0.0, 0.0, 2.0], [10.0, 0.0, 0.5]);
    let surface = WaterSurface::of(&map, &camera).unwrap();
    let mut wet = 0;
    for (i, z) in surface.depth.iter().enumerate() {
        let (x, y) = ((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5);
        let ray = camera.ray(x, y);
        assert_eq!(z.is_nan(), ray.z >= 0.0, "{x}, {y}");
        if !z.is_nan() && *z < 1e5 {
            let point = camera.center() + ray * (f64::from(*z) / ray.dot(camera.forward()));
            assert!((point.z - 0.5).abs() < 1e-5 * f64::from(*z), "{x}, {y}: {point}");
            wet += 1;
        }
    }
    assert!(wet > 5000, "{wet}");
    // Cameras of photos have their near plane beyond water at their feet.
    let depth = |near: f64| WaterSurface::of(&map, &Camera { near, ..camera }).unwrap().depth;
    assert!(depth(5.0).iter().zip(&surface.depth).all(|(a, b)| a.to_bits() == b.to_bits()));
    // From below the surface nothing is seen of it.
    assert!(WaterSurface::of(&WaterMap::new(Some(2.5), None, &SITE), &camera).is_none());
}

#[test]
fn a_puddle_has_soft_edges_and_its_own_level() {
    let (width, height) = (41, 41);
    let inside = |i: usize| {
        let (x, y) = ((i % width) as f64 * 0.1 - 2.0, (i / width) as f64 * 0.1 - 2.0);
        1.0 - (x.hypot(y) - 1.0) / 0.3
    };
    let nodes = 0..width * height;
    let node = |i: usize| WaterNode {
        level: if inside(i) > 0.0 { 0.02 } else { f32::NAN },
        depth: -1.0,
        film: inside(i).clamp(0.0, 1.0) as f32,
        roughness: 0.0,
    };
    let grid = WaterGrid::new([3.0, -2.0], 0.1, [width, height], nodes.map(node));
    let map = on_grid(grid);
    let surface = WaterSurface::of(&map, &camera([0.0, 0.0, 1.6], [5.0, 0.0, 0.0])).unwrap();
    assert!((surface.level - 0.02).abs() < 1e-6);
    let soft = surface.cover.iter().filter(|cover| (0.05..0.95).contains(*cover)).count();
    let full = surface.cover.iter().filter(|cover| **cover > 0.999).count();
    assert!(soft > 50 && full > 50, "{soft} {full}");
}

/// A street that rises by 3 %, wet all over, with a puddle: both are met where they are.
#[test]
fn wet_ground_is_met_on_its_slope() {
    const GRID_STEP_M: f64 = 0.1;
    const POND_LEVEL_M: f32 = 0.3;
    let (width, height) = (300, 80);
    let along = |i: usize| ((i % width) as f64 + 0.5) * GRID_STEP_M;
    let ground: Vec<f32> = (0..width * height).map(|i| (0.03 * along(i)) as f32).collect();
    let stands = |i: usize| (9.0..10.0).contains(&along(i));
    let state = WaterState {
        running: vec![0.0; 300 * 80],
        open: vec![f32::NAN; 300 * 80],
        seen: vec![1.0; 300 * 80],
        matte: vec![0.0; 300 * 80],
        // The second axis points to the right.
        origin: [0.0, 4.0, 0.0],
        axes: crate::level::level_axes(SITE.up),
        step: GRID_STEP_M,
        width,
        height,
        level: (0..ground.len()).map(|i| if stands(i) { POND_LEVEL_M } else { f32::NAN }).collect(),
        film: vec![0.0; ground.len()],
        filled: vec![0.5; ground.len()],
        pores: vec![1.0; ground.len()],
        ground,
        budget: WaterBudget::default(),
    };
    let grid = puddles(&state, 0.8, &SITE);
    let none = vec![0.0; state.filled.len()];
    let dry = WaterState { filled: none.clone(), pores: none.clone(), ..state.clone() };
    let dry = puddles(&dry, 0.8, &SITE);
    let lawn = WaterState { matte: vec![1.0; none.len()], ..state.clone() };
    let lawn = on_grid(puddles(&lawn, 0.8, &SITE));
    // Full pores without a film mirror as roughly as the grains lie.
    let damp = WaterState { filled: none, ..state.clone() };
    let damp = on_grid(puddles(&damp, 0.8, &SITE));
    let map = on_grid(grid);
    let dry = on_grid(dry);
    for i in 0..width - 1 {
        // Deeper than some millimetres water hides the ground, and is smooth; a film is rough, and
        // lawn does not shine.
        let is_deep = stands(i) && POND_LEVEL_M - state.ground[i] > 0.005;
        let bare = !stands(i) || state.ground[i] >= POND_LEVEL_M;
        let [own, dry] = [&map, &dry].map(|map| map.at(along(i) + 1e-6, -3.95 + 1e-6).unwrap());
        assert!(!is_deep || own.cover > 0.999 && own.roughness < 1e-4, "{i} {own:?}");
        assert!(
            !bare || own.cover > 0.999 && own.roughness > 0.1 && dry.cover < 0.001,
            "{i} {own:?} {dry:?}"
        );
        let [lawn, damp] = [&lawn, &damp].map(|map| map.at(along(i) + 1e-6, -3.95 + 1e-6).unwrap());
        assert!(
            !bare || lawn.cover < 0.001 && damp.cover > 0.999 && damp.roughness > 0.29,
            "{i} {lawn:?} {damp:?}"
        );
    }
    // The edge of the puddle lies where its level meets the slope, and not at a cell.
    let wet = |x: f64| dry.at(x, -1.0).unwrap().cover;
    assert!(
        wet(9.85) > 0.5 && wet(9.97) > 0.0 && wet(10.01) == 0.0,
        "{} {} {}",
        wet(9.85),
        wet(9.97),
        wet(10.01)
    );
    let camera = camera([1.0, 0.0, 1.7], [8.0, 0.0, 0.3]);
    let surface = WaterSurface::of(&map, &camera).unwrap();
    let mut met = 0;
    for (i, z) in surface.depth.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
        let ray = camera.ray((i % 160) as f64 + 0.5, (i / 160) as f64 + 0.5);
        let point = camera.center() + ray * (f64::from(*z) / ray.dot(camera.forward()));
        let level = if (8.9..10.1).contains(&point.x) { f64::from(POND_LEVEL_M) } else { 0.03 * point.x };
        assert!((point.z - level).abs() < 0.1, "{point}");
        met += 1;
    }
    assert!(met > 3000, "{met}");
}

/// A point of the world is where its mirror image is, seen by the eye, with its columns counted
/// from the right.
#[test]
fn the_mirrored_eye_sees_mirror_images() {
    let map = WaterMap::new(Some(0.3), None, &SITE);
    let eye = camera([1.0, -2.0, 1.7], [8.0, 0.5, 0.9]);
    let surface = WaterSurface::of(&map, &eye).unwrap();
    let mirror = MirrorView::new(&map, &surface, &eye);
    mirror.camera.check().unwrap();
    let (first, _) = (surface.rows.start, surface.rows.end);
    let margin = f64::from(mirror.camera.width) - 0.5 * f64::from(eye.width);
    for point in [[6.0, 0.0, 1.0], [9.0, 2.0, 3.0], [5.0, -1.0, 0.4]] {
        let point = glam::DVec3::from_array(point);
        let image = glam::DVec3::new(point.x, point.y, 0.6 - point.z);
        let (x, y, z) = eye.project(image).unwrap();
        let (u, v, w) = mirror.camera.project(point).unwrap();
        assert!((z - w).abs() < 1e-9);
        assert!((u - 0.5 * (f64::from(eye.width) - x) - 0.5 * margin).abs() < 1e-6, "{u} {x}");
        assert!((v - 0.5 * (y - f64::from(first)) - 0.5 * margin).abs() < 0.51, "{v} {y}");
    }
}

/// A white disc goes out of sight at the Secchi depth.
#[test]
fn a_disc_fades_at_the_secchi_depth() {
    for secchi in [0.1, 1.0, 10.0] {
        let body = WaterBody::new(secchi, None, [1.0; 3]);
        let depth = secchi as f32;
        assert!((f64::from(body.left(depth, depth)) / (-8.69f64).exp() - 1.0).abs() < 1e-3);
        assert!(body.glow.iter().all(|light| (0.002..0.2).contains(light)), "{:?}", body.glow);
    }
}
