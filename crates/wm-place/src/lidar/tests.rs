use super::*;
use crate::testing::street;
use std::collections::HashMap;
use wm_scene::reflectance::LabelReflectance;

fn place(renderer: &mut Renderer) -> (PreparedPlace, CameraMotion) {
    let (place, camera) = street(renderer);
    (place, camera.into())
}

#[test]
fn weather_changes_what_a_lidar_sees_of_a_street() {
    let mut renderer = Renderer::cpu().unwrap();
    let (mut place, motion) = place(&mut renderer);
    let lidar = LidarModel::find("vlp-16").unwrap();
    let options = ScanOptions { sub_rays: SubRays::One, returns: ReturnMode::Dual, ..ScanOptions::default() };
    let mut scan = |set: &[&str]| {
        let mut weather = Weather::clear();
        set.iter().for_each(|text| weather.set_text(text).unwrap());
        renderer.scan_once(&mut place, &weather, &lidar, &motion, &options).unwrap()
    };
    let clear = scan(&[]);
    assert_eq!(clear.points.len(), clear.count(EchoClass::Surface));
    let fog = scan(&["fog.mor=40"]);
    assert!(fog.count(EchoClass::Air) > 5000, "{}", fog.count(EchoClass::Air));
    assert!(fog.count(EchoClass::Surface) < clear.points.len());
    // Rain that has wetted the ground: far ground is lost, drops are seen.
    let rain = scan(&["rain.rate=25", "wetness.amount=1"]);
    // 0.14 % of the pulses, by the table of docs/guide/lidar.md: near by the receiver is out of
    // focus.
    let drops = rain.count(EchoClass::Drop);
    assert!((20..80).contains(&drops), "{drops}");
    let ground = |sweep: &LidarSweep| {
        let is_ground = |point: &&LidarPoint| {
            point.class == EchoClass::Surface && point.position[2] < -1.4 && point.range > 8.0
        };
        sweep.points.iter().filter(is_ground).count() as f64
    };
    println!("ground beyond 8 m: {} dry, {} wet", ground(&clear), ground(&rain));
    assert!(ground(&rain) < 0.8 * ground(&clear), "{} {}", ground(&rain), ground(&clear));
    // Snow on the ground is brighter than what it lies on.
    let snow = scan(&["snow_cover.depth=0.1"]);
    let bright = |sweep: &LidarSweep| {
        let low = sweep.points.iter().filter(|point| point.position[2] < -1.2 && point.range < 12.0);
        let all: Vec<f64> = low.map(|point| f64::from(point.intensity)).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    assert!(bright(&snow) > 1.5 * bright(&clear), "{} {}", bright(&snow), bright(&clear));
    for (view, _) in SweepView::ALL {
        let picture = view.draw(&rain);
        assert_eq!(picture.rgb.len(), 3 * picture.size.pixels());
    }
    let mut flooded = Weather::clear();
    flooded.set_text("flood.level=0.3").unwrap();
    assert!(matches!(
        renderer.scan_once(&mut place, &flooded, &lidar, &motion, &options),
        Err(Error::Unsupported(_))
    ));
}

/// A place whose labels have reflectances sends back as much, and no colour counts there.
#[test]
fn labels_give_reflectances() {
    let street = wm_street::Street::builtin();
    let mut scene = street.sampling(0.1).scene(&|_| true).unwrap();
    scene.splats.labels = vec![4; scene.splats.len()];
    let of = |reflectance| LabelReflectance { label: 4, reflectance, wavelength: Some(905.0) };
    let lidar = LidarModel::find("vlp-16").unwrap();
    let options = ScanOptions { sub_rays: SubRays::One, ..ScanOptions::default() };
    let mut renderer = Renderer::cpu().unwrap();
    let camera = street.dolly(0.3).camera((120, 80)).unwrap();
    let mut near = |reflectance: f64| -> HashMap<(u16, u32), f32> {
        let mut scene = scene.clone();
        scene.metadata.reflectances = Some(vec![of(reflectance)]);
        let mut place = renderer.load(scene).unwrap();
        let motion = CameraMotion::from(camera);
        let sweep = renderer.scan_once(&mut place, &Weather::clear(), &lidar, &motion, &options).unwrap();
        let points = sweep.points.iter().filter(|point| point.range < 8.0);
        points.map(|point| ((point.ring, point.column), point.intensity)).collect()
    };
    let [dark, bright] = [near(0.2), near(0.6)];
    let pairs: Vec<[f32; 2]> =
        dark.iter().filter_map(|(pulse, dark)| Some([*dark, *bright.get(pulse)?])).collect();
    assert!(pairs.len() > 1000, "{}", pairs.len());
    for [dark, bright] in pairs {
        assert!((bright / dark - 3.0).abs() < 1e-3 && bright < 255.0 * 0.6 * 1.001, "{dark} {bright}");
    }
}

#[test]
fn a_later_sweep_is_the_same_when_made_alone() {
    let mut renderer = Renderer::cpu().unwrap();
    let (mut place, motion) = place(&mut renderer);
    let lidar = LidarModel::find("mid-40").unwrap();
    let weather = Weather::clear().set("snowfall.rate", 0.3).unwrap();
    let options = ScanOptions { seed: 3, sub_rays: SubRays::One, ..ScanOptions::default() };
    let mut made = Vec::new();
    let mut take = |sweep| {
        made.push(sweep);
        Ok(())
    };
    let count =
        renderer.scan(&mut place, &weather, &lidar, &motion, &options, 2, &mut take, &mut ()).unwrap();
    assert_eq!((count, made.len()), (2, 2));
    assert!(made[0].points != made[1].points && made[0].count(EchoClass::Flake) > 0);
    let alone = ScanOptions { index: 1, ..options };
    let second = renderer.scan_once(&mut place, &weather, &lidar, &motion, &alone).unwrap();
    assert!(second == made[1]);
}

/// Rays of a GPU end where the CPU's do, but where two splats share half of a ray's coverage within
/// rounding.
#[cfg(feature = "gpu")]
#[test]
fn a_gpu_sees_the_points_that_the_cpu_sees() {
    let Some(adapter) = wm_render::gpu::adapters().into_iter().find(|listed| listed.unfit.is_none()) else {
        assert!(std::env::var("WM_REQUIRE_GPU").is_err(), "no GPU, and WM_REQUIRE_GPU is set");
        eprintln!("skipped: no GPU");
        return;
    };
    let device = crate::Device::Gpu(Some(adapter.name));
    let mut gpu = Renderer::new(&device, crate::CpuConfig::default(), |_| {}).unwrap();
    let mut cpu = Renderer::cpu().unwrap();
    // A VLP-16 with a third of its columns: the GPU may be one in software.
    let preset = PRESETS.iter().find(|(name, _)| *name == "vlp-16").unwrap().1;
    let lidar = LidarModel::parse(&preset.replace("columns = 1808", "columns = 600"), "vlp-16").unwrap();
    assert_eq!(lidar.pattern.grid(), Some([16, 600]));
    let options = ScanOptions { seed: 4, ..ScanOptions::default() };
    // Wet ground mirrors rays, which begin in many places.
    let mut wet = Weather::clear();
    for text in ["rain.rate=25", "wetness.amount=1"] {
        wet.set_text(text).unwrap();
    }
    let mut places = [&mut gpu, &mut cpu].map(place);
    for weather in [Weather::clear(), wet] {
        let [on_gpu, on_cpu] = [(&mut gpu, 0), (&mut cpu, 1)].map(|(renderer, at)| {
            let (place, motion) = &mut places[at];
            let sweep = renderer.scan_once(place, &weather, &lidar, motion, &options).unwrap();
            let points = sweep.points.iter().map(|point| ((point.ring, point.column), point.position));
            (sweep.pulses, points.collect::<HashMap<_, _>>())
        });
        let (pulses, points) = on_cpu;
        let is_same = |pulse: &(u16, u32)| match (on_gpu.1.get(pulse), points.get(pulse)) {
            (Some(a), Some(b)) => (0..3).all(|k| (a[k] - b[k]).abs() < 1e-3),
            _ => false,
        };
        let mut all: Vec<_> = points.keys().chain(on_gpu.1.keys()).collect();
        all.sort_unstable();
        all.dedup();
        let off = all.iter().filter(|pulse| !is_same(pulse)).count();
        println!("{off} points of {} of {pulses} pulses are elsewhere", all.len());
        assert!(all.len() * 2 > pulses && off * 1000 < pulses, "{off} of {pulses}");
    }
}
