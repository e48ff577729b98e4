//! Sweeps against numbers that were computed otherwise.

use super::cells::{RainClutter, powers};
use super::rain::rain_attenuation;
use super::surface::surface_backscatter;
use super::sweep::FanView;
use super::*;
use crate::{EvenMotion, PointFrame, SensorPose};
use glam::{DQuat, DVec3};
use wm_base::random::RandomStream;
use wm_render::RaySplats;
use wm_render::simd::SimdPath;
use wm_scene::Splats;
use wm_weather::{PreparedWeather, Site, Weather};

/// A small radar that sees far, so that noise does not count.
fn radar() -> RadarModel {
    let text = "frequency = 76.5\nrange = [1, 120]\nrange_cell = 0.5\nazimuth = [-15, 15]\nazimuth_cell = 2\nelevation_beam = 10\n\
                velocity = 20\nvelocity_cell = 0.5\nreference_range = 3000\nrate = 15\n";
    RadarModel::parse(text, "test").unwrap()
}

/// A plate of some 1.5 m that faces the origin from a range (m) and an azimuth (radians).
fn plate(range: f64, azimuth: f64) -> Splats {
    let mut plate = Splats::zeroed(1, 0);
    plate.means[0] = [(range * azimuth.cos()) as f32, (range * azimuth.sin()) as f32, 0.0];
    plate.log_scales[0] = [f32::ln(0.002), f32::ln(0.4), f32::ln(0.4)];
    let turn = DQuat::from_rotation_z(azimuth);
    plate.quats[0] = [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32);
    plate.logit_opacities[0] = 9.0;
    plate
}

fn prepared(set: &[(&str, f64)]) -> PreparedWeather {
    let clear = Weather::clear();
    let weather = set.iter().fold(clear, |weather, (key, value)| weather.set(key, *value).unwrap());
    weather.at(0.0).prepare(&Site::PLAIN)
}

fn scene<'a>(splats: &'a RaySplats<'_>, weather: &'a PreparedWeather) -> RadarScene<'a> {
    RadarScene { splats, weather, site: &Site::PLAIN, shelter: None, path: SimdPath::widest() }
}

/// One sweep at a velocity ahead, m/s.
fn sweep_from_origin(
    radar: &RadarModel,
    splats: &Splats,
    set: &[(&str, f64)],
    speed: f64,
    options: &RadarScanOptions,
) -> RadarSweep {
    let rays = RaySplats::new(splats, |_| true);
    let weather = prepared(set);
    let scene = scene(&rays, &weather);
    let start = SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z);
    radar_sweep(radar, &EvenMotion { start, velocity: DVec3::X * speed }, &scene, options)
}

/// The strongest detection.
fn strongest(sweep: &RadarSweep) -> RadarDetection {
    *sweep.detections.iter().max_by(|a, b| a.snr.total_cmp(&b.snr)).unwrap()
}

#[test]
fn a_plate_is_where_it_is_and_comes_as_fast_as_it_does() {
    let radar = radar();
    for (range, azimuth, speed) in [(40.0, 0.0, 0.0), (63.3, 7.3f64.to_radians(), 8.1), (90.2, -0.2, 15.0)] {
        let made =
            sweep_from_origin(&radar, &plate(range, azimuth), &[], speed, &RadarScanOptions::default());
        let found = strongest(&made);
        println!("{range} m, {azimuth:.3}, {speed} m/s: {found:?}");
        assert_eq!(found.class, RadarClass::Surface);
        // A fifth of a cell: places between cells are found.
        assert!((f64::from(found.range) - range).abs() < 0.1, "{found:?}");
        assert!((f64::from(found.azimuth) - azimuth).abs() < 0.4f64.to_radians(), "{found:?}");
        assert!(f64::from(found.elevation).abs() < 0.1f64.to_radians(), "{found:?}");
        assert!((f64::from(found.velocity) + speed * azimuth.cos()).abs() < 0.1, "{found:?}");
        assert!(f64::from(found.ground_velocity).abs() < 0.1, "{found:?}");
        // As the surface's law has it, of an ellipse at an opacity above a half.
        let area = std::f64::consts::PI * (0.4f64 * 0.4) * 2.0 * std::f64::consts::LN_2;
        let asked = 10.0 * (surface_backscatter(1.0, 0.0) * area).log10();
        assert!((f64::from(found.rcs) - asked).abs() < 1.0, "{found:?} for {asked}");
    }
    // Twice the greatest speed is folded to nothing.
    let fast =
        strongest(&sweep_from_origin(&radar, &plate(40.0, 0.0), &[], 40.0, &RadarScanOptions::default()));
    assert!(fast.velocity.abs() < 0.1 && fast.ground_velocity.abs() < 0.1, "{fast:?}");
    let world = RadarScanOptions { frame: PointFrame::World, ..RadarScanOptions::default() };
    let world = strongest(&sweep_from_origin(&radar, &plate(40.0, 0.0), &[], 0.0, &world));
    assert!((world.position[0] - 40.0).abs() < 0.1);
}

#[test]
fn rain_takes_what_the_recommendation_says() {
    let radar = radar();
    let wall = plate(100.0, 0.0);
    let rcs = |set: &[(&str, f64)]| {
        let all = (0..4).map(|seed| {
            let options = RadarScanOptions { seed, ..RadarScanOptions::default() };
            f64::from(strongest(&sweep_from_origin(&radar, &wall, set, 0.0, &options)).rcs)
        });
        all.sum::<f64>() / 4.0
    };
    let clear = rcs(&[]);
    // A wind moves the clutter out of the wall's cell.
    let rain =
        |rate: f64| [("rain.rate", rate), ("wind.speed", 10.0), ("wind.direction", 0.0), ("wind.gusts", 0.0)];
    // P.838-3 at 76.5 GHz: 1.1208 R^0.7082 dB/km, there and back over 100 m.
    for rate in [25.0f64, 100.0] {
        let (taken, asked) = (clear - rcs(&rain(rate)), 0.2 * 1.1208 * rate.powf(0.7082));
        println!("{rate} mm/h: {taken:.3} dB for {asked:.3}");
        assert!((taken / asked - 1.0).abs() < 0.03, "{rate}: {taken} for {asked}");
    }
    let fog = clear - rcs(&[("fog.mor", 50.0), ("snowfall.rate", 2.0)]);
    assert!(fog.abs() < 1e-6, "{fog}");
}

#[test]
fn rain_sends_back_what_its_table_says() {
    let radar = RadarModel { reference_range: 300.0, ..radar() };
    let none = Splats::zeroed(0, 0);
    let rays = RaySplats::new(&none, |_| true);
    for (rate, density) in [(10.0, 5.5e-4), (50.0, 1.6e-3)] {
        let wind = [("wind.speed", 5.0), ("wind.direction", 0.0), ("wind.gusts", 0.0)];
        let weather = prepared(&[&[("rain.rate", rate)][..], &wind].concat());
        let scene = scene(&rays, &weather);
        let pose = SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z);
        let view = FanView { model: &radar, scene: &scene, pose, velocity: DVec3::X * 12.0 };
        let random = RandomStream::new(1, 2u64, 3);
        let sectors = view.sectors(&random);
        let [_, azimuths, velocities] = radar.cells();
        // Cells of 10 to 30 m in all azimuths: their mean over the noise, against the radar
        // equation written out.
        let (mut found, mut asked, mut moment) = (0.0, 0.0, 0.0);
        for (azimuth, sector) in sectors.iter().enumerate() {
            let row = powers(&radar, azimuth, sector.scatterers.iter(), &sector.clutter, &random);
            for cell in 20..60 {
                let range: f64 = 0.5 * (f64::from(cell as u32) + 0.5);
                let beam = 2f64.to_radians() * 10f64.to_radians();
                let volume = std::f64::consts::FRAC_PI_4 * range.powi(2) * beam * 0.5;
                let taken = 10f64.powf(-0.2e-3 * rain_attenuation(76.5, rate) * range);
                asked += 13.8155 * density * volume / 10.0 * (300.0 / range).powi(4) * taken;
                for velocity in 0..velocities {
                    let power = f64::from(row[cell * velocities + velocity]) - 1.0;
                    found += power;
                    moment += power * radar.velocity_of(velocity as f64);
                }
            }
        }
        let speed = moment / found;
        println!(
            "{rate} mm/h: {:.3} of the table's power, {speed:.2} m/s in {azimuths} azimuths",
            found / asked
        );
        // 600 cells of some seven independent velocities, near ones counting more: 2 %.
        assert!((found / asked - 1.0).abs() < 0.06, "{found} {asked}");
        // A wind of 5 m/s along x and 12 m/s towards it.
        assert!((speed + 7.0).abs() < 0.4, "{speed}");
    }
}

#[test]
fn walls_hide_the_rain_behind_them() {
    let mut wall = plate(20.0, 0.0);
    wall.log_scales[0] = [f32::ln(0.002), f32::ln(30.0), f32::ln(30.0)];
    let rays = RaySplats::new(&wall, |_| true);
    let weather = prepared(&[("rain.rate", 50.0)]);
    let scene = scene(&rays, &weather);
    let (model, pose) = (radar(), SensorPose::upright(DVec3::ZERO, DVec3::X, DVec3::Z));
    let view = FanView { model: &model, scene: &scene, pose, velocity: DVec3::ZERO };
    let sectors = view.sectors(&RandomStream::new(1, 2u64, 3));
    let RainClutter { powers, .. } = &sectors[7].clutter;
    assert!(powers[30] > 1.0 && powers[45] == 0.0, "{} {}", powers[30], powers[45]);
}

#[test]
fn any_number_of_threads_gives_the_same_detections() {
    let radar = RadarModel { reference_range: 500.0, ..radar() };
    let mut scene = plate(60.0, 0.1);
    scene.append(&plate(35.0, -0.15));
    let made = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let options = RadarScanOptions { seed, ..RadarScanOptions::default() };
        pool.install(|| sweep_from_origin(&radar, &scene, &[("rain.rate", 50.0)], 9.0, &options))
    };
    let one = made(1, 5);
    assert!(one.count(RadarClass::Surface) > 0 && one.count(RadarClass::Rain) > 0);
    assert!(one == made(2, 5) && one == made(7, 5));
    assert!(one != made(2, 6));
}

#[test]
fn files_have_eleven_columns() {
    let made = sweep_from_origin(&radar(), &plate(40.0, 0.0), &[], 0.0, &RadarScanOptions::default());
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (name, end) in [("a.ply", "end_header\n"), ("a.PCD", "DATA binary\n")] {
        made.save(&path(name)).unwrap();
        let all = std::fs::read(path(name)).unwrap();
        let start = all.windows(end.len()).position(|w| w == end.as_bytes()).unwrap() + end.len();
        assert_eq!(all.len() - start, 41 * made.detections.len());
        assert_eq!(all[start..start + 4], made.detections[0].position[0].to_le_bytes());
        assert_eq!(all[start + 40], made.detections[0].class as u8);
    }
    made.save(&path("a.npy")).unwrap();
    let (values, shape) = wm_base::npy::read(&path("a.npy")).unwrap();
    assert_eq!(shape, [made.detections.len(), 11]);
    assert_eq!([values[3], values[8]], [made.detections[0].range, made.detections[0].rcs]);
    let error = made.save(&path("a.las")).unwrap_err().to_string();
    assert!(error.ends_with("names that end in .ply, .pcd or .npy"), "{error}");
}
