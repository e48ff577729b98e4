//! Sweeps against numbers that were computed otherwise.

use crate::pattern::{BeamPattern, RowPattern, TablePattern};
use crate::reflecting_splats;
use crate::*;
use glam::DVec3;
use wm_base::color::srgb_encode;
use wm_base::random;
use wm_render::simd::SimdPath;
use wm_scene::{Splats, sh};
use wm_weather::particles::RAIN;
use wm_weather::{PreparedWeather, Site, Weather};

/// A lidar at 905 nm that sees a target of 10 % at 120 m, with beams in given directions (degrees)
/// over 0.1 s.
fn lidar(directions: impl Iterator<Item = [f64; 2]>) -> LidarModel {
    let directions: Vec<[f64; 2]> = directions.collect();
    let step = 0.1 / directions.len() as f64;
    let beams =
        directions.iter().enumerate().map(|(index, [az, el])| [step * index as f64, *az, *el]).collect();
    LidarModel {
        name: "test".into(),
        wavelength: 905.0,
        divergence: 3.0,
        pulse: 5.0,
        range: [0.5, 300.0],
        reference_range: 120.0,
        range_noise: 0.02,
        overlap: [0.9, 1.0],
        pattern: BeamPattern::Table(TablePattern { rate: 10.0, beams }),
    }
}

/// Beams within half a degree of straight ahead.
fn ahead(count: u64) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(|i| [random::uniform(1, i) - 0.5, random::uniform(2, i) - 0.5])
}

/// A wall across x, or a floor across z, of one splat of a reflectance.
fn plate(axis: usize, at: f32, reflectance: f64) -> Splats {
    let mut plate = Splats::zeroed(1, 0);
    plate.means[0][axis] = at;
    plate.log_scales[0] = [f32::ln(300.0); 3];
    plate.log_scales[0][axis] = f32::ln(0.01);
    plate.quats[0] = [1.0, 0.0, 0.0, 0.0];
    plate.logit_opacities[0] = 9.0;
    let encoded = srgb_encode((reflectance - 0.05) / 0.8);
    plate.sh = vec![((encoded - 0.5) / sh::C0) as f32; 3];
    plate
}

struct WetSurfaces;

impl SurfaceStates for WetSurfaces {
    fn state(&self, _: u32) -> SurfaceState {
        SurfaceState { film: 1.0, ..SurfaceState::default() }
    }
}

/// One sweep by one ray per pulse from the height of 1.8 m.
fn lidar_sweep(
    lidar: &LidarModel,
    splats: &Splats,
    set: &[(&str, f64)],
    options: &ScanOptions,
) -> LidarSweep {
    swept_on(lidar, splats, set, options, &DrySurfaces)
}

/// Dry splats that nothing mirrors.
fn dry<'a>(splats: &'a wm_render::RaySplats<'_>, weather: &'a PreparedWeather) -> LidarScene<'a> {
    let (site, path) = (&Site::PLAIN, SimdPath::widest());
    LidarScene { splats, mirrored: None, weather, site, shelter: None, surfaces: &DrySurfaces, path }
}

fn swept_on(
    lidar: &LidarModel,
    splats: &Splats,
    set: &[(&str, f64)],
    options: &ScanOptions,
    surfaces: &dyn SurfaceStates,
) -> LidarSweep {
    let weather =
        set.iter().fold(Weather::clear(), |weather, (key, value)| weather.set(key, *value).unwrap());
    let weather = weather.at(options.time).prepare(&Site::PLAIN);
    let rays = reflecting_splats(splats, |_| true);
    let above = reflecting_splats(splats, |index| splats.log_scales[index][2] > 0.0);
    let scene = LidarScene { mirrored: Some(&above), surfaces, ..dry(&rays, &weather) };
    let pose = SensorPose::upright(DVec3::Z * 1.8, DVec3::X, DVec3::Z);
    sweep(lidar, &pose, &scene, options)
}

const ALL: ScanOptions = ScanOptions {
    time: 0.0,
    index: 0,
    seed: 5,
    sensor: 0,
    sub_rays: SubRays::One,
    returns: ReturnMode::All,
    frame: PointFrame::Compensated,
    lidar_ratio: None,
};

#[test]
fn a_wall_is_as_far_as_it_is() {
    let lidar = lidar(ahead(4000));
    for sub_rays in [SubRays::One, SubRays::Seven] {
        let made = lidar_sweep(&lidar, &plate(0, 20.0, 0.5), &[], &ScanOptions { sub_rays, ..ALL });
        assert_eq!((made.points.len(), made.count(EchoClass::Surface)), (4000, 4000));
        let off: Vec<f64> = made.points.iter().map(|point| f64::from(point.position[0]) - 20.0).collect();
        let mean = off.iter().sum::<f64>() / 4000.0;
        let spread = (off.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
        // The noise of the model: 2 cm, of which the mean of 4,000 has 0.3 mm.
        assert!(mean.abs() < 1.5e-3 && (spread / 0.02 - 1.0).abs() < 0.05, "{mean} {spread}");
        let intensity = made.points.iter().map(|point| f64::from(point.intensity)).sum::<f64>() / 4000.0;
        assert!((intensity / 127.5 - 1.0).abs() < 0.01, "{intensity}");
    }
}

/// The distance at which a half of the pulses meet a wall of 10 %, by sweeps of walls about a
/// guess.
fn range_of_target(guess: f64, set: &[(&str, f64)]) -> f64 {
    let lidar = lidar(ahead(1500));
    let share = |range: f64| {
        let made = lidar_sweep(&lidar, &plate(0, range as f32, 0.1), set, &ALL);
        made.count(EchoClass::Surface) as f64 / 1500.0
    };
    let walls: Vec<[f64; 2]> =
        (-3..=3).map(|i| guess * (1.0 + 0.025 * f64::from(i))).map(|r| [r, share(r)]).collect();
    // Shares fall; the place of a half between two of them.
    let pair = walls.windows(2).find(|pair| pair[0][1] >= 0.5 && pair[1][1] < 0.5);
    pair.map_or(f64::NAN, |pair| {
        let [[a, from], [b, to]] = [pair[0], pair[1]];
        a + (b - a) * (from - 0.5) / (from - to)
    })
}

#[test]
fn fog_and_rain_shorten_the_range_of_a_target() {
    for (mor, range) in
        [(30.0, 18.4), (50.0, 25.4), (100.0, 37.8), (200.0, 53.2), (500.0, 75.6), (1000.0, 90.9)]
    {
        let found = range_of_target(range, &[("fog.mor", mor)]);
        println!("MOR {mor} m: a target of 10 % is seen up to {found:.1} m for {range}");
        assert!((found / range - 1.0).abs() < 0.03, "{mor}: {found}");
    }
    for (rate, range) in [(1.0, 115.0), (10.0, 102.0), (25.0, 93.0), (50.0, 84.0), (100.0, 74.0)] {
        let found = range_of_target(range, &[("rain.rate", rate)]);
        println!("{rate} mm/h: a target of 10 % is seen up to {found:.1} m for {range}");
        assert!((found / range - 1.0).abs() < 0.03, "{rate}: {found}");
    }
}

/// The probability that speckle of mean 1 and the receiver's noise are above 1 together.
fn share_at_threshold() -> f64 {
    let phi = |x: f64| {
        // The normal distribution, by its integral.
        let steps = 400;
        let from = -6.0;
        let h = (x.clamp(-6.0, 6.0) - from) / f64::from(steps);
        let density = |v: f64| (-0.5 * v * v).exp() / std::f64::consts::TAU.sqrt();
        (0..steps).map(|i| density(from + h * (f64::from(i) + 0.5))).sum::<f64>() * h
    };
    let step = 0.005;
    let gamma = |g: f64| 256.0 / 6.0 * g.powi(3) * (-4.0 * g).exp();
    (0..1200).map(|i| step * (f64::from(i) + 0.5)).map(|g| step * gamma(g) * phi((g - 1.0) / 0.2)).sum()
}

#[test]
fn air_is_seen_as_far_as_its_backscatter_says() {
    let lidar = lidar(ahead(4000));
    let wanted = share_at_threshold();
    for (mor, reach) in
        [(30.0, 12.4), (50.0, 14.2), (100.0, 15.1), (200.0, 13.8), (500.0, 10.1), (1000.0, 7.4)]
    {
        let made = lidar_sweep(&lidar, &Splats::zeroed(0, 0), &[("fog.mor", mor)], &ALL);
        assert_eq!(made.count(EchoClass::Air), made.points.len());
        // Each pulse has one bin of air in each length of a bin.
        let bin = lidar.bin();
        let mut shares = [0.0; 40];
        for point in &made.points {
            shares[((f64::from(point.range) / bin) as usize).min(39)] += 1.0 / 4000.0;
        }
        let last = shares.iter().rposition(|share| *share >= wanted).unwrap();
        let between = (shares[last] - wanted) / (shares[last] - shares[last + 1]);
        let found = bin * (last as f64 + 0.5 + between);
        println!("MOR {mor} m: air is seen up to {found:.2} m for {reach}");
        assert!((found / reach - 1.0).abs() < 0.03, "{mor}: {found}");
    }
}

/// Sweeps of fog chambers are full of near points in fog of some ten metres; in rain and mist such
/// points are few, and none are of air.
#[test]
fn devices_see_dense_fog_and_no_mist() {
    let options = ScanOptions { returns: ReturnMode::Strongest, ..ALL };
    for name in ["vlp-16", "os1-64", "pandar64"] {
        let around = (0..4000u64).map(|i| [180.0 - 0.09 * i as f64, 40.0 * random::uniform(4, i) - 20.0]);
        let lidar = LidarModel { pattern: lidar(around).pattern, ..LidarModel::preset(name).unwrap() };
        let shares = |set: &[(&str, f64)]| {
            let made = lidar_sweep(&lidar, &Splats::zeroed(0, 0), set, &options);
            [EchoClass::Air, EchoClass::Drop].map(|class| made.count(class) as f64 / made.pulses as f64)
        };
        let ([dense, _], [mist, drops]) =
            (shares(&[("fog.mor", 30.0)]), shares(&[("fog.mor", 5000.0), ("rain.rate", 25.0)]));
        println!(
            "{name}: {dense:.3} of pulses see dense fog, {mist:.4} mist, {drops:.4} drops in heavy rain"
        );
        assert!(dense > 0.8 && mist < 2e-3 && (1e-4..0.1).contains(&drops), "{name}: {dense} {mist} {drops}");
    }
}

/// Expected detections of drops a pulse: each volume of a beam holds a Poisson number of each size.
fn expected_drops(lidar: &LidarModel, rate: f64) -> f64 {
    let classes = RAIN.classes();
    let theta = 1e-3 * lidar.divergence;
    let sigma = 0.365e-3 * rate.powf(0.63);
    let step = 0.01;
    let normal = |x: f64| 0.5 * (1.0 + (x * 0.797_884_56 * (1.0 + 0.044_715 * x * x)).tanh());
    let mut sum = 0.0;
    for (class, number) in classes.iter().zip(RAIN.densities(&classes, rate)) {
        for i in 50..1500 {
            let range = step * (f64::from(i) + 0.5);
            let overlap = ((range - 0.9) / 0.1).clamp(0.0, 1.0).powi(2);
            let beam = theta * range;
            for part in 0..4 {
                let diameter = 1e-3 * class.diameter((f64::from(part) + 0.5) / 4.0);
                let echo = 0.023 * (diameter / beam).powi(2).min(1.0) * overlap / (range * range);
                let signal = echo * (-2.0 * sigma * range).exp() * 120.0 * 120.0 / 0.1;
                let seen = if signal < 0.1 { 0.0 } else { normal((signal - 1.0) / 0.2) };
                let across = std::f64::consts::FRAC_PI_4 * beam.max(diameter).powi(2);
                sum += 0.25 * number * across * step * seen;
            }
        }
    }
    sum
}

#[test]
fn drops_are_as_many_as_the_rain_holds() {
    // Round about the horizon in the order of time, so that all faces of the cube of directions are
    // asked.
    let lidar =
        lidar((0..30_000u64).map(|i| [180.0 - 0.012 * i as f64, 100.0 * random::uniform(4, i) - 50.0]));
    for rate in [5.0, 25.0, 100.0] {
        let made = lidar_sweep(&lidar, &Splats::zeroed(0, 0), &[("rain.rate", rate)], &ALL);
        assert_eq!(made.count(EchoClass::Drop), made.points.len());
        let (found, wanted) = (made.points.len() as f64, 30_000.0 * expected_drops(&lidar, rate));
        println!("{rate} mm/h: {found} drop points in 30,000 pulses for {wanted:.0}");
        // Neighbouring beams meet the same drops near by: some more than four standard errors, and
        // 2 % for drops that add up.
        assert!((found - wanted).abs() < 5.0 * wanted.sqrt() + 0.02 * wanted, "{rate}: {found} {wanted}");
    }
}

#[test]
fn nothing_falls_behind_a_wall() {
    let (lidar, rain) = (lidar(ahead(20_000)), [("rain.rate", 100.0)]);
    let farthest = |splats: &Splats| {
        let drops = lidar_sweep(&lidar, splats, &rain, &ALL).points.into_iter();
        drops.filter(|point| point.class == EchoClass::Drop).map(|point| point.range).fold(0.0, f32::max)
    };
    let (open, walled) = (farthest(&Splats::zeroed(0, 0)), farthest(&plate(0, 2.0, 0.1)));
    assert!(open > 4.0 && walled < 2.2, "{open} {walled}");
}

#[test]
fn wet_ground_vanishes_far_away_and_mirrors_walls() {
    let fan = |low: f64, high: f64| (0..2000).map(move |i| [0.0, low + (high - low) * f64::from(i) / 2000.0]);
    let mut scene = plate(2, 0.0, 0.2);
    scene.append(&plate(0, 60.0, 0.8));
    let lidar = lidar(fan(-30.0, -0.5));
    let reach = |surfaces: &dyn SurfaceStates| {
        let made = swept_on(&lidar, &scene, &[], &ALL, surfaces);
        let ground = made.points.iter().filter(|p| p.class == EchoClass::Surface && p.position[2] < -1.7);
        (ground.map(|point| point.position[0]).fold(0.0, f32::max), made)
    };
    let (dry, clear) = reach(&DrySurfaces);
    let (wet, ghosts) = reach(&WetSurfaces);
    println!("ground is seen up to {dry:.1} m dry, {wet:.1} m wet");
    assert!(wet < 0.75 * dry && clear.count(EchoClass::Ghost) == 0, "{dry} {wet}");
    let ghosts: Vec<&LidarPoint> = ghosts.points.iter().filter(|p| p.class == EchoClass::Ghost).collect();
    assert!(ghosts.len() > 50, "{}", ghosts.len());
    for ghost in ghosts {
        // Behind the mirror: under the ground, as far away as the wall.
        assert!((ghost.position[0] - 60.0).abs() < 1.0 && ghost.position[2] < -1.7, "{ghost:?}");
    }
}

#[test]
fn motion_is_taken_out_of_the_points() {
    let lidar = lidar(ahead(1000));
    let wall = plate(0, 30.0, 0.8);
    let weather = Weather::clear().at(0.0).prepare(&Site::PLAIN);
    let rays = reflecting_splats(&wall, |_| true);
    let scene = dry(&rays, &weather);
    let start = SensorPose::upright(DVec3::new(4.0, 0.0, 1.8), DVec3::X, DVec3::Z);
    let motion = EvenMotion { start, velocity: DVec3::X * 20.0 };
    let spread = |frame: PointFrame, middle: f32| {
        let made = sweep(&lidar, &motion, &scene, &ScanOptions { frame, ..ALL });
        made.points.iter().map(|point| (point.position[0] - middle).abs()).fold(0.0, f32::max)
    };
    assert!(spread(PointFrame::Compensated, 26.0) < 0.1);
    assert!(spread(PointFrame::World, 30.0) < 0.1);
    // Two metres in a tenth of a second.
    assert!((1.9..2.1).contains(&spread(PointFrame::Raw, 26.0)));
}

#[test]
fn any_number_of_threads_gives_the_same_points() {
    let lidar = lidar((0..4000u64).map(|i| [30.0 - 0.015 * i as f64, 20.0 * random::uniform(4, i) - 15.0]));
    let mut scene = plate(2, 0.0, 0.3);
    scene.append(&plate(0, 25.0, 0.6));
    let made = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = ScanOptions { seed, sub_rays: SubRays::Seven, ..ALL };
        let set = [("fog.mor", 100.0), ("rain.rate", 20.0), ("snowfall.rate", 0.5)];
        pool.install(|| swept_on(&lidar, &scene, &set, &options, &WetSurfaces))
    };
    let one = made(1, 5);
    for class in EchoClass::ALL {
        assert!(one.count(class) > 0, "{class:?}");
    }
    assert!(one == made(2, 5) && one == made(7, 5));
    assert!(one != made(2, 6));
}

#[test]
fn the_street_is_where_it_is() {
    let street = wm_street::Street::builtin();
    let scene = street.sampling(0.4).scene(&|_| true).unwrap();
    let rows = RowPattern {
        rate: 10.0,
        elevations: vec![],
        between: Some([-20.0, 10.0]),
        count: Some(32),
        azimuth_offsets: vec![],
        columns: 300,
        firing_offsets: vec![],
        azimuths: [180.0, -180.0],
    };
    let lidar = LidarModel { pattern: BeamPattern::Rows(rows), range_noise: 0.0, ..lidar(ahead(1)) };
    let weather = Weather::clear().at(0.0).prepare(&Site::PLAIN);
    let splats = &scene.splats;
    let rays = reflecting_splats(splats, |index| splats.groups[index] != wm_scene::Group::Sky);
    let scene = dry(&rays, &weather);
    let eye = street.dolly(0.3).camera((300, 200)).unwrap();
    let pose = SensorPose::upright(eye.center() + DVec3::Z * 0.2, eye.forward(), DVec3::Z);
    let made = sweep(&lidar, &pose, &scene, &ScanOptions { frame: PointFrame::World, ..ALL });
    let mut errors: Vec<f64> = Vec::new();
    for point in &made.points {
        let at = glam::Vec3::from_array(point.position).as_dvec3();
        let true_range = street.first(pose.origin, at - pose.origin).map_or(f64::INFINITY, |hit| hit.t);
        errors.push((f64::from(point.range) - true_range).abs());
    }
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[(share * (errors.len() - 1) as f64) as usize];
    println!(
        "street: {} points of {} pulses, errors {:.3} m median, {:.3} m of 90 %",
        errors.len(),
        made.pulses,
        at(0.5),
        at(0.9)
    );
    assert!(errors.len() > made.pulses / 2 && at(0.5) < 0.05 && at(0.9) < 0.5, "{} {}", at(0.5), at(0.9));
}
