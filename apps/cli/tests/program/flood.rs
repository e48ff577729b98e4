//! Floods the built-in street and holds the mirror against rays, threads against each other, and
//! bad input against its message.

use crate::common::{pixels, psnr, weather};
use glam::DVec3;
use weather_magician::{FrameRequest, Metadata, PreparedPlace, Renderer, Weather};
use wm_base::color::{srgb_decode, srgb_encode};
use wm_render::{CpuConfig, Device};
use wm_scene::splats::Splat;
use wm_scene::{Camera, Group, Scene, Splats};
use wm_street::{Place, Street, display_of};
use wm_weather::water::fresnel;

const FLOOD_LEVEL_M: f64 = 0.25;

fn street() -> (Place, Scene) {
    let street = Street::builtin();
    let scene = street.sampling(0.5).scene(&|_| true).expect("nobody stops it");
    (street, scene)
}

/// A request for the frame at 0 s.
fn still<'a>(weather: &'a Weather, camera: &Camera) -> FrameRequest<'a> {
    FrameRequest::new(weather, *camera, 0.0)
}

/// Still and black water mirrors what a ray from it meets.
#[test]
fn still_water_mirrors_what_rays_meet() {
    let (street, scene) = street();
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let ground = place.site().ground;
    let water = ground + FLOOD_LEVEL_M;
    let level = format!("flood.level={FLOOD_LEVEL_M}");
    let weather = weather(&[&level, "flood.ground=0", "flood.secchi=0.02", "flood.tint=0,0,0"]);
    for time in [0.02, 0.4] {
        let camera = Street::dolly(time).camera((240, 160)).unwrap();
        // The splats are not the street: what they show directly differs from what rays meet, too.
        let clear = renderer.render(&mut place, &still(&Weather::clear(), &camera)).unwrap();
        let mut directly = Vec::new();
        for (x, y) in pixels(&camera) {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let Some(hit) = street.cast(camera.center(), ray) else { continue };
            for (want, seen) in display_of(hit.radiance).into_iter().zip(clear.frame.rgb_at(x, y)) {
                directly.push(want - f64::from(seen));
            }
        }
        let direct_psnr = psnr(directly);
        let picture = renderer.render(&mut place, &still(&weather, &camera)).unwrap();
        let mut errors = Vec::new();
        for (x, y) in pixels(&camera) {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let distance = (camera.center().z - water) / -ray.z;
            let is_water = ray.z < 0.0 && distance < 60.0;
            let is_open = is_water && street.first(camera.center(), ray).is_none_or(|hit| hit.t > distance);
            if !is_open {
                continue;
            }
            let point = camera.center() + distance * ray;
            let up = DVec3::new(ray.x, ray.y, -ray.z);
            let Some(hit) = street.cast(point, up) else { continue };
            let share = f64::from(fresnel(-ray.z as f32));
            for (radiance, seen) in display_of(hit.radiance).into_iter().zip(picture.frame.rgb_at(x, y)) {
                errors.push(srgb_encode(share * srgb_decode(radiance)) - f64::from(seen));
            }
        }
        let count = errors.len();
        let psnr = psnr(errors);
        println!("{time}: {psnr:.2} dB over {} pixels, directly {direct_psnr:.2} dB", count / 3);
        assert!(count > 9000 && psnr > direct_psnr, "{psnr} dB over {count}, directly {direct_psnr} dB");
    }
}

/// Any frame alone, on any number of threads, is the frame of a shot.
#[test]
fn frames_are_functions_of_time() {
    let (_, scene) = street();
    let weather = weather(&["flood.level=0:0.1,4:0.5", "wind.speed=4", "rain.rate=8"]);
    let camera = Street::dolly(0.1).camera((150, 100)).unwrap();
    let drawn = |threads: usize, times: &[f64]| {
        let config = CpuConfig { threads: Some(threads), ..CpuConfig::default() };
        let mut renderer = Renderer::new(&Device::Cpu, config, |_| {}).unwrap();
        let mut place = renderer.load(scene.clone()).unwrap();
        let draw = |time: &f64| renderer.render(&mut place, &FrameRequest::new(&weather, camera, *time));
        times.iter().map(draw).last().unwrap().unwrap().frame
    };
    let alone = drawn(1, &[2.0]);
    assert_eq!(alone, drawn(2, &[0.0, 1.0, 2.0]));
    assert_eq!(alone, drawn(7, &[2.0]));
    assert_ne!(alone, drawn(2, &[2.1]));
}

/// Ground that falls by 5 % along x.
fn slope() -> Scene {
    let mut splats = Splats::default();
    for i in 0..160 * 40 {
        let [x, y] = [i % 160, i / 160].map(|v| 0.25 * f64::from(v));
        let [x, y] = [x - 20.0, y - 5.0];
        splats.push(&Splat {
            mean: [x, y, -0.05 * x].map(|v| v as f32),
            quat: [1.0, 0.0, 0.025, 0.0],
            log_scale: [0.2f32.ln(), 0.2f32.ln(), 0.01f32.ln()],
            logit_opacity: 5.0,
            rgb: [0.4; 3],
            group: Group::Scene,
        });
    }
    let metadata = Metadata { up: Some(DVec3::Z), metres_per_unit: Some(1.0), ..Metadata::default() };
    Scene { splats, metadata, ..Scene::default() }
}

/// The water stands as high as it is told to at the feet of the camera, wherever that is; over a
/// shot it stays where it was at first.
#[test]
fn a_flood_stands_over_the_ground_under_the_camera() {
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(slope()).unwrap();
    let eye = |x: f64| {
        let eye = DVec3::new(x, 0.0, 1.6 - 0.05 * x);
        Camera::looking((60, 40), 60.0, eye, eye + DVec3::new(0.0, 2.0, -1.0), DVec3::Z).unwrap()
    };
    let depth_at_feet = |place: &PreparedPlace, weather: &Weather, camera: &Camera| {
        let mut prepared = weather.at(0.0).prepare(place.site());
        // Would show if the shot had not set the ground.
        prepared.stand_flood_on(f64::NAN);
        let level = prepared.water(None).unwrap().plane().unwrap();
        level + 0.05 * camera.center().x
    };
    let flood = weather(&["flood.level=0.3"]);
    for x in [-15.0, -3.0, 0.0, 12.0] {
        let own = place.weather_of_shot(&flood, &eye(x));
        let depth = depth_at_feet(&place, &own, &eye(x));
        assert!((depth - 0.3).abs() < 0.01, "{depth} m at {x}");
        // A frame alone does the same.
        let [alone, shot] =
            [&flood, &own].map(|weather| renderer.render(&mut place, &still(weather, &eye(x))).unwrap());
        assert_eq!(alone.frame, shot.frame);
    }
    let shot = place.weather_of_shot(&flood, &eye(0.0));
    assert_eq!(place.weather_of_shot(&shot, &eye(12.0)), shot);
    let fixed = weather(&["flood.level=0.3", "flood.ground=0.5"]);
    assert_eq!(place.weather_of_shot(&fixed, &eye(12.0)), fixed);
}

#[test]
fn an_eye_under_water_is_refused() {
    let (_, scene) = street();
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let camera = Street::dolly(0.1).camera((60, 40)).unwrap();
    let mut draw = |weather: &Weather| {
        renderer.render(&mut place, &still(weather, &camera)).map(|_| place.take_warnings())
    };
    let message = draw(&weather(&["flood.level=3"])).unwrap_err().to_string();
    assert!(
        message.starts_with("the camera is under water: flood.level is 3.00 m over the ground, the eye 1."),
        "{message}"
    );
    let warnings = draw(&weather(&["flood.level=-1"])).unwrap();
    assert!(
        warnings.iter().any(|warning| warning.starts_with("flood.level is not above the ground")),
        "{warnings:?}"
    );
}
