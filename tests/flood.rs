//! Floods the built-in street and holds the mirror against rays, threads against each other, and bad input against its message.

use weather_magician::{FrameOptions, Picture, PreparedPlace, Renderer, Weather};
use wm_render::{CpuConfig, Device};
use wm_scene::color::{srgb_decode, srgb_encode};
use wm_scene::{Camera, Scene};
use wm_street::{Place, Street, display_of};
use wm_weather::water::fresnel;

const LEVEL: f64 = 0.25;

fn street() -> (Place, Scene) {
    let street = Street::builtin();
    let scene = street.sampling(0.5).scene(&|_| true).expect("nobody stops it");
    (street, scene)
}

fn weather(changes: &[&str]) -> Weather {
    let mut weather = Weather::clear();
    changes.iter().for_each(|change| weather.set_text(change).unwrap());
    weather
}

fn draw(
    renderer: &mut Renderer,
    place: &mut PreparedPlace,
    weather: &Weather,
    (camera, time): (&Camera, f64),
) -> Picture {
    let mut picture = Picture::default();
    let options = FrameOptions::new(time, *camera);
    renderer.render_into(place, weather, &options, &mut picture, &mut ()).unwrap();
    picture
}

/// Still and black water mirrors what a ray from it meets.
#[test]
fn still_water_mirrors_what_rays_meet() {
    let (street, scene) = street();
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let ground = place.site().ground;
    let water = ground + LEVEL;
    let level = format!("flood.level={LEVEL}");
    let weather = weather(&[&level, "flood.secchi=0.02", "flood.tint=0,0,0"]);
    for time in [0.02, 0.4] {
        let camera = Street::dolly(time).camera((240, 160)).unwrap();
        // The splats are not the street: what they show directly differs from what rays meet, too.
        let clear = draw(&mut renderer, &mut place, &Weather::clear(), (&camera, 0.0));
        let (mut directly, mut pixels) = (0.0, 0);
        for (x, y) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y))) {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let Some(hit) = street.cast(camera.center(), ray) else { continue };
            for (want, seen) in display_of(hit.radiance).into_iter().zip(clear.frame.rgb_at(x, y)) {
                directly += (want - f64::from(seen)).powi(2);
                pixels += 1;
            }
        }
        let direct_psnr = -10.0 * (directly / f64::from(pixels)).log10();
        let picture = draw(&mut renderer, &mut place, &weather, (&camera, 0.0));
        let (mut error, mut count) = (0.0, 0);
        for y in 0..camera.height {
            for x in 0..camera.width {
                let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let distance = (camera.center().z - water) / -ray.z;
                let is_water = ray.z < 0.0 && distance < 60.0;
                let is_open =
                    is_water && street.first(camera.center(), ray).is_none_or(|hit| hit.t > distance);
                if !is_open {
                    continue;
                }
                let point = camera.center() + distance * ray;
                let up = glam::DVec3::new(ray.x, ray.y, -ray.z);
                let Some(hit) = street.cast(point, up) else { continue };
                let share = f64::from(fresnel(-ray.z as f32));
                let seen = picture.frame.rgb_at(x, y);
                for (radiance, seen) in display_of(hit.radiance).into_iter().zip(seen) {
                    let want = srgb_encode(share * srgb_decode(radiance));
                    error += (want - f64::from(seen)).powi(2);
                    count += 1;
                }
            }
        }
        let psnr = -10.0 * (error / f64::from(count)).log10();
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
        let mut all =
            times.iter().map(|time| draw(&mut renderer, &mut place, &weather, (&camera, *time)).frame);
        all.by_ref().last().unwrap()
    };
    let alone = drawn(1, &[2.0]);
    assert_eq!(alone, drawn(2, &[0.0, 1.0, 2.0]));
    assert_eq!(alone, drawn(7, &[2.0]));
    assert_ne!(alone, drawn(2, &[2.1]));
}

#[test]
fn an_eye_under_water_is_refused() {
    let (_, scene) = street();
    let mut renderer = Renderer::cpu().unwrap();
    let mut place = renderer.load(scene).unwrap();
    let camera = Street::dolly(0.1).camera((60, 40)).unwrap();
    let mut picture = Picture::default();
    let mut draw = |weather: &Weather| {
        let options = FrameOptions::new(0.0, camera);
        renderer
            .render_into(&mut place, weather, &options, &mut picture, &mut ())
            .map(|_| place.take_warnings())
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
